"""Train the models in `weights/` and write them there: float16, a card and digests for each. Also `make weights`.

    python install/cycles.py                                     # once, for the two-hand model
    PYTHONPATH=. python benchmarks/shipped/ship.py [NAME ...] [--store DIR] [--photographs DIR]
    PYTHONPATH=. python benchmarks/shipped/ship.py --check       # name the models whose code has changed since; always exit code 0
    PYTHONPATH=. python benchmarks/shipped/ship.py [NAME ...] --words      # write use, limits and data of recipes into cards
    PYTHONPATH=. python benchmarks/shipped/ship.py twohands --trained DIR --data DIR,... --where "a card, PyTorch N"
        # ship files of `model_train` that another machine trained by the recipe on these data sets

Trainings are cached and resumable. A two-hand model is calibrated afterwards, by benchmarks/shipped/calibrate.py, and then learns
what is not there, by benchmarks/shipped/presence.py. Figures of the cards are written by benchmarks/shipped/score.py, out of the
shipped files; they stay where a training made the same files again.
"""

from __future__ import annotations

import argparse
import json
import re
import subprocess
from collections.abc import Callable, Iterator
from dataclasses import asdict, replace
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import torch
from safetensors.torch import load_file, save_file
from torch import Tensor

from afford.common.files import tree
from afford.models.shipped import CARD, FOLDER, FORMAT, MEASURED, RECORD, file_digest, read_record
from benchmarks.pages import ROOT, head
from benchmarks.shipped.recipes import RECIPES, Recipe
from benchmarks.two_hands_renderers import joined
from commands.progress import observer
from commands.session import CODEC, WORKER, digester, open_runner
from runner import Graph, Runner
from runner.keys import CodeFingerprints
from runner.modules import Modules
from schemas.files import FileTree

FRONT = re.compile(r"\A---\n.*?\n---\n+", re.S)
"""front matter of a card for a hub"""
ELSEWHERE = ("device", "devices", "parallel", "workers", "backbones", "threshold", "calibration", "temperature")
"""what a machine decides, or a training sets at its end"""
CYCLES = "still_render.backend=cycles"
BESIDE, SHIPPED = ("previews/", "tensorboard/"), (".json", ".safetensors")
MAX_TOTAL_BYTES = 30_000_000
"""limit of all shipped models together"""


def codes(graph: Graph) -> dict[str, str]:
    """Stage -> digest of the code that can run behind it."""
    known = CodeFingerprints(Modules(ROOT), CODEC, WORKER)
    functions = {node.name: f"{node.value.__module__}:{node.value.__qualname__}" for node in graph.stages()}
    return {node.name: known.of(functions[node.name], node.params).digest for node in graph.stages()}


def all_codes(recipe: Recipe, digest: Callable[[Path], str]) -> dict[str, str]:
    """Digests of the code behind the training of a model and its stills."""
    dataset = FileTree("stills", ()) if recipe.stills else None
    graphs = (*recipe.still_graphs(digest), recipe.graph(digest, dataset))
    return {stage: code for graph in reversed(graphs) for stage, code in codes(graph).items()}


def run(runner: Runner, graph: Graph, target: str) -> tuple[FileTree, str, Any]:
    """Run a graph of one output; its files, their digest and the report. SystemExit where a stage failed."""
    with observer(quiet=False) as shown:
        report = runner.run(graph, target, observer=shown)
    if not report.ok:
        raise SystemExit(f"{target}: {report.failures[0]}")
    ((_, digest),) = (pairs for (pairs,) in report.outputs.values())
    return runner.load(digest), digest, report


def stale(names: list[str]) -> Iterator[tuple[str, list[str]]]:
    """Yield shipped models and the stages whose code differs from the one that made them."""
    for name in names:
        if (FOLDER / name).is_dir():
            then, now = read_record(FOLDER / name)["stages"], all_codes(RECIPES[name], lambda path: "")
            changed = sorted(stage for stage in then.keys() | now.keys() if then.get(stage) != now.get(stage))
            if changed:
                yield name, changed


def made(name: str, recipe: Recipe, runner: Runner) -> tuple[FileTree, dict[str, Any]]:
    """Train a model; its files, and the facts of its record. SystemExit where a stage failed."""
    digest = digester(runner)
    stills = [run(runner, graph, "stills")[0] for graph in recipe.still_graphs(digest)]
    graph = recipe.graph(digest, joined(stills) if stills else None)
    files, output, report = run(runner, graph, "trained")
    stage = graph.stages()[-1].name
    command = f"PYTHONPATH=. python benchmarks/shipped/ship.py {name}{' --photographs DIR' if recipe != RECIPES[name] else ''}"
    sets = [*RECIPES[name].sets, *(one for some in RECIPES[name].stills for one in some)]
    facts = {"command": command, "commit": head(), "sets": sets, "stages": all_codes(recipe, digest), "output": output,
             "keys": report.used[stage], "seed": 0}  # fmt: skip
    return files, facts


