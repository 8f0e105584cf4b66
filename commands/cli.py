"""The command line: verbs and their options; those of `runs` and `weights` have files of their own."""

from __future__ import annotations

import sys
import tomllib
from collections.abc import Callable, Iterable, Mapping
from pathlib import Path
from typing import Annotated, Any

import typer

from commands import history_verbs, weights_verbs
from commands.errors import UsageError
from commands.options import NAMED, Clips, Device, Json, ParamsFile, Remote, Sets, SourceDir, Store, Target
from commands.targets import use
from runner.signals import TERMINATED, terminating

app = typer.Typer(no_args_is_help=True, add_completion=False, pretty_exceptions_enable=False, rich_markup_mode="rich")
app.add_typer(history_verbs.app, name="runs")
app.add_typer(weights_verbs.app, name="weights")


def _print_version(wanted: bool) -> None:
    """Print the name and the version in pyproject.toml."""
    if wanted:
        project = tomllib.loads((Path(__file__).resolve().parent.parent / "pyproject.toml").read_text(encoding="utf-8"))["project"]
        typer.echo(f"{project['name']} {project['version']}")
        raise typer.Exit


@app.callback()
def _top(
    version: Annotated[bool, typer.Option("--version", is_eager=True, callback=_print_version, help="print the version")] = False,
) -> None:
    """Two-hand affordances and grasps from video of people: one content-hashed pipeline."""


@app.command()
def run(
    target: Target = None,
    source: SourceDir = None,
    clip: Clips = None,
    set_: Sets = None,
    params: ParamsFile = None,
    uses: Annotated[Path | None, typer.Option(help="CSV file of your objects: object, task, parts to hold, parts to avoid",
                                              show_default=False)] = None,
    only: Annotated[str | None, typer.Option(help="run one stage, by its name or that of its file, on its last inputs, and record "
                                             "it; reports stale inputs, and computes missing ones")] = None,
    record: Annotated[bool | None, typer.Option("--record/--no-record", help="with --only: record the output of the stage; "
                                                "default: yes", show_default=False)] = None,
    force: Annotated[list[str] | None, typer.Option(help="run this stage even if cached (repeatable)")] = None,
    jobs: Annotated[int | None, typer.Option(help="worker processes; default: one per core; 0: none")] = None,
    engine: Annotated[str | None, typer.Option(help="inline (in this process), pool (worker processes) or ray; default: pool",
                                               show_default=False)] = None,
    address: Annotated[str | None, typer.Option(help="Ray cluster, HOST:PORT or auto; default: a private one on this machine",
                                                show_default=False)] = None,
    minutes: Annotated[float | None, typer.Option(min=0, help="time limit, after which optional parts are deferred to the next "
                                                  "run; default: 75 for ablation, grasp-full, sor3d-ablation, else inf")] = None,
    store: Store = None,
    remote: Remote = None,
    dry_run: Annotated[bool, typer.Option("--dry-run", help="show the tasks that would run, with reasons; run nothing")] = False,
    rehash: Annotated[bool, typer.Option(help="hash every source file again")] = False,
    replace: Annotated[bool, typer.Option("--replace", help="publish a partial output (some clips only, or after failures) in "
                                          "place of a complete one; default: under the name <name>-part")] = False,
    json: Json = False,
) -> None:
    """Run a target; results are cached by code, parameters and inputs."""
    if uses is not None:
        from commands.uses import setting_of

        set_ = [*(set_ or ()), setting_of(uses)]
    request = _request(target, source, clip, set_, params, store, json, only=only, force=force, jobs=jobs, rehash=rehash,
                       minutes=minutes, replace=replace, record=record, remote=remote, engine=engine, address=address)
    if dry_run:
        from commands.store import dry_run as plan

        raise typer.Exit(plan(request))
    from commands.run import run as make

    raise typer.Exit(make(request))


@app.command()
def check(
    folder: Annotated[Path, typer.Argument(help="EPIC root, folder with a video (and masks), or folder of meshes")],
    clip: Clips = None,
    set_: Sets = None,
    json: Json = False,
) -> None:
    """Check a source before a run: clips, masks, contacts, narrations, warnings, refusals. Nothing is written."""
    from commands.check import check as look

    raise typer.Exit(look(folder, tuple(clip or ()), tuple(set_ or ()), json))


