"""Train two-hand models on the pictures of one renderer, test them on those of another; writes benchmarks/two_hands_renderers.md.

    python install/cycles.py                                                       # once, for cycles
    PYTHONPATH=. python benchmarks/two_hands_renderers.py render [--work DIR] [--photographs DIR] [--rooms N]
    PYTHONPATH=. python benchmarks/two_hands_renderers.py train  [--work DIR] [--device cuda] [--only NAME,...] [--at-once N]
    PYTHONPATH=. python benchmarks/two_hands_renderers.py score  [--work DIR]

Scenes and masks are the same with both renderers. `composite` shows the objects of the cases before photographs of rooms: what is
cut out is the meant object alone. Pictures, models and figures stay in DIR, so that each part can be stopped and run again; the
models can be trained on another machine with a copy of DIR.
"""

from __future__ import annotations

import argparse
import shutil
import subprocess
import sys
from collections.abc import Iterable, Iterator
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import cv2
import numpy as np

from afford.common.files import tree
from schemas.files import FileTree

ROOT = Path(__file__).resolve().parent.parent
PAGE = ROOT / "benchmarks" / "two_hands_renderers.md"
RENDERERS = ("raster", "cycles")
TESTS = (*RENDERERS, "composite")
SEEDS = 3
SHARES = {"raster": ("raster",), "cycles": ("cycles",), "both": RENDERERS}
"""name of a training set -> renderers of its pictures"""
TRAININGS = {"small": ("raster",), "lite": ("raster", "cycles", "both")}
SIZES = {"small": (128, 160), "lite": (192, 256)}
"""height and width of the input of each variant"""
GROUPS = (("", "kitchens"), ("known.", "kinds shown"), ("new.", "kinds never shown"), ("shift.", "workshop, desk"))
MEASURES = (("iou", "IoU"), ("first_mode_iou", "first mode"), ("precision", "precision"))


@dataclass(frozen=True)
class Training:
    """A training of the table."""

    variant: str
    data: str
    seed: int

    @property
    def name(self) -> str:
        """Folder of its model."""
        return f"{self.variant}-{self.data}-{self.seed}"


def trainings() -> list[Training]:
    """List the trainings, seed by seed."""
    return [Training(variant, data, seed) for seed in range(SEEDS) for variant, sets in TRAININGS.items() for data in sets]


def render(args: argparse.Namespace) -> None:
    """Render the stills of both renderers, and compose the third set of cases."""
    from benchmarks.pages import make

    for name in RENDERERS:
        extra = ("--set", f"still_render.photographs={args.photographs}") if args.photographs and name == "cycles" else ()
        sets = ("--set", f"still_render.backend={name}", *extra)
        for target, output, kind in (("benchmark-set", "benchmark", "cases"), ("train-set", "dataset", "sets")):
            rooms = ("--set", f"train_plan.rooms={args.rooms}") if kind == "sets" else ()
            found = make(target, str(args.work / "store"), *sets, *rooms)
            shutil.rmtree(args.work / kind / name, ignore_errors=True)
            shutil.copytree(found["outputs"][output], args.work / kind / name)
    compose(args.work / "cases" / "raster", args.work / "cases" / "composite", args.backgrounds)


def compose(cases: Path, out: Path, backgrounds: Path) -> None:
    """Copy cases with all but the meant objects replaced by photographs. SystemExit without photographs."""
    photographs = sorted(path for path in backgrounds.rglob("*") if path.suffix in (".jpg", ".png"))
    if not photographs:
        raise SystemExit(f"{backgrounds}: expected photographs; run benchmarks/hands/photographs.py")
    shutil.rmtree(out, ignore_errors=True)
    shutil.copytree(cases, out)
    for number, path in enumerate(sorted(out.rglob("inpainting.png"))):
        rng = np.random.default_rng(number)
        cv2.imwrite(str(path), composite(path, cv2.imread(str(photographs[rng.integers(len(photographs))])), rng))


def composite(path: Path, photograph: np.ndarray, rng: np.random.Generator) -> np.ndarray:
    """Meant objects of a case (h, w, 3) uint8 before a random part of a photograph, with soft edges and its mean light."""
    image = cv2.imread(str(path))
    files = [found for side in ("left", "right") if (found := path.with_name(f"obj_{side}.png")).is_file()]
    masks = [cv2.resize(cv2.imread(str(file), cv2.IMREAD_GRAYSCALE), image.shape[1::-1]) for file in files]
    inside = np.max([np.zeros(image.shape[:2], np.uint8), *masks], axis=0)
    scale = max(image.shape[0] / photograph.shape[0], image.shape[1] / photograph.shape[1]) * rng.uniform(1, 1.6)
    large = cv2.resize(photograph, None, fx=scale, fy=scale, interpolation=cv2.INTER_AREA if scale < 1 else cv2.INTER_LINEAR)
    top, left = (rng.integers(0, max(have - want, 0) + 1) for have, want in zip(large.shape, image.shape[:2], strict=False))
    behind = cv2.resize(large[top : top + image.shape[0], left : left + image.shape[1]], image.shape[1::-1])
    share = cv2.GaussianBlur((inside > 0).astype(np.float32), (0, 0), 0.8)[..., None]
    light = np.clip(behind.mean() / max(image[inside > 0].mean(), 1), 0.7, 1.3) if inside.any() else 1.0
    mixed: np.ndarray = np.clip(image * light * share + behind * (1 - share), 0, 255).astype(np.uint8)
    return mixed


