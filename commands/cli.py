"""The command line: which verbs there are, and what they take. What they do is in the other files of this room."""

from __future__ import annotations

import sys
import tomllib
from collections.abc import Callable, Iterable, Mapping
from pathlib import Path
from typing import Annotated, Any

import typer

from commands.errors import UsageError
from commands.targets import use
from runner.signals import TERMINATED, terminating

app = typer.Typer(no_args_is_help=True, add_completion=False, pretty_exceptions_enable=False, rich_markup_mode="rich")

NAMED = "TARGETS"
"""in a help text: what `main` sets the names of the targets for"""
Target = Annotated[str | None, typer.Argument(help=f"{NAMED}; default: dataset, or the first that has the stage of --only",
                                              show_default=False)]  # fmt: skip
Wanted = Annotated[str | None, typer.Argument(help=f"{NAMED}; or a stage; default: dataset", show_default=False)]
Drawn = Annotated[str | None, typer.Argument(help=f"{NAMED}; default: dataset", show_default=False)]
SourceDir = Annotated[Path | None, typer.Option("--source", help="EPIC root, videos, meshes, RGB-D, pictures; default: rendered")]
Clips = Annotated[list[str] | None, typer.Option("--clip", help="only this clip (again for more)")]
Sets = Annotated[list[str] | None, typer.Option("--set", help="STAGE.PARAM=VALUE (again for more)")]
ParamsFile = Annotated[Path | None, typer.Option("--params", help="TOML or JSON, one table per stage")]
Store = Annotated[Path | None, typer.Option("--store", help="where everything is kept; default: artifacts/")]
Model = Annotated[Path | None, typer.Option("--model", help="folder of a trained model; default: the one trained last")]
Device = Annotated[str, typer.Option(help="cpu or cuda")]
Json = Annotated[bool, typer.Option("--json", help="one JSON object as the last line")]


def _print_version(wanted: bool) -> None:
    """The version that pyproject.toml states, and no more."""
    if wanted:
        project = tomllib.loads((Path(__file__).resolve().parent.parent / "pyproject.toml").read_text(encoding="utf-8"))["project"]
        typer.echo(f"{project['name']} {project['version']}")
        raise typer.Exit


@app.callback()
def _top(
    version: Annotated[bool, typer.Option("--version", is_eager=True, callback=_print_version, help="print the version")] = False,
) -> None:
    """From video of people to where each hand goes on an object: one content-hashed pipeline."""


@app.command()
def run(
    target: Target = None,
    source: SourceDir = None,
    clip: Clips = None,
    set_: Sets = None,
    params: ParamsFile = None,
    only: Annotated[str | None, typer.Option(help="run one stage, by its name or that of its file, on its last inputs, and record "
                                             "it; says when they are stale, and makes them where it never ran")] = None,
    record: Annotated[bool | None, typer.Option("--record/--no-record", help="with --only: record what the stage made; default: "
                                                "yes", show_default=False)] = None,
    force: Annotated[list[str] | None, typer.Option(help="run this stage even if cached (again for more)")] = None,
    jobs: Annotated[int | None, typer.Option(help="worker processes; default: one per core; 0: none")] = None,
    minutes: Annotated[float | None, typer.Option(min=0, help="after so long, leave rows of a table for the next run; inf: never; "
                                                  "default: never, of grasp-full and sor3d-ablation 75")] = None,
    store: Store = None,
    dry_run: Annotated[bool, typer.Option("--dry-run", help="show what would run, and why")] = False,
    rehash: Annotated[bool, typer.Option(help="read every source file again")] = False,
    replace: Annotated[bool, typer.Option("--replace", help="let an output of some clips alone, or without those that failed, take "
                                          "the place of the whole one; default: it is named <name>-part")] = False,
    json: Json = False,
) -> None:
    """Make a target. What was made before from the same code, parameters and inputs is not made again."""
    request = _request(target, source, clip, set_, params, store, json, only=only, force=force, jobs=jobs, rehash=rehash,
                       minutes=minutes, replace=replace, record=record)
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
    """What would become of a source: clips, masks, contacts, narrations, warnings, refusals. Nothing is written."""
    from commands.check import check as look

    raise typer.Exit(look(folder, tuple(clip or ()), tuple(set_ or ()), json))