@app.command()
def status(target: Annotated[str | None, typer.Argument(help=f"{NAMED}; or a stage; default: dataset", show_default=False)] = None,
           source: SourceDir = None, set_: Sets = None, params: ParamsFile = None,
           store: Store = None, remote: Remote = None, json: Json = False) -> None:  # fmt: skip
    """Show the progress of a target or of a stage, and its failures."""
    from commands.store import status as show

    raise typer.Exit(show(_request(target, source, None, set_, params, store, json, remote=remote)))


@app.command()
def explain(
    stage: Annotated[str | None, typer.Argument(help="a stage, by its name or that of its file; default: all")] = None,
    target: Annotated[str | None, typer.Option(help="the target it belongs to; default: the first that has it",
                                               show_default=False)] = None,
    clip: Annotated[str | None, typer.Option(help="one clip")] = None,
    source: SourceDir = None,
    set_: Sets = None,
    params: ParamsFile = None,
    every: Annotated[bool, typer.Option("--all", help="list each task, also of more than 300; default: groups of them")] = False,
    store: Store = None,
    remote: Remote = None,
    json: Json = False,
) -> None:
    """Explain the next or last run of each task of a stage."""
    from commands.store import explain as show

    raise typer.Exit(show(_request(target, source, None, set_, params, store, json, only=stage, remote=remote), clip, every))


@app.command()
def graph(target: Annotated[str | None, typer.Argument(help=f"{NAMED}; default: dataset", show_default=False)] = None,
          source: SourceDir = None,
          out: Annotated[Path | None, typer.Option("--out", help="draw to this .svg or .png")] = None) -> None:  # fmt: skip
    """Show the stages of a target and their inputs."""
    from commands.store import graph as show

    raise typer.Exit(show(_request(target, source, None, None, None, None, False), out))


@app.command()
def lineage(
    artifact: Annotated[str, typer.Argument(help="digest, its prefix, a path, or a stage (its last output)")],
    store: Store = None,
    json: Json = False,
) -> None:
    """Show the provenance of an artifact, down to the files from outside."""
    from commands.store import lineage as show

    raise typer.Exit(show(artifact, store, json))


@app.command()
def verify(store: Store = None, json: Json = False) -> None:
    """Read and check the whole store.

    Damaged blobs are moved aside; the next run computes them again.
    """
    from commands.store import verify as check

    raise typer.Exit(check(store, json))


@app.command()
def gc(
    keep_last: Annotated[int, typer.Option(min=1, help="keep the results of the last N keys (code, parameters, inputs) of every "
                                           "clip and stage, by their last use")] = 1,
    older_than: Annotated[float, typer.Option(min=0, help="also keep results that were used in the last N days")] = 0.0,
    drop: Annotated[list[str] | None, typer.Option(help="STAGE,...: delete the bytes of these stages, and keep their results as "
                                                   "known: they are computed again only if something needs them; published files, "
                                                   "and bytes that other kept results have, stay")] = None,
    store: Store = None,
    dry_run: Annotated[bool, typer.Option("--dry-run", help="count files and bytes by stage, delete nothing")] = False,
    json: Json = False,
) -> None:
    """Delete what the last use of every clip does not reach, and runs beyond the last 1,000 or older than 90 days."""
    from commands.store import gc as sweep
    from runner.garbage import Rules

    stages = tuple(name.strip() for word in drop or () for name in word.split(",") if name.strip())
    raise typer.Exit(sweep(store, Rules(keep_last, older_than, stages), dry_run, json))


@app.command()
def du(store: Store = None, json: Json = False) -> None:
    """Show the disk usage of the store by stage; every stored file is counted once."""
    from commands.store import du as show

    raise typer.Exit(show(store, json))