def train(args: argparse.Namespace) -> None:
    """Train what is asked for and not there yet, `at_once` processes at a time."""
    wanted = [one for one in trainings() if not args.only or one.name in args.only]
    missing = [one for one in wanted if not (args.work / "models" / one.name / "config.json").is_file()]
    if args.at_once == 1:
        for one in missing:
            train_one(one, args)
        return
    train_each([one.name for one in missing], __file__, args)


def train_each(names: list[str], script: str, args: argparse.Namespace, *more: object) -> None:
    """Train each by `script train --only NAME` in a process of its own, `at_once` at a time. SystemExit names those that failed."""
    command = [sys.executable, script, "train", "--work", args.work, "--device", args.device, "--steps", args.steps,
               "--encoder", args.encoder, *more, "--only"]  # fmt: skip
    with ThreadPoolExecutor(args.at_once) as pool:
        codes = list(pool.map(lambda name: subprocess.run([str(part) for part in (*command, name)]).returncode, names))
    if any(codes):
        raise SystemExit(f"these trainings failed: {', '.join(name for name, code in zip(names, codes, strict=True) if code)}")


@dataclass(frozen=True)
class Here:
    """Context of a stage that runs without a runner."""

    scratch: Path

    def progress(self, done: int, total: int) -> None:
        """Print every hundredth step."""
        if done % 100 == 0:
            print(f"{self.scratch.name} {done} of {total}", flush=True)


