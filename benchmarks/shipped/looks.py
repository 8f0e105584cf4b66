"""Measure what looks and mirror images cost and give, out of the shipped two-hand model; writes docs/twohands/predict.md.

    PYTHONPATH=. python benchmarks/shipped/looks.py --cases DIR [--photographs DIR] [--store DIR]

--cases: stills, such as those of `run benchmark-set`; --photographs: those of `benchmarks/shipped/outlined.py`. Times are of one
thread of the CPU, for the pictures of the demo, in turns: run on an idle machine.
"""

from __future__ import annotations

import argparse
import statistics
import tempfile
import time
from collections.abc import Iterator
from functools import partial
from pathlib import Path
from typing import NamedTuple

from afford.common.files import tree
from afford.common.image_files import read_image
from afford.models.shipped import FOLDER, TWO_HANDS, shipped_files
from afford.twohands.demo.examples import EXAMPLES
from afford.twohands.model.predictor import Predictor
from benchmarks.pages import ROOT, into
from benchmarks.shipped.outlined import write_cases
from benchmarks.shipped.score import run, two_hands
from commands.session import digester, open_runner
from schemas.files import FileTree

SELF, PAGE = f"shipped/{Path(__file__).name}", ROOT / "docs" / "twohands" / "predict.md"
TURNS = 9
GROUPS = {"all.": "crops", "masks.all.": "whole pictures"}
MEASURES = ("iou", "precision")


class Way(NamedTuple):
    """One way to predict."""

    title: str
    looks: int
    mirror: bool


WAYS = (Way("as it is", 2, True), Way("one look", 1, True), Way("no mirror image", 2, False), Way("`--quick`: neither", 1, False))


def cpu_ms() -> dict[Way, float]:
    """Median CPU milliseconds of a picture, for each way."""
    pictures = [(read_image(path), path.stem.replace("-", " ")) for path in sorted((FOLDER / TWO_HANDS / EXAMPLES).glob("*.jpg"))]
    predictors = {mirror: Predictor(FOLDER / TWO_HANDS, mirror=mirror) for mirror in (True, False)}
    found: dict[Way, list[float]] = {way: [] for way in WAYS}
    for _ in range(TURNS):
        for way in WAYS:
            began = time.process_time()
            for image, task in pictures:
                predictors[way.mirror].predict(image, task, looks=way.looks)
            found[way].append(1000 * (time.process_time() - began) / len(pictures))
    return {way: statistics.median(times[1:]) for way, times in found.items()}  # the first turn is a warm-up


def rows(sets: dict[str, FileTree], store: Path | None) -> Iterator[list[str]]:
    """Rows of the table: head, then ways."""
    runner = open_runner(store)
    model = shipped_files(TWO_HANDS, digester(runner))
    if model is None:
        raise SystemExit(f"weights/{TWO_HANDS}: no shipped model there; run benchmarks/shipped/ship.py {TWO_HANDS}")
    times = cpu_ms()
    yield ["", "CPU ms", *(f"{name}, {group}" for name in sets for group in GROUPS.values())]
    for way in WAYS:
        cells = list[str]()
        for cases in sets.values():
            build = partial(two_hands, model=model, cases=cases, looks=way.looks, mirror=way.mirror)
            found = run(runner, "benchmark", build)
            cells += [" / ".join(f"{found[f'{prefix}small.{name}']:.3f}" for name in MEASURES) for prefix in GROUPS]
        yield [way.title, f"{times[way]:.0f}", *cells]


def main() -> None:
    """Measure, then write."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--cases", type=Path, required=True)
    parser.add_argument("--photographs", type=Path)
    parser.add_argument("--store", type=Path)
    args = parser.parse_args()
    sets = {"stills": tree("cases", args.cases.absolute())}
    with tempfile.TemporaryDirectory() as folder:
        if args.photographs:
            write_cases(args.photographs, Path(folder))
            sets["photographs"] = tree("cases", Path(folder))
        head, *body = rows(sets, args.store)
    lines = [head, ["---", *["--:"] * (len(head) - 1)], *body]
    into(PAGE, "looks", SELF, "".join(f"| {' | '.join(line)} |\n" for line in lines))


if __name__ == "__main__":
    main()
