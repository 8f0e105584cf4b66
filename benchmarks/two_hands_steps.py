"""Train two-hand models by a recipe without one step each, and test them; writes benchmarks/two_hands_steps.md.

    PYTHONPATH=. python benchmarks/two_hands_steps.py train --work DIR --data SET,... [--recipe quick] [--device cuda] [--at-once N]
    PYTHONPATH=. python benchmarks/two_hands_steps.py score --work DIR --cases NAME=FOLDER,... [--recipe quick]

SET is a folder that `run train-set` published, FOLDER one of `run benchmark-set`, its composite (`compose` of
two_hands_renderers.py), or of outlined photographs (benchmarks/shipped/outlined.py). Models stay in DIR/models, so that each part
can be stopped and run again; the models can be trained on another machine, with a copy of SETs. `quick`, the recipe of
`make train`, takes minutes on a CPU for each model, `release` much longer.
"""

from __future__ import annotations

import argparse
from collections.abc import Iterator, Mapping
from dataclasses import replace
from functools import partial
from pathlib import Path
from textwrap import wrap
from typing import Any

from afford.common.files import tree
from benchmarks.two_hands_renderers import SEEDS, cell, default_encoder, joined, train_each, train_into

Figures = Mapping[str, float]
ROOT = Path(__file__).resolve().parent.parent
PAGE = ROOT / "benchmarks" / "two_hands_steps.md"
ROWS: dict[str, dict[str, Any]] = {
    "whole": {},
    "no_classes": {"classes": False},
    "all_named": {"unnamed_share": 0.0},
    "no_noise": {"style_noise": 0.0},
    "close_crops": {"wide_share": 0.0},
    "own_background": {"pasted_share": 0.0},
    "close_and_own": {"wide_share": 0.0, "pasted_share": 0.0},
}
"""row -> parameters that differ from the recipe"""
GROUPS = (("", "crops"), ("new.", "kinds never shown"), ("shift.", "workshop, desk"), ("masks.", "whole pictures"))
MEASURES = (("small.iou", "IoU"), ("small.precision", "precision"), ("small_text_shuffled.iou", "IoU, another task's words"))


def recipe(args: argparse.Namespace) -> Any:
    """Parameters of the recipe."""
    from stages.twohands import model_train

    found = {"quick": model_train.QUICK, "release": replace(model_train.RELEASE, steps=2000, residue_share=0.4)}[args.recipe]
    steps = args.steps or found.steps
    return replace(found, steps=steps, validate_every=max(steps // 2, 1), backbones=str(args.encoder), device=args.device)


def rows(params: Any) -> dict[str, dict[str, Any]]:
    """Rows whose parameters the recipe does not have anyway, and no two with the same."""
    kept, seen = dict[str, dict[str, Any]](), list[Any]()
    for row, differs in ROWS.items():
        if (one := replace(params, **differs)) not in seen:
            kept[row] = differs
            seen.append(one)
    return kept


def train(args: argparse.Namespace) -> None:
    """Train what is asked for and not there yet, `at_once` processes at a time."""
    wanted = [f"{row}-{seed}" for seed in range(SEEDS) for row in rows(recipe(args))]
    missing = [name for name in wanted if name in (args.only or wanted) and not (args.work / "models" / name).is_dir()]
    if len(missing) == 1:
        train_one(missing[0], args)
    else:
        train_each(missing, __file__, args, "--data", ",".join(map(str, args.data)), "--recipe", args.recipe)


def train_one(name: str, args: argparse.Namespace) -> None:
    """Train one model of the table."""
    row, _, seed = name.rpartition("-")
    params = replace(recipe(args), seed=int(seed), **ROWS[row])
    train_into(args.work, name, joined([tree(one.name, one) for one in args.data]), params)


def score(args: argparse.Namespace) -> None:
    """Score all models that are there, with right and with wrong words, and write the page."""
    from benchmarks.shipped.score import run, two_hands  # not needed on a machine that trains
    from commands.session import open_runner

    runner, found = open_runner(args.work / "store"), dict[tuple[str, str, str], Figures]()
    sets = {name: tree("cases", Path(place)) for name, _, place in (one.partition("=") for one in args.cases)}
    for folder in sorted(one for one in (args.work / "models").iterdir() if one.suffix != ".part"):
        row, _, seed = folder.name.rpartition("-")
        for name, cases in sets.items():
            found[row, seed, name] = run(runner, "benchmark", partial(two_hands, model=tree("model", folder), cases=cases))
    seeds = len({seed for _, seed, _ in found})
    text = (f"Written by `benchmarks/two_hands_steps.py`: the recipe `{args.recipe}` with other parameters, mean and standard "
            f"deviation over {seeds} trainings. Kinds never shown, workshop and desk: crops; photographs count as the latter."
           )  # fmt: skip
    lines = (line for name in sets for line in table({key[:2]: one for key, one in found.items() if key[2] == name}, name))
    PAGE.write_text("\n".join(("# Two-hand models without one step each", "", *wrap(text, 132), *lines, "")))


def table(found: dict[tuple[str, str], Figures], name: str) -> Iterator[str]:
    """Yield the lines of the table of one set of cases; columns without figures are left out."""
    columns = {f"{prefix}{key}": f"{group}: {title}" for prefix, group in GROUPS for key, title in MEASURES}
    columns = {key: title for key, title in columns.items() if any(key in one for one in found.values())}
    yield from ("", f"## {name}", "", f"| | differs in | {' | '.join(columns.values())} |", f"|---|---|{'--:|' * len(columns)}")
    for row, differs in ROWS.items():
        several = [one for (other, _), one in found.items() if other == row]
        cells = (cell([one[key] for one in several if key in one]) for key in columns)
        if several:
            yield f"| {row} | {', '.join(f'{key}={value}' for key, value in differs.items())} | {' | '.join(cells)} |"


def main() -> None:
    """Do the part that is asked for."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("part", choices=("train", "score"))
    parser.add_argument("--work", type=lambda text: Path(text).absolute(), default=ROOT.parent / "steps")
    parser.add_argument("--data", type=lambda text: [Path(one).absolute() for one in text.split(",")], default=[])
    parser.add_argument("--cases", type=lambda text: text.split(","), default=[])
    parser.add_argument("--recipe", choices=("quick", "release"), default="release")
    parser.add_argument("--steps", type=int, default=0, help="default: those of the recipe, 2,000 for release")
    parser.add_argument("--device", default="cpu")
    parser.add_argument("--encoder", type=lambda text: Path(text).absolute(), default=default_encoder())
    parser.add_argument("--only", type=lambda text: text.split(","), default=[])
    parser.add_argument("--at-once", type=int, default=1)
    args = parser.parse_args()
    {"train": train, "score": score}[args.part](args)


if __name__ == "__main__":
    main()
