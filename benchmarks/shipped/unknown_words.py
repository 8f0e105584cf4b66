"""Measure what names that the shipped two-hand model does not know cost, on stills; writes docs/twohands/predict.md.

    PYTHONPATH=. python benchmarks/shipped/unknown_words.py --cases DIR [--store DIR]

--cases: stills, such as those of `run benchmark-set`. Things of their tasks are renamed to words that no other stands in for, then
left out.
"""

from __future__ import annotations

import argparse
import json
import random
import shutil
import tempfile
from collections.abc import Callable
from functools import partial
from pathlib import Path

from afford.common.files import tree
from afford.models.shipped import FOLDER, TWO_HANDS, shipped_files
from afford.twohands.model.model_folder import find_model
from afford.twohands.model.stand_ins import unknown_words
from benchmarks.pages import into
from benchmarks.shipped.looks import GROUPS, MEASURES, PAGE
from benchmarks.shipped.score import run, two_hands
from commands.session import digester, open_runner

SELF = f"shipped/{Path(__file__).name}"
STRANGE = ("onion", "tomato", "sponge", "cheese", "garlic", "towel", "napkin", "leaf")
PARTICLES = ("up", "down", "on", "off", "away")
SEED = 5


def verb(task: str) -> str:
    """First word of a task, with the particle behind it."""
    words = task.split()
    return " ".join(words[: 2 if len(words) > 1 and words[1] in PARTICLES else 1])


def rewrite(folder: Path, change: Callable[[str], str]) -> None:
    """Change the task of every case."""
    for path in sorted(folder.glob("*/*/*/annotation.json")):
        case = json.loads(path.read_text())
        case["narration"] = change(case["narration"])
        path.write_text(json.dumps(case, indent=1) + "\n")


def main() -> None:
    """Measure, then write."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--cases", type=Path, required=True)
    parser.add_argument("--store", type=Path)
    args = parser.parse_args()
    runner, draw = open_runner(args.store), random.Random(SEED)
    model = shipped_files(TWO_HANDS, digester(runner))
    if model is None:
        raise SystemExit(f"weights/{TWO_HANDS}: no shipped model there; run benchmarks/shipped/ship.py {TWO_HANDS}")
    if known := set(STRANGE) - set(unknown_words(find_model(FOLDER / TWO_HANDS), " ".join(STRANGE)) or ()):
        raise SystemExit(f"the model knows {', '.join(sorted(known))}; take other words")
    changes: dict[str, Callable[[str], str]] = {
        "as they are": str, "unknown name": lambda task: f"{verb(task)} {draw.choice(STRANGE)}", "no name": verb,
    }  # fmt: skip
    lines = [["words", *GROUPS.values()], ["---", *["--:"] * len(GROUPS)]]
    for title, change in changes.items():
        with tempfile.TemporaryDirectory() as scratch:
            folder = Path(shutil.copytree(args.cases, Path(scratch) / "cases"))
            rewrite(folder, change)
            found = run(runner, "benchmark", partial(two_hands, model=model, cases=tree("cases", folder)))
        lines.append([title, *(" / ".join(f"{found[f'{group}small.{name}']:.3f}" for name in MEASURES) for group in GROUPS)])
    into(PAGE, "unknown words", SELF, "".join(f"| {' | '.join(line)} |\n" for line in lines))


if __name__ == "__main__":
    main()