@app.command()
def status(target: Wanted = None, source: SourceDir = None, set_: Sets = None, params: ParamsFile = None,
           store: Store = None, json: Json = False) -> None:  # fmt: skip
    """How much of a target, or of a stage, is made, and what failed."""
    from commands.store import status as show

    raise typer.Exit(show(_request(target, source, None, set_, params, store, json)))


@app.command()
def explain(
    stage: Annotated[str | None, typer.Argument(help="a stage, by its name or that of its file; default: all")] = None,
    target: Annotated[str | None, typer.Option(help="the target it belongs to; default: the first that has it",
                                               show_default=False)] = None,
    clip: Annotated[str | None, typer.Option(help="one clip")] = None,
    source: SourceDir = None,
    set_: Sets = None,
    params: ParamsFile = None,
    store: Store = None,
    json: Json = False,
) -> None:
    """Why a stage would run, or ran the last time."""
    from commands.store import explain as show

    raise typer.Exit(show(_request(target, source, None, set_, params, store, json, only=stage), clip))


@app.command()
def graph(target: Drawn = None, source: SourceDir = None,
          out: Annotated[Path | None, typer.Option("--out", help="draw to this .svg or .png")] = None) -> None:  # fmt: skip
    """The stages of a target and what they read."""
    from commands.store import graph as show

    raise typer.Exit(show(_request(target, source, None, None, None, None, False), out))


@app.command()
def lineage(
    artifact: Annotated[str, typer.Argument(help="digest, its beginning, a path, or a stage: what it made last")],
    store: Store = None,
    json: Json = False,
) -> None:
    """What an artifact was made from, down to the files that came from outside."""
    from commands.store import lineage as show

    raise typer.Exit(show(artifact, store, json))


@app.command()
def verify(store: Store = None, json: Json = False) -> None:
    """Read everything in the store and check it; damaged blobs are set aside and made again by the next run."""
    from commands.store import verify as check

    raise typer.Exit(check(store, json))


@app.command()
def gc(
    store: Store = None,
    dry_run: Annotated[bool, typer.Option("--dry-run", help="count what would go, delete nothing")] = False,
    json: Json = False,
) -> None:
    """Delete what the last use of every clip does not reach."""
    from commands.store import gc as sweep

    raise typer.Exit(sweep(store, dry_run, json))


@app.command()
def inspect(
    paths: Annotated[list[str], typer.Argument(help="recordings, folders of them, or the digest of one artifact")],
    strict: Annotated[bool, typer.Option("--strict", help="check every checksum, index, payload and picture")] = False,
    sheet: Annotated[Path | None, typer.Option(help="draw a contact sheet to this .png")] = None,
    rerun: Annotated[bool, typer.Option("--rerun", help="open the Rerun viewer")] = False,
    save: Annotated[Path | None, typer.Option(help="write an .rrd for the Rerun viewer, layout included")] = None,
    layout: Annotated[Path | None, typer.Option(help="write a layout for Foxglove, .json")] = None,
    diff: Annotated[bool, typer.Option("--diff", help="name what differs between two recordings")] = False,
    sort: Annotated[str, typer.Option(help="order of many: name, messages, seconds, bytes or problem")] = "name",
    store: Store = None,
    json: Json = False,
) -> None:
    """What recordings hold, whether they are whole, and how they look."""
    from commands.inspect import Options
    from commands.inspect import inspect as look

    raise typer.Exit(look(paths, Options(json, strict, sheet, rerun, save, layout, diff, sort, store)))


@app.command()
def params(stage: Annotated[str | None, typer.Argument(help="a stage, or a system; default: all")] = None,
           json: Json = False) -> None:  # fmt: skip
    """Every parameter: its type, its default, what it means."""
    from commands.params import show

    raise typer.Exit(show(stage, json))