def trained_elsewhere(recipe: Recipe, folder: Path, data: list[Path], where: str) -> tuple[FileTree, dict[str, Any]]:
    """Files of a training on another machine, and the facts of its record. SystemExit where it is not that of the recipe."""
    from afford.models.encoder_place import encoder_path
    from stages.twohands.model_train import training_job

    stills, files = joined([tree("stills", one) for one in data]), tree("model", folder)
    graph = recipe.graph(file_digest, stills)
    asked = training_job(replace(graph.stages()[-1].params, backbones=str(encoder_path())))
    text = (folder / CARD).read_text(encoding="utf-8")
    done = json.loads(text.partition("```json\n")[2].partition("```")[0])
    for name in ("plan", "config"):
        done[name] = {key: value for key, value in done[name].items() if key not in ELSEWHERE}
    wanted = {name: {key: value for key, value in asdict(getattr(asked, name)).items() if key not in ELSEWHERE}
              for name in ("plan", "config", "views")}  # fmt: skip
    differ = sorted(key for name, fields in wanted.items() for key, value in fields.items()
                    if json.dumps(value) != json.dumps(done[name].get(key)))  # fmt: skip
    if differ:
        raise SystemExit(f"{folder}: expected a training by the recipe, got other values of {', '.join(differ)}")
    sets = [*recipe.sets, *(one for some in recipe.stills for one in some if "photographs" not in one)]
    facts = {"command": "PYTHONPATH=. python benchmarks/shipped/ship.py twohands --trained DIR --data DIR,...", "commit": head(),
             "sets": sets, "stages": all_codes(recipe, file_digest), "where": where, "seed": 0,
             "output": next(file.digest for file in files.files if file.name.endswith(".safetensors")),
             "keys": {file.name: file.digest for file in stills.files if file.name.endswith(".parquet")}}  # fmt: skip
    return files, facts


def paragraphs(recipe: Recipe) -> dict[str, str]:
    """Paragraphs of a card that the recipe states, by their titles."""
    return {"For": f"**For** {recipe.use}", "Limits.": f"**Limits.** {recipe.limits}", "Data.": f"**Data.** {recipe.data}"}


def card(recipe: Recipe, facts: dict[str, Any], trained: str) -> str:
    """Write the card of a model; `trained` is the one that the training wrote."""
    learned = FRONT.sub("", trained).partition("\n")[2].replace("\n## ", "\n### ").strip()
    stills = (" ".join(one for one in some if "photographs" not in one) for some in recipe.stills)
    sets = (*recipe.sets, *(one or "stills as they are" for one in stills))
    return "\n\n".join((
        f"# {recipe.title}", *paragraphs(recipe).values(),
        "**Licence** of the weights: Apache-2.0. Floats are half floats.",
        f"**Made** by `{facts['command']}` at commit `{facts['commit']}`, seed {facts['seed']}, "
        f"{'with ' + ', '.join(f'`{one}`' for one in sets) if sets else 'with the default parameters'}; "
        f"output `{facts['output'][:16]}`{', trained on ' + facts['where'] if 'where' in facts else ''}.",
        *(("## Training", learned) if learned else ()), "## Figures"))  # fmt: skip


def ship(model: Path, target: Path, card: str, made: dict[str, Any], left_out: str = "") -> None:
    """Write a shipped model from the folder of a trained one: its JSON and safetensors files, a card, and the record.

    Floats become half floats; tensors whose names begin with `left_out` are not written. Other such files of an earlier model go.
    Its figures stay where the model that is written has the same files.
    """
    before = shipped_before(target)
    names = [path.relative_to(model).as_posix() for path in sorted(model.rglob("*")) if path.suffix in SHIPPED]
    for name in names:
        (target / name).parent.mkdir(parents=True, exist_ok=True)
        if name.endswith(".json"):
            (target / name).write_bytes((model / name).read_bytes())
        else:
            save_file({key: halved(tensor) for key, tensor in load_file(model / name).items()
                       if not left_out or not key.startswith(left_out)}, target / name)
    for path in target.rglob("*"):
        if path.suffix in SHIPPED and path.relative_to(target).as_posix() not in names:
            path.unlink()
    (target / CARD).write_text(f"{card.rstrip()}\n\n{MEASURED[0]}\n{MEASURED[1]}\n", encoding="utf-8")
    write_record(target, {"format": FORMAT, **made, "files": {}}, *names, CARD)
    keep_figures(target, *before)


def shipped_before(folder: Path) -> tuple[dict[str, str], str]:
    """Digests and figures of the model that a folder has; nothing without one."""
    if not ((folder / RECORD).is_file() and (folder / CARD).is_file()):
        return {}, ""
    text = (folder / CARD).read_text(encoding="utf-8")
    return read_record(folder)["files"], text.partition(MEASURED[0])[2].partition(MEASURED[1])[0]