@app.command()
def inspect(
    paths: Annotated[list[str], typer.Argument(help="recordings, folders of them, or the digest of one artifact")],
    strict: Annotated[bool, typer.Option("--strict", help="check every checksum, index, payload and picture")] = False,
    sheet: Annotated[Path | None, typer.Option(help="draw a contact sheet to this .png")] = None,
    rerun: Annotated[bool, typer.Option("--rerun", help="open the Rerun viewer")] = False,
    save: Annotated[Path | None, typer.Option(help="write an .rrd for the Rerun viewer, layout included")] = None,
    layout: Annotated[Path | None, typer.Option(help="write a layout for Foxglove, .json")] = None,
    diff: Annotated[bool, typer.Option("--diff", help="list the differences between two recordings")] = False,
    sort: Annotated[str, typer.Option(help="order of several recordings: name, messages, seconds, bytes or problem")] = "name",
    store: Store = None,
    json: Json = False,
) -> None:
    """Show the content, integrity and pictures of recordings."""
    from commands.inspect import Options
    from commands.inspect import inspect as look

    raise typer.Exit(look(paths, Options(json, strict, sheet, rerun, save, layout, diff, sort, store)))


@app.command()
def params(stage: Annotated[str | None, typer.Argument(help="a stage, or a system; default: all")] = None,
           set_: Sets = None,
           diff: Annotated[str | None, typer.Option(help="paper: what differs from a paper's parameters")] = None,
           json: Json = False) -> None:  # fmt: skip
    """List parameters with type, default and meaning, or those that differ from a paper's."""
    from commands.params import show

    if diff not in (None, "paper"):
        raise UsageError(f"--diff {diff}: expected paper")
    raise typer.Exit(show(stage, json, tuple(set_ or ()), diff == "paper"))


@app.command("fetch-list")
def fetch_list(
    root: Annotated[Path, typer.Argument(help="folder for the files; files that it holds are omitted from the list")],
    video: Annotated[list[str] | None, typer.Option(help="only this video, e.g. P03_101 (repeatable)")] = None,
    participant: Annotated[list[str] | None, typer.Option(help="only videos of this person, e.g. P03 (repeatable)")] = None,
    split: Annotated[str, typer.Option(help="only VISOR's train or val")] = "",
    kind: Annotated[list[str] | None, typer.Option("--with", help="tables, sparse, dense, key-frames, frames or videos "
                                                   "(repeatable); default: tables, sparse, frames")] = None,
    json: Json = False,
) -> None:
    """List the files of EPIC-KITCHENS and VISOR that a folder lacks, for a downloader. Nothing is downloaded."""
    from commands.fetch_list import Subset
    from commands.fetch_list import fetch_list as show

    subset = Subset(tuple(video or ()), tuple(participant or ()), split, *([tuple(kind)] if kind else []))
    raise typer.Exit(show(root, subset, json))


@app.command()
def backends(
    stage: Annotated[str | None, typer.Argument(help="a stage; default: all")] = None,
    set_: Sets = None,
    params: ParamsFile = None,
    out: Annotated[Path | None, typer.Option("--out", help="write the table between the markers of this page")] = None,
    json: Json = False,
) -> None:
    """List backends: task, requirements, and whether each is usable here."""
    from commands.backends import show

    raise typer.Exit(show(stage, set_ or (), params, json, out))


@app.command()
def export(
    format: Annotated[str, typer.Argument(help="2hands, coco, webdataset (from a data set) or epic (from rendered clips)")],
    folder: Annotated[Path, typer.Argument(help="where to write; must be empty or new")],
    polygons: Annotated[bool, typer.Option("--polygons", help="coco: masks as polygons of outer contours, without holes, instead "
                                           "of run lengths")] = False,
    original_frames: Annotated[bool, typer.Option("--original-frames", help="coco, webdataset: also write the frames with "
                                                  "hands")] = False,
    source: SourceDir = None,
    store: Store = None,
) -> None:
    """Write the last data set, or the rendered clips, in another format."""
    from commands.export import export as write

    raise typer.Exit(write(format, folder, source, store, polygons, original_frames))


