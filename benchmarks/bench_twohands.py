"""Train the two-hand model and its ablation, and write the results into the documentation.

    PYTHONPATH=. python benchmarks/bench_twohands.py [--store DIR] [--trainings N] [--ablation [--rows ROW,ROW] [--seeds N]]

Writes the results block of docs/twohands/results.md (training, benchmark and, with --ablation, the ablation), the table of the
README and docs/pictures/twohands.jpg. Without --ablation the ablation's part is unchanged, with --trainings 0 the others are. Cells
are the mean and standard deviation over --trainings of different seeds; the pictures are those of seed 0.
"""

from __future__ import annotations

import argparse
import shutil
from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np

from benchmarks.pages import ROOT, into, make
from stages.twohands import ablation_report, model_train

SELF = Path(__file__).name
PAGE = ROOT / "docs" / "twohands" / "results.md"
METHODS = (("small", "model"), ("small_text_removed", "model, no prompt"),
           ("small_text_shuffled", "model, wrong prompt"), ("whole_object", "whole object (oracle)"),
           ("object_box", "object box (oracle)"), ("class_mean", "mean of the class"), ("centre", "centre"))  # fmt: skip
MEASURES = (("first_mode_iou", "first-mode IoU"), ("iou", "best-mode IoU"), ("precision", "precision"), ("map", "mAP"),
            ("hd_px", "Hausdorff px"), ("best_mode_iou", "IoU over modes"), ("taxonomy_accuracy", "taxonomy"),
            ("ece", "ECE"))  # fmt: skip
GROUPS = (("", "kitchens"), ("known.", "kitchens, object kinds of the training set"),
          ("new.", "kitchens, object kinds and uses held out from training"),
          ("text_decides.", "all scenes, side given by the text"),
          ("hands_from_image.", "all scenes, side not in the text"), ("shift.", "workshop and desk"))  # fmt: skip


Found = Sequence[Mapping[str, float]]
"""figures of the report of each training"""


def table(found: Found, prefix: str) -> str:
    """Return one line for each method with scores in a group."""
    head = f"| | {' | '.join(title for _, title in MEASURES)} |\n|---|{'--:|' * len(MEASURES)}\n"
    lines = (f"| {title} | {' | '.join(cell(found, f'{prefix}{name}.{measure}') for measure, _ in MEASURES)} |\n"
             for name, title in METHODS if f"{prefix}{name}.iou" in found[0])  # fmt: skip
    return head + "".join(lines)


def cell(found: Found, name: str) -> str:
    """A figure as it is shown, with its spread where trainings differ; '' for none."""
    values = [metrics[name] for metrics in found if name in metrics]
    if not values:
        return ""
    digits = 0 if name.endswith("_px") else 3
    spread = f" ± {np.std(values, ddof=1):.{digits}f}" if len(set(values)) > 1 else ""
    return f"{np.mean(values):.{digits}f}{spread}"


def trainings(count: int) -> str:
    """Words for what the cells are made of."""
    return "One training (seed 0)" if count == 1 else f"Mean and standard deviation of {count} trainings (seeds 0 to {count - 1})"


def benchmark_text(found: Found) -> str:
    """Return the tables of all groups."""
    parts = [f"{title[0].upper()}{title[1:]}, {found[0][f'{prefix}small.cases']:.0f} cases:\n\n{table(found, prefix)}\n"
             for prefix, title in GROUPS if f"{prefix}small.cases" in found[0]]  # fmt: skip
    return f"{trainings(len(found))}; {found[0]['ms_per_image']:.0f} ms an image on one core.\n\n" + "".join(parts)


def trained_for() -> str:
    """Return the training time of the ablation's rows."""
    steps = ablation_report.Params.steps or model_train.QUICK.steps
    return f"Every row is trained for {steps} steps from random weights, so none compares with the model above.\n\n"


def main() -> None:
    """Measure, then write."""
    parser = argparse.ArgumentParser()
    parser.add_argument("--store")
    parser.add_argument("--trainings", type=int, default=3)
    parser.add_argument("--ablation", action="store_true")
    parser.add_argument("--rows", default=",".join(ablation_report.Params.rows))
    parser.add_argument("--seeds", type=int, default=ablation_report.Params.seeds)
    asked = parser.parse_args()
    if asked.trainings:
        measure(asked.store, asked.trainings)
    if asked.ablation:
        plan = ("--set", f"ablation_report.rows={asked.rows}", "--set", f"ablation_report.seeds={asked.seeds}")
        report = Path(make("ablation", asked.store, *plan)["outputs"]["report"])
        into(PAGE, "ablation", SELF, trained_for() + (report / "ablation.md").read_text().partition("\n\n")[2])


def measure(store: str | None, count: int) -> None:
    """Train and measure `count` models; write their tables, and the pictures of seed 0."""
    readme, trained = ROOT / "README.md", make("train", store)
    if trained["ran"].get("model_train"):
        stills = "its stills included" if trained["ran"].get("still_render") else "its stills made before"
        into(PAGE, "training", SELF, f"`make train` took {trained['seconds'] / 60:.1f} minutes on this machine, {stills}.\n")
    reports = {seed: make("benchmark", store, "--set", f"model_train.seed={seed}")
               for seed in reversed(range(count))}  # what is published in the end is of seed 0
    found = [reports[seed]["metrics"] for seed in range(count)]
    into(PAGE, "benchmark", SELF, benchmark_text(found))
    cases = f"{trainings(len(found))}, {found[0]['small.cases']:.0f} cases:"
    into(readme, "twohands", SELF, f"{cases}\n\n{table(found, '')}")
    sheet = Path(reports[0]["outputs"]["report"]) / "sheets" / "small_cropped.jpg"
    shutil.copyfile(sheet, ROOT / "docs" / "pictures" / "twohands.jpg")


if __name__ == "__main__":
    main()