@app.command("fetch-list")
def fetch_list(
    root: Annotated[Path, typer.Argument(help="folder that the files are for; what it holds is left out of the list")],
    video: Annotated[list[str] | None, typer.Option(help="only this video, e.g. P03_101 (again for more)")] = None,
    participant: Annotated[list[str] | None, typer.Option(help="only videos of this person, e.g. P03 (again for more)")] = None,
    split: Annotated[str, typer.Option(help="only VISOR's train or val")] = "",
    kind: Annotated[list[str] | None, typer.Option("--with", help="tables, sparse, dense, key-frames, frames or videos (again "
                                                   "for more); default: tables, sparse, frames")] = None,
    json: Json = False,
) -> None:
    """What of EPIC-KITCHENS and VISOR is still to be downloaded into a folder, as a list for a downloader. Nothing is fetched."""
    from commands.fetch_list import Subset
    from commands.fetch_list import fetch_list as show

    subset = Subset(tuple(video or ()), tuple(participant or ()), split, *([tuple(kind)] if kind else []))
    raise typer.Exit(show(root, subset, json))


@app.command()
def backends(
    stage: Annotated[str | None, typer.Argument(help="a stage; default: all")] = None,
    set_: Sets = None,
    params: ParamsFile = None,
    out: Annotated[Path | None, typer.Option("--out", help="write the table between the marks of this page")] = None,
    json: Json = False,
) -> None:
    """Every backend: what it does, what it needs, whether it can be used here, and why not."""
    from commands.backends import show

    raise typer.Exit(show(stage, set_ or (), params, json, out))


@app.command()
def export(
    format: Annotated[str, typer.Argument(help="2hands, coco, webdataset (from a data set) or epic (from rendered clips)")],
    folder: Annotated[Path, typer.Argument(help="where to write; must be empty or new")],
    source: SourceDir = None,
    store: Store = None,
) -> None:
    """Write the last data set, or the rendered clips, in another format."""
    from commands.export import export as write

    raise typer.Exit(write(format, folder, source, store))


@app.command()
def predict(
    image: Annotated[Path, typer.Argument(help="an image, a video, or a folder of them; sor3d: or of a sequence's frames")],
    out: Annotated[Path, typer.Option("--out", help="where to write; new, empty, or what this verb wrote before")],
    task: Annotated[str, typer.Argument(help="what is to be done: \"pour tea from kettle\"; none for sor3d")] = "",
    model: Annotated[Path | None, typer.Option("--model", help="folder of a trained model, or sor3d: the one that `run sor3d` "
                                               "trained last; default: the two-hand model trained last")] = None,
    hands: Annotated[str, typer.Option(help="auto (the model chooses), left, right or both")] = "auto",
    threshold: Annotated[float | None, typer.Option(help="probability of a region's pixels; default: the model's")] = None,
    all_hypotheses: Annotated[bool, typer.Option("--all-hypotheses", help="write the mask of every hypothesis too")] = False,
    every: Annotated[int, typer.Option(help="of a video, every n-th frame")] = 10,
    batch: Annotated[int | None, typer.Option(help="pictures at once; default: 1, on a GPU 8")] = None,
    device: Device = "cpu",
    force: Annotated[bool, typer.Option("--force", help="write into a folder that holds other files")] = False,
    depth: Annotated[Path | None, typer.Option(help="sor3d: depth, PNG of 16 bits in mm, .npy in m, or a folder")] = None,
    intrinsics: Annotated[Path | None, typer.Option(help="sor3d: camera as JSON: fx, fy, cx, cy, or K")] = None,
    focal_px: Annotated[float | None, typer.Option(help="sor3d: instead, focal length of the picture; default: a Kinect's")] = None,
    rate_hz: Annotated[float, typer.Option(help="sor3d: frames a second that are taken from a video")] = 10.0,
    frames: Annotated[int, typer.Option(help="sor3d: frames at most, the last ones")] = 10,
    store: Store = None,
    json: Json = False,
) -> None:
    """Where the hands go for a task, or (sor3d) what affords what: masks, an overlay and a JSON object for every picture."""
    from commands import predict as image_model
    from commands import predict_sequence as sequence_model

    options = image_model.Options(out, model, hands, threshold, all_hypotheses, every, batch, device, force, store, json, depth,
                                  intrinsics, focal_px, rate_hz, frames)  # fmt: skip
    verb = sequence_model if sequence_model.is_sequence_model(model) else image_model
    raise typer.Exit(verb.predict(image, task, options))