@app.command()
def predict(
    image: Annotated[Path, typer.Argument(help="an image, a video, or a folder of them; sor3d: also a folder of frames")],
    out: Annotated[Path, typer.Option("--out", help="output folder: new, empty, or written by this verb before")],
    task: Annotated[str, typer.Argument(help="the task, e.g. \"pour tea from kettle\"; none for sor3d")] = "",
    model: Annotated[Path | None, typer.Option("--model", help="folder of a trained model, or sor3d for the last model of `run "
                                               "sor3d`; default: the two-hand model trained last")] = None,
    hands: Annotated[str, typer.Option(help="auto (the model chooses), left, right or both")] = "auto",
    threshold: Annotated[float | None, typer.Option(help="probability threshold of region pixels; default: the model's")] = None,
    all_hypotheses: Annotated[bool, typer.Option("--all-hypotheses", help="also write the mask of every hypothesis")] = False,
    always: Annotated[bool, typer.Option("--always", help="regions also where the thing is probably not in the picture")] = False,
    quick: Annotated[bool, typer.Option("--quick", help="one look at each picture, none at its mirror image: a third of "
                                        "the time, less precise")] = False,
    every: Annotated[int, typer.Option(help="use every n-th frame of a video")] = 10,
    batch: Annotated[int | None, typer.Option(help="batch size; default: 1, on a GPU 8")] = None,
    device: Device = "cpu",
    dtype: Annotated[str, typer.Option(help="float32, bfloat16 or float16; default: float32, for vlm as it is stored")] = "",
    force: Annotated[bool, typer.Option("--force", help="write into a folder that holds other files")] = False,
    depth: Annotated[Path | None, typer.Option(help="sor3d: depth as 16-bit PNG in mm, .npy in m, or a folder of them")] = None,
    intrinsics: Annotated[Path | None, typer.Option(help="sor3d: camera as JSON: fx, fy, cx, cy, or K")] = None,
    focal_px: Annotated[float | None, typer.Option(help="sor3d: focal length, if no --intrinsics; default: a Kinect's")] = None,
    rate_hz: Annotated[float, typer.Option(help="sor3d: frame rate at which a video is sampled")] = 10.0,
    frames: Annotated[int, typer.Option(help="sor3d: maximum number of frames, the last ones of the sequence")] = 10,
    store: Store = None,
    json: Json = False,
) -> None:
    """Predict hand regions for a task, or (sor3d) affordance regions: masks, overlay and JSON for every picture."""
    from commands import predict as image_model
    from commands import predict_sequence as sequence_model

    options = image_model.Options(out, model, hands, threshold, all_hypotheses, every, batch, device, dtype, force, store, json,
                                  depth, intrinsics, focal_px, rate_hz, frames, always, quick)  # fmt: skip
    verb = sequence_model if sequence_model.is_sequence_model(model) else image_model
    raise typer.Exit(verb.predict(image, task, options))


@app.command()
def grasp(
    depth: Annotated[Path, typer.Argument(help="depth image: 16-bit PNG in millimetres, or .npy in metres")],
    out: Annotated[Path, typer.Option("--out", help="output folder: new, empty, or written by this verb before")],
    masks: Annotated[Path | None, typer.Option(help="folder that `predict` wrote for a picture")] = None,
    left: Annotated[Path | None, typer.Option(help="mask of the left hand's region, .png")] = None,
    right: Annotated[Path | None, typer.Option(help="mask of the right hand's region, .png")] = None,
    image: Annotated[Path | None, typer.Option(help="the colour picture, for the overlay")] = None,
    intrinsics: Annotated[Path | None, typer.Option(help="camera as JSON: fx, fy, cx, cy, or K")] = None,
    focal_px: Annotated[float | None, typer.Option(help="focal length, in place of --intrinsics")] = None,
    negative: Annotated[Path | None, typer.Option(help="negative affordance: mask .png, points .npy, or negative.json")] = None,
    object_pose: Annotated[Path | None, typer.Option(help="T_cam_obj as JSON, for negative.json")] = None,
    taxonomy: Annotated[str, typer.Option(help="left, right, both_same or both_different; default: the prediction's")] = "",
    hands: Annotated[str, typer.Option(help="auto (the taxonomy chooses), left, right or both")] = "auto",
    count: Annotated[int, typer.Option(help="number of grasps per hand")] = 10,
    span_m: Annotated[float, typer.Option(help="maximum opening of the hand in metres")] = 0.09,
    force: Annotated[bool, typer.Option("--force", help="write into a folder that holds other files")] = False,
    json: Json = False,
) -> None:
    """Compute grasps from masks and depth: poses of one or two hands, best first."""
    from afford.grasping.candidates.read_scene import SceneFiles
    from commands.grasp import Options
    from commands.grasp import grasp as find

    files = SceneFiles(depth, masks, left, right, image, intrinsics, focal_px, negative, object_pose, taxonomy, hands)
    raise typer.Exit(find(files, Options(out, count, span_m, force, json)))