def keep_figures(folder: Path, files: dict[str, str], figures: str) -> None:
    """Write the figures of the model before into the card, if its files were the same."""
    if {**read_record(folder)["files"], CARD: ""} == {**files, CARD: ""}:
        text = (folder / CARD).read_text(encoding="utf-8")
        (folder / CARD).write_text(text.replace(MEASURED[0] + "\n", MEASURED[0] + figures), encoding="utf-8")


def write_record(folder: Path, record: dict[str, Any], *files: str) -> None:
    """Write the record of a shipped model, with the digests of the files that were written."""
    record["files"] |= {name: file_digest(folder / name) for name in files}
    (folder / RECORD).write_text(json.dumps(record, indent=1, sort_keys=True) + "\n", encoding="utf-8")


def reword(folder: Path, recipe: Recipe) -> None:
    """Write use, limits and data of the recipe into the card of a shipped model, and the digest of the card into its record."""
    text = (folder / CARD).read_text(encoding="utf-8")
    for title, words in paragraphs(recipe).items():
        text, count = re.subn(rf"^\*\*{title}\*\*[^\n]*", lambda _, words=words: words, text, flags=re.M)
        if count != 1:
            raise SystemExit(f"{folder / CARD}: expected one paragraph '{title}', found {count}")
    (folder / CARD).write_text(text, encoding="utf-8")
    write_record(folder, read_record(folder), CARD)


def halved(tensor: Tensor) -> Tensor:
    """Single floats as half floats; other kinds unchanged. ValueError for a number that half floats do not hold."""
    if tensor.dtype != torch.float32:
        return tensor
    half = tensor.to(torch.float16)
    if not torch.isfinite(half).all():
        raise ValueError(f"expected weights below 65504, got {float(tensor.abs().max())}")
    return half


def write(name: str, recipe: Recipe, tree: FileTree, facts: dict[str, Any]) -> int:
    """Ship the files of a training; the size of the model's folder in bytes."""
    with TemporaryDirectory() as scratch:
        for file in tree.files:
            if not file.name.startswith(f"{recipe.inside}/" if recipe.inside else "") or file.name.startswith(BESIDE):
                continue
            place = Path(scratch) / file.name.removeprefix(f"{recipe.inside}/")
            place.parent.mkdir(parents=True, exist_ok=True)
            place.write_bytes(file.path.read_bytes())
        written = tree.find(CARD)
        ship(Path(scratch), FOLDER / name, card(recipe, facts, written.path.read_text() if written else ""), facts, recipe.left_out)
    return sum(path.stat().st_size for path in (FOLDER / name).rglob("*") if path.is_file())


def main() -> None:
    """Train what is asked for, or check all."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("names", nargs="*", help=", ".join(RECIPES))
    parser.add_argument("--store", type=Path)
    parser.add_argument("--photographs", type=lambda text: Path(text).absolute(), help="photographs of surfaces, for twohands")
    parser.add_argument("--check", action="store_true")
    parser.add_argument("--words", action="store_true")
    parser.add_argument("--trained", type=Path)
    parser.add_argument("--data", type=lambda text: [Path(one) for one in text.split(",")], default=[])
    parser.add_argument("--where", default="another machine")
    parser.add_argument("--jobs", type=int)
    args = parser.parse_args()
    names = args.names or list(RECIPES)
    if args.check:
        for name, changed in stale(names):
            print(f"warning: weights/{name} was made by other code of {', '.join(changed)}; `make weights` ships it again")
        return
    if args.words:
        for name in names:
            reword(FOLDER / name, RECIPES[name])
        return
    if subprocess.run(("git", "diff", "--quiet", "HEAD"), cwd=ROOT).returncode:
        raise SystemExit("commit first: a card names the commit that made its model")
    if args.trained:
        files, facts = trained_elsewhere(RECIPES["twohands"], args.trained, args.data, args.where)
        print(f"twohands: {write('twohands', RECIPES['twohands'], files, facts) / 1e6:.1f} MB")
        return
    runner = open_runner(args.store, jobs=args.jobs)
    for name in names:
        recipe = RECIPES[name]
        if name == "twohands" and args.photographs:
            shown = (f"still_render.photographs={args.photographs}", f"tool_render.photographs={args.photographs}")
            recipe = replace(recipe, stills=tuple((*sets, *shown) if CYCLES in sets else sets for sets in recipe.stills))
        made_files = made(name, recipe, runner)
        print(f"{name}: {write(name, recipe, *made_files) / 1e6:.1f} MB", flush=True)
    total = sum(path.stat().st_size for path in FOLDER.rglob("*") if path.is_file())
    if total > MAX_TOTAL_BYTES:
        raise SystemExit(f"weights/ has {total / 1e6:.1f} MB, more than {MAX_TOTAL_BYTES / 1e6:.0f}")


if __name__ == "__main__":
    main()
