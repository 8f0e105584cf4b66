"""Train SOR3D-AFF's model, or the rows of its ablation with --ablation, and write the results into the documentation.

    PYTHONPATH=. python benchmarks/bench_sor3d.py [--store DIR] [--set STAGE.PARAM=VALUE] [--settings | --static | --ablation
        [--rows ROW,ROW] [--first-seed N] [--seeds N] [--minutes N]]

Writes the results of docs/rgbd/sor3d.md: the model, the table of the README and docs/pictures/sor3d.jpg. With --ablation, the
ablation only: all trainings in benchmarks/sor3d_ablation.json and those of this run, or with --set those of this run only. With
--static, the comparison with the detector on single images. With --settings, the sizes and training settings of small and
paper.
"""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import Any

import cv2

from afford.rgbd.evaluate import ablation_rows
from afford.rgbd.model.config import VARIANTS
from afford.rgbd.model.model import build
from benchmarks import sor3d_kept
from benchmarks.pages import ROOT, head, into, make, took
from commands.settings import parameters_of
from stages.rgbd import sor3d_report, sor3d_train

SELF = Path(__file__).name
PAGE, README, PICTURE = ROOT / "docs" / "rgbd" / "sor3d.md", ROOT / "README.md", ROOT / "docs" / "pictures" / "sor3d.jpg"
QUALITY = 88
FIGURES = ("iou", "f", "fw")
CAPTION = "Sequences of validation: last frame, truth, prediction of the video and of the last frame alone, attention"


def main() -> None:
    """Measure, then write."""
    parser = argparse.ArgumentParser()
    parser.add_argument("--store")
    parser.add_argument("--ablation", action="store_true")
    parser.add_argument("--static", action="store_true")
    parser.add_argument("--settings", action="store_true")
    parser.add_argument("--rows", default=",".join(sor3d_report.Params.rows))
    parser.add_argument("--seeds", type=int, default=sor3d_report.Params.seeds)
    parser.add_argument("--first-seed", type=int, default=sor3d_report.Params.first_seed)
    parser.add_argument("--set", action="append", default=[])
    parser.add_argument("--minutes", help="with --ablation: rows that are not finished by then are marked so")
    asked = parser.parse_args()
    if asked.settings:
        into(PAGE, "settings", SELF, schedule())
        into(PAGE, "sizes", SELF, sizes())
        return
    sets = tuple(word for one in asked.set for word in ("--set", one))
    if asked.ablation:
        into(PAGE, "ablation", SELF, ablation(asked, sets))
        return
    if asked.static:
        into(PAGE, "static", SELF, body(Path(make("static-sets", asked.store, *sets)["outputs"]["static_report"])))
        return
    made = make("sor3d", asked.store, *sets)
    report = Path(made["outputs"]["report"])
    into(PAGE, "model", SELF, f"{took(PAGE, 'model', SELF, lasted(made))}{body(report)}\n![{CAPTION}](pictures/{PICTURE.name})\n")
    into(README, "sor3d", SELF, short(made["metrics"]))
    cv2.imwrite(str(PICTURE), cv2.imread(str(report / "sheet.png")), [cv2.IMWRITE_JPEG_QUALITY, QUALITY])


def ablation(asked: argparse.Namespace, sets: tuple[str, ...]) -> str:
    """The table, with what is known of earlier trainings where these are trained as those were."""
    limit = ("--minutes", asked.minutes) if asked.minutes else ()
    plan = (f"sor3d_report.{name}={getattr(asked, name)}" for name in ("rows", "seeds", "first_seed"))
    found = make("sor3d-ablation", asked.store, *limit, *sets, *(word for one in plan for word in ("--set", one)))
    report = Path(found["outputs"]["report"])
    if sets:
        return stated(asked) + body(report)
    return sor3d_kept.table(sor3d_kept.add(sor3d_kept.KEPT, report / "scores.json", head()), found["metrics"])


def stated(asked: argparse.Namespace) -> str:
    """Return the settings of the command line other than the rows."""
    return f"Asked for: `{' '.join([*asked.set, f'--seeds {asked.seeds}'])}`.\n\n"


def schedule() -> str:
    """Return the training parameters in which small and paper differ."""
    small, paper = sor3d_train.Params(), sor3d_train.PAPER
    rows = [(name, getattr(small, name), getattr(paper, name), doc) for name, _, _, doc, _ in parameters_of(small)]
    lines = "".join(f"| `{name}` | {small} | {paper} | {doc} |\n" for name, small, paper, doc in rows if small != paper)
    return f"| `sor3d_train` | small | paper | |\n|---|--:|--:|---|\n{lines}"


def sizes() -> str:
    """Return the number of parameters of each variant."""
    counts = {name: sum(one.numel() for one in build(made(), 0).parameters()) for name, made in VARIANTS.items()}
    counted = (f"`{name}` has {count / 1e6:.3g} million parameters" for name, count in counts.items())
    return f"{', '.join(counted)}.\n"


def lasted(made: dict[str, Any]) -> str:
    """Return the training time, if this run trained the model; '' for a cached model."""
    if not made["ran"].get("sor3d_train"):
        return ""
    sequences = "its sequences included" if made["ran"].get("interaction_render") else "its sequences made before"
    return f"`make sor3d` took {made['seconds'] / 60:.1f} minutes on this machine, {sequences}.\n\n"


def body(report: Path) -> str:
    """Return the text below the title."""
    return (report / "report.md").read_text(encoding="utf-8").partition("\n\n")[2]


def short(numbers: dict[str, float]) -> str:
    """Compare the results with the paper's."""
    def line(mode: str, words: str) -> str:
        ours = [f"{numbers[f'{mode}.{name}']:.3f}" for name in FIGURES]
        return f"| {' | '.join((words, *ours, *(f'{value:.2f}' for value in ablation_rows.PUBLISHED_MODEL[mode])))} |\n"

    head = "| | IoU | F | weighted F | paper, its data: IoU | F | weighted F |\n|---|--:|--:|--:|--:|--:|--:|\n"
    return head + line("video", "videos") + line("static", "pictures")


if __name__ == "__main__":
    main()