@app.command()
def demo(
    host: Annotated[str, typer.Option(help="address to serve at; the default is reachable only from this machine")] = "127.0.0.1",
    port: Annotated[int, typer.Option(help="port; 0 for any free port")] = 8000,
    model: Annotated[Path | None, typer.Option("--model", help="trained model; default: the one trained last")] = None,
    device: Device = "cpu",
    store: Store = None,
) -> None:
    """Serve a local web page that predicts hand regions for an image and a task."""
    from commands.demo import demo as serve

    raise typer.Exit(serve(host, port, model, device, store))


@app.command()
def stale(target: Target = None, source: SourceDir = None, clip: Clips = None, set_: Sets = None, params: ParamsFile = None,
          only: Annotated[str | None, typer.Option(help="one stage, as `run --only` would run it")] = None,
          force: Annotated[list[str] | None, typer.Option(help="as if this stage were forced (repeatable)")] = None,
          store: Store = None, remote: Remote = None, json: Json = False) -> None:  # fmt: skip
    """List what a run would execute now: a line for each stage and reason."""
    from commands.history import stale as show

    raise typer.Exit(show(_request(target, source, clip, set_, params, store, json, only=only, force=force, remote=remote)))


def _request(target: str | None, source: Path | None, clip: list[str] | None, set_: list[str] | None, params: Path | None,
             store: Path | None, json: bool, **more: Any) -> Any:  # fmt: skip
    from commands.run import Request

    force = tuple(more.pop("force", None) or ())
    return Request(target, source, tuple(clip or ()), tuple(set_ or ()), params, store=store, json=json, force=force, **more)


STOPPED = "stopped; finished results are kept, run again to continue\n"


def main(targets: Mapping[str, str], build: Callable[..., Any], arguments: list[str] | None = None) -> int:
    """Run a command on these targets, whose graphs `build` builds; return its exit code.

    0 success, 1 a failure, 2 a usage error, 130 stopped by the user, 143 by SIGTERM.
    """
    use(targets, build)
    try:
        with terminating():
            return int(_command(targets)(arguments, standalone_mode=False) or 0)  # typer.Exit becomes the return value
    except KeyboardInterrupt:
        sys.stderr.write(STOPPED)
        return 130
    except SystemExit as ended:
        if ended.code != TERMINATED:
            raise
        sys.stderr.write(STOPPED)
        return TERMINATED
    except Exception as error:
        return _exit_code(error)


def _command(targets: Iterable[str]) -> Any:
    """Command with all verbs, and the names of the targets in their help."""
    names = " or ".join(", ".join(targets).rsplit(", ", 1))
    command: Any = typer.main.get_command(app)
    for param in (param for verb in command.commands.values() for param in verb.params):
        param.help = (getattr(param, "help", None) or "").replace(NAMED, names)
    return command


def _exit_code(error: Exception) -> int:
    """Print the error in one sentence and return the exit code; re-raise unexpected errors.

    The runner's errors are imported late to keep start-up fast.
    """
    from runner import NothingOptionalError, StoreError, UnknownNameError, UnknownShardError

    if isinstance(error, (UsageError, UnknownNameError, UnknownShardError, NothingOptionalError, StoreError)):
        sys.stderr.write(f"error: {error}\n")
        return 1 if isinstance(error, StoreError) else 2
    if not hasattr(error, "exit_code"):  # click's own usage errors carry one
        raise error
    show = getattr(error, "show", None)
    if show:
        show()
    return int(error.exit_code)