def train_one(one: Training, args: argparse.Namespace) -> None:
    """Train one model of the table."""
    from stages.twohands import model_train

    height, width = SIZES[one.variant]
    params = model_train.Params(
        variant=one.variant, hypotheses=1, height_px=height, width_px=width, seed=one.seed, steps=args.steps, device=args.device,
        validate_every=max(args.steps // 3, 1), backbones=str(args.encoder) if one.variant == "lite" else "")  # fmt: skip
    sets = [tree(name, args.work / "sets" / name) for name in SHARES[one.data]]
    train_into(args.work, one.name, joined(sets), params)


def train_into(work: Path, name: str, dataset: FileTree, params: Any) -> None:
    """Train a model in scratch files, then move it to `work`/models/`name`."""
    from stages.twohands import model_train

    scratch, part = work / "scratch" / name, work / "models" / f"{name}.part"
    scratch.mkdir(parents=True, exist_ok=True)
    made = model_train.run(dataset, params, Here(scratch)).files
    shutil.rmtree(part, ignore_errors=True)
    for file in made.files:
        if file.name.startswith("model/"):
            place = part / file.name.removeprefix("model/")
            place.parent.mkdir(parents=True, exist_ok=True)
            shutil.copyfile(file.path, place)
    part.rename(work / "models" / name)
    shutil.rmtree(scratch)


def joined(sets: list[FileTree]) -> FileTree:
    """Join data sets: files of the first, and samples of the others."""
    more = (replace(file, name=f"more{n}/{file.name}") for n, each in enumerate(sets[1:], 1) for file in each.files
            if file.name.endswith(".parquet"))  # fmt: skip
    return FileTree(sets[0].name, tuple(sorted((*sets[0].files, *more), key=lambda file: file.name)))


def score(args: argparse.Namespace) -> None:
    """Score all models that are there on the crops of all cases, and write the page."""
    from benchmarks.shipped.score import run
    from commands.session import open_runner

    runner, found = open_runner(args.work / "store"), {}
    for one in trainings():
        if not (args.work / "models" / one.name).is_dir():
            continue
        model = tree("model", args.work / "models" / one.name)
        for test in args.tests:
            cases = crops(args.work / "cases" / test)
            found[one, test] = run(runner, "benchmark", lambda g, m=model, c=cases, t=test: scored(g, m, c, t))
    if args.tests == list(TESTS):
        PAGE.write_text(page(found))


def crops(folder: Path) -> FileTree:
    """Cases of a set of stills without its whole pictures."""
    return FileTree("cases", tuple(file for file in tree("cases", folder).files if not file.name.startswith("masks/")))


def scored(g: Any, model: FileTree, cases: FileTree, test: str) -> FileTree:
    """Score a model with right words, on path-traced stills also with wrong ones, one pass a picture, and a Gaussian."""
    from maps.settings import Settings
    from stages.twohands import baseline_cases, benchmark, predict_cases, score_cases

    p, shown = Settings().twohands, g.leaf("cases", cases)
    once = replace(p.predict_cases, mirror=False, looks=1)
    wrong = replace(once, name="small_text_shuffled", text="shuffled")
    files = g.leaf("model", model)
    answers = [g.named(f"predict_{way.text}").add(predict_cases.run, cases=shown, model=files, params=way, ctx=g.ctx)
               for way in ((once, wrong) if test == "cycles" else (once,))]  # fmt: skip
    answers.append(g.named("baseline_centre").add(
        baseline_cases.run, cases=shown, dataset=g.leaf("no_dataset", FileTree("none", ())), ctx=g.ctx,
        params=replace(p.baseline_cases, backend="centre")))  # fmt: skip
    scores = [g.named(f"score_{n}").add(score_cases.run, cases=shown, predictions=each, params=p.score_cases)
              for n, each in enumerate(answers)]  # fmt: skip
    made: FileTree = g.add(benchmark.run, scores=tuple(scores), others=g.leaf("others", ()), params=p.benchmark, ctx=g.ctx)
    return made


Found = dict[tuple[Training, str], Any]


def page(found: Found) -> str:
    """Write the Markdown page."""
    seeds = {one.seed for one, _ in found}
    text = (
        f"Written by `benchmarks/two_hands_renderers.py`; mean and standard deviation over {len(seeds)} trainings, one hypothesis "
        "a hand. `both` has the pictures of both renderers, twice as many. Strict measures of held-out rooms, crops "
        "(docs/twohands/benchmark.md). `composite`: the meant object of a fast still, cut out, before a photograph. `Gaussian` is "
        "a region in the middle of the picture; `wrong words` are those of another case. One pass a picture, without its mirror "
        "image or a second look, weights as half floats.")  # fmt: skip
    lines = [line for test in TESTS for line in table(found, test)]
    return "\n".join(["# Two-hand models between renderers", "", text, *lines, ""])


def table(found: Found, test: str) -> Iterator[str]:
    """Lines of the table of one set of cases."""
    titles = [f"{group}: {title}" for _, group in GROUPS for _, title in MEASURES] + ["wrong words: IoU"]
    yield from ("", f"## Tested on {test}", "", f"| model | trained on | {' | '.join(titles)} |")
    yield f"|---|---|{'--:|' * len(titles)}"
    rows = dict.fromkeys((one.variant, one.data) for one, _ in found)
    for variant, data in rows:
        runs = [run for (one, tested), run in found.items() if (one.variant, one.data, tested) == (variant, data, test)]
        yield f"| {variant} | {data} | {' | '.join(cells(runs, 'small'))} |"
    yield f"| Gaussian | | {' | '.join(cells([run for (_, tested), run in found.items() if tested == test][:1], 'centre'))} |"


def cells(runs: Iterable[dict[str, float]], method: str) -> list[str]:
    """Cells of a row: every measure of every group, and the IoU with wrong words."""
    names = [f"{prefix}{method}.{measure}" for prefix, _ in GROUPS for measure, _ in MEASURES] + [f"{method}_text_shuffled.iou"]
    return [cell([run[name] for run in runs if name in run]) for name in names]


def cell(values: list[float]) -> str:
    """Mean and standard deviation; '' where nothing was measured."""
    if not values:
        return ""
    return f"{np.mean(values):.3f}" + (f" ± {np.std(values, ddof=1):.3f}" if len(values) > 1 else "")


def main() -> None:
    """Do the part that is asked for."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("part", choices=("render", "train", "score"))
    parser.add_argument("--work", type=lambda text: Path(text).absolute(), default=ROOT.parent / "renderers")
    parser.add_argument("--photographs", type=lambda text: Path(text).absolute(), help="surfaces, for cycles")
    parser.add_argument("--backgrounds", type=lambda text: Path(text).absolute(), default=ROOT.parent / "photographs" / "scene")
    parser.add_argument("--rooms", type=int, default=24, help="training rooms of each renderer")
    parser.add_argument("--steps", type=int, default=2400)
    parser.add_argument("--device", default="cpu")
    parser.add_argument("--encoder", type=lambda text: Path(text).absolute(), default=default_encoder())
    parser.add_argument("--tests", type=lambda text: text.split(","), default=list(TESTS),
                        help="score on these; all of them write the page")
    parser.add_argument("--only", type=lambda text: text.split(","), default=[])
    parser.add_argument("--at-once", type=int, default=1)
    args = parser.parse_args()
    {"render": render, "train": train, "score": score}[args.part](args)


def default_encoder() -> Path:
    """File of the image encoder that set-up fetched."""
    from afford.models.encoder_place import encoder_path

    return Path(encoder_path())


if __name__ == "__main__":
    main()
