"""Train the two-hand model and its ablation, and write the results into the documentation.

    PYTHONPATH=. python benchmarks/bench_twohands.py [--store DIR] [--ablation [--rows ROW,ROW] [--seeds N]]

Writes the results block of docs/twohands/results.md (training, benchmark and, with --ablation, the ablation), the table of the
README and docs/pictures/twohands.jpg. Without --ablation the ablation's part is unchanged. All of them are generated.
"""

from __future__ import annotations

import argparse
import shutil
from pathlib import Path

from benchmarks.pages import ROOT, into, make
from stages.twohands import ablation_report, model_train

SELF = Path(__file__).name
METHODS = (("small", "model"), ("small_text_removed", "model, no prompt"),
           ("small_text_shuffled", "model, wrong prompt"), ("whole_object", "whole object (oracle)"),
           ("object_box", "object box (oracle)"), ("class_mean", "mean of the class"), ("centre", "centre"))  # fmt: skip
MEASURES = (("first_mode_iou", "first-mode IoU"), ("iou", "best-mode IoU"), ("precision", "precision"), ("map", "mAP"),
            ("hd_px", "Hausdorff px"), ("best_mode_iou", "IoU over modes"), ("taxonomy_accuracy", "taxonomy"))  # fmt: skip
GROUPS = (("", "kitchens"), ("known.", "kitchens, object kinds of the training set"),
          ("new.", "kitchens, object kinds and uses held out from training"),
          ("text_decides.", "all scenes, side given by the text"),
          ("hands_from_image.", "all scenes, side not in the text"), ("shift.", "workshop and desk"))  # fmt: skip


def table(metrics: dict[str, float], prefix: str) -> str:
    """Return one line for each method with scores in a group."""
    head = f"| | {' | '.join(title for _, title in MEASURES)} |\n|---|{'--:|' * len(MEASURES)}\n"
    lines = (f"| {title} | {' | '.join(cell(metrics, f'{prefix}{name}.{measure}') for measure, _ in MEASURES)} |\n"
             for name, title in METHODS if f"{prefix}{name}.iou" in metrics)  # fmt: skip
    return head + "".join(lines)


def cell(metrics: dict[str, float], name: str) -> str:
    """A number as it is shown; '' for none."""
    if name not in metrics:
        return ""
    return f"{metrics[name]:.0f}" if name.endswith("_px") else f"{metrics[name]:.3f}"


def benchmark_text(metrics: dict[str, float]) -> str:
    """Return the tables of all groups."""
    parts = [f"{title[0].upper()}{title[1:]}, {metrics[f'{prefix}small.cases']:.0f} cases:\n\n{table(metrics, prefix)}\n"
             for prefix, title in GROUPS if f"{prefix}small.cases" in metrics]  # fmt: skip
    return f"One training (seed 0); {metrics['ms_per_image']:.0f} ms an image on one core.\n\n" + "".join(parts)


def trained_for() -> str:
    """Return the training time of the ablation's rows."""
    steps = ablation_report.Params.steps or model_train.QUICK.steps
    return f"Every row is trained for {steps} steps from random weights, so none compares with the model above.\n\n"


def main() -> None:
    """Measure, then write."""
    parser = argparse.ArgumentParser()
    parser.add_argument("--store")
    parser.add_argument("--ablation", action="store_true")
    parser.add_argument("--rows", default=",".join(ablation_report.Params.rows))
    parser.add_argument("--seeds", type=int, default=ablation_report.Params.seeds)
    asked = parser.parse_args()
    page, readme = ROOT / "docs" / "twohands" / "results.md", ROOT / "README.md"
    trained = make("train", asked.store)
    if trained["ran"].get("model_train"):
        stills = "its stills included" if trained["ran"].get("still_render") else "its stills made before"
        into(page, "training", SELF, f"`make train` took {trained['seconds'] / 60:.1f} minutes on this machine, {stills}.\n")
    found = make("benchmark", asked.store)
    into(page, "benchmark", SELF, benchmark_text(found["metrics"]))
    cases = f"One training (seed 0), {found['metrics']['small.cases']:.0f} cases:"
    into(readme, "twohands", SELF, f"{cases}\n\n{table(found['metrics'], '')}")
    sheet = Path(found["outputs"]["report"]) / "sheets" / "small_cropped.jpg"
    shutil.copyfile(sheet, ROOT / "docs" / "pictures" / "twohands.jpg")
    if asked.ablation:
        plan = ("--set", f"ablation_report.rows={asked.rows}", "--set", f"ablation_report.seeds={asked.seeds}")
        report = Path(make("ablation", asked.store, *plan)["outputs"]["report"])
        into(page, "ablation", SELF, trained_for() + (report / "ablation.md").read_text().partition("\n\n")[2])


if __name__ == "__main__":
    main()
