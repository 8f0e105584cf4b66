"""Score trainings of the shipped two-hand model with several seeds beside the model that was shipped before.

    PYTHONPATH=. python benchmarks/shipped/seeds.py --models DIR,DIR,DIR --before DIR --cases RASTER,CYCLES,COMPOSITE [--store DIR]

A model is a folder with config.json and model.safetensors; cases are those of `run benchmark-set` and of two_hands_renderers.py.
Writes the block `seeds` of docs/twohands/results.md.
"""

from __future__ import annotations

import argparse
from collections.abc import Sequence
from pathlib import Path

from afford.common.files import tree
from benchmarks.bench_twohands import cell
from benchmarks.pages import ROOT, into
from benchmarks.shipped.score import GROUPS, MEASURES, Figures, run
from benchmarks.two_hands_renderers import crops
from commands.session import open_runner
from maps.settings import Settings
from runner import Graph, Runner
from schemas.files import FileTree
from stages.twohands import benchmark, predict_cases, score_cases

NAME = "small"
"""method of a trained model in the report"""


def figures(runner: Runner, model: Path, cases: Path) -> Figures:
    """Figures of a model on the crops of a set of stills, prompted with the task of each case."""
    def build(g: Graph) -> FileTree:
        p = Settings().twohands
        shown, given = g.leaf("cases", crops(cases)), g.leaf("model", tree("model", model))
        said = g.add(predict_cases.run, cases=shown, model=given, params=p.predict_cases, ctx=g.ctx)
        scores = g.add(score_cases.run, cases=shown, predictions=said, params=p.score_cases)
        return g.add(benchmark.run, scores=(scores,), others=g.leaf("others", ()), params=p.benchmark, ctx=g.ctx)

    return run(runner, "benchmark", build)


def row(stills: str, group: str, title: str, found: Sequence[Figures], prefix: str) -> str:
    """Line of the table: trainings of one recipe on one group of cases."""
    return f"| {stills} | {group} | {title} | {' | '.join(cell(found, prefix + name) for name, _ in MEASURES)} | {len(found)} |"


def main() -> None:
    """Score, and write the block."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    for name in ("models", "cases"):
        parser.add_argument(f"--{name}", type=lambda text: [Path(one).absolute() for one in text.split(",")], required=True)
    parser.add_argument("--before", type=Path, required=True)
    parser.add_argument("--store", type=Path)
    args = parser.parse_args()
    runner, lines = open_runner(args.store), list[str]()
    for cases in args.cases:
        new = [figures(runner, model, cases) for model in args.models]
        for title, found in (("before", [figures(runner, args.before, cases)]), ("shipped recipe", new)):
            lines += (row(cases.name, group, title, found, f"{prefix}{NAME}.") for prefix, group in GROUPS
                      if f"{prefix}{NAME}.iou" in found[0])  # fmt: skip
    head = [f"| stills | cases | model | {' | '.join(title for _, title in MEASURES)} | trainings |", f"|---|---|---|{'--:|' * 6}"]
    page = ROOT / "docs" / "twohands" / "results.md"
    into(page, "seeds", f"shipped/{Path(__file__).name}", "\n".join([*head, *sorted(lines), ""]))


if __name__ == "__main__":
    main()