@app.command()
def grasp(
    depth: Annotated[Path, typer.Argument(help="depth picture: PNG of 16 bits in millimetres, or .npy in metres")],
    out: Annotated[Path, typer.Option("--out", help="where to write; new, empty, or what this verb wrote before")],
    masks: Annotated[Path | None, typer.Option(help="folder of a picture that `predict` wrote")] = None,
    left: Annotated[Path | None, typer.Option(help="mask of the left hand's region, .png")] = None,
    right: Annotated[Path | None, typer.Option(help="mask of the right hand's region, .png")] = None,
    image: Annotated[Path | None, typer.Option(help="the colour picture, for the overlay")] = None,
    intrinsics: Annotated[Path | None, typer.Option(help="camera as JSON: fx, fy, cx, cy, or K")] = None,
    focal_px: Annotated[float | None, typer.Option(help="instead: focal length, its centre that of the picture")] = None,
    negative: Annotated[Path | None, typer.Option(help="what no hand may touch: mask .png, points .npy, negative.json")] = None,
    object_pose: Annotated[Path | None, typer.Option(help="T_cam_obj as JSON, for negative.json")] = None,
    taxonomy: Annotated[str, typer.Option(help="left, right, both_same or both_different; default: the prediction's")] = "",
    hands: Annotated[str, typer.Option(help="auto (the taxonomy chooses), left, right or both")] = "auto",
    count: Annotated[int, typer.Option(help="grasps of each hand")] = 10,
    span_m: Annotated[float, typer.Option(help="the widest that the hand spans")] = 0.09,
    force: Annotated[bool, typer.Option("--force", help="write into a folder that holds other files")] = False,
    json: Json = False,
) -> None:
    """From masks and depth to grasps: poses of one or two hands, best first."""
    from afford.grasping.candidates.read_scene import SceneFiles
    from commands.grasp import Options
    from commands.grasp import grasp as find

    files = SceneFiles(depth, masks, left, right, image, intrinsics, focal_px, negative, object_pose, taxonomy, hands)
    raise typer.Exit(find(files, Options(out, count, span_m, force, json)))


@app.command()
def demo(
    host: Annotated[str, typer.Option(help="address to serve at; the default is reached from this machine alone")] = "127.0.0.1",
    port: Annotated[int, typer.Option(help="0 takes any that is free")] = 8000,
    model: Model = None,
    device: Device = "cpu",
    store: Store = None,
) -> None:
    """A page where one drops an image, types a task and sees both hands' regions."""
    from commands.demo import demo as serve

    raise typer.Exit(serve(host, port, model, device, store))


def _request(target: str | None, source: Path | None, clip: list[str] | None, set_: list[str] | None, params: Path | None,
             store: Path | None, json: bool, **more: Any) -> Any:  # fmt: skip
    from commands.run import Request

    force = tuple(more.pop("force", None) or ())
    return Request(target, source, tuple(clip or ()), tuple(set_ or ()), params, store=store, json=json, force=force, **more)


STOPPED = "stopped; what was finished is kept, run again to go on\n"


def main(targets: Mapping[str, str], build: Callable[..., Any], arguments: list[str] | None = None) -> int:
    """Run a command on these targets, whose graphs `build` makes; 0 done, 1 something failed, 2 the call does not fit, 130 stopped
    by the user, 143 by SIGTERM.
    """
    use(targets, build)
    try:
        with terminating():
            return int(_command(targets)(arguments, standalone_mode=False) or 0)  # typer.Exit ends as the value that it returns
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
    """The verbs, with the names of the targets in their help."""
    names = " or ".join(", ".join(targets).rsplit(", ", 1))
    command: Any = typer.main.get_command(app)
    for param in (param for verb in command.commands.values() for param in verb.params):
        param.help = (getattr(param, "help", None) or "").replace(NAMED, names)
    return command


def _exit_code(error: Exception) -> int:
    """Say what went wrong in one sentence; what nobody foresaw is raised again. Nobody waits for the runner's errors before."""
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
