"""Score the extraction stages on rendered clips and write the results into the documentation.

    PYTHONPATH=. python benchmarks/bench_extraction.py [--eval-seed N] [--store DIR]

Writes benchmarks/extraction.md (the whole report), the results block of README.md, docs/pictures/report.jpg and
docs/pictures/overview.jpg. All of them are generated.
"""

from __future__ import annotations

import argparse
import json
import platform
import subprocess
import sys
from pathlib import Path
from typing import Any

import cv2
import numpy as np

ROOT = Path(__file__).resolve().parent.parent
START, END = "<!-- results: written by benchmarks/bench_extraction.py -->", "<!-- end of results -->"
SHEET_PX, SHEET_QUALITY = 1200, 72
"""width of the sheet of all clips as it is shown, and its JPEG quality: some 370 kB"""
PICTURES = """
## Frame by frame

Each clip at the frame in which hands hide most of what they hold.

![Every clip: frame, masks, hands removed, truth, complete objects, affordance of each hand](../docs/pictures/report.jpg)
"""
README_ROWS = (
    ("masks between key frames 15 apart", "J", "densify.j.gap15", "nearest key frame", "baseline.nearest.j.gap15"),
    ("masks between key frames 30 apart", "J", "densify.j.gap30", "nearest key frame", "baseline.nearest.j.gap30"),
    ("hands removed", "PSNR dB", "inpaint.psnr_db", "cv2.inpaint", "baseline.telea.psnr_db"),
    ("complete objects", "amodal IoU", "completion.amodal_iou", "convex hull", "baseline.hull.amodal_iou"),
    ("complete objects, hidden part", "IoU", "completion.hidden_iou", "convex hull", "baseline.hull.hidden_iou"),
    ("affordance of each hand", "IoU", "affordance.iou", "", ""),
    ("affordance of each hand", "precision", "affordance.precision", "", ""),
)


def measure(seed: int, store: str | None) -> dict[str, Any]:
    """Return the JSON summary of one report."""
    command = [sys.executable, str(ROOT / "pipeline.py"), "run", "extraction-report", "--json", "--set",
               f"extraction_report.eval_seed={seed}", *(["--store", store] if store else [])]  # fmt: skip
    done = subprocess.run(command, stdout=subprocess.PIPE, text=True, check=True)
    found: dict[str, Any] = json.loads(done.stdout.strip().splitlines()[-1])
    return found


def readme_table(metrics: dict[str, float], seed: int) -> str:
    """The short table of the README."""
    standard, hard, frames = (int(metrics[f"clips.{name}"]) for name in ("standard", "hard", "frames"))
    head = (
        f"{standard} standard and {hard} hard rendered clips of seed {seed}, {frames} frames at 456 x 256; "
        f"{metrics['cpu_s_per_frame']:.2f} CPU seconds a frame from video to affordance masks.\n\n"
        "| what | measure | standard | hard | plain baseline | standard | hard |\n|---|---|---|---|---|---|---|\n"
    )
    rows = []
    for what, unit, name, baseline, plain in README_ROWS:
        ours = (cell(metrics, name), cell(metrics, f"hard.{name}"))
        theirs = (baseline, cell(metrics, plain), cell(metrics, f"hard.{plain}"))
        rows.append("| " + " | ".join((what, unit, *ours, *theirs)) + " |\n")
    return head + "".join(rows)


def footer(metrics: dict[str, float], seed: int) -> str:
    """Return the costs of the stages and the machine of the measurement."""
    head, machine = "cpu_s_per_frame", f"Python {platform.python_version()}, {platform.machine()}"
    rows = [(name.partition(".")[2], value) for name, value in sorted(metrics.items()) if name.startswith(head + ".")]
    costs = "".join(f"| {name} | {value:.3f} |\n" for name, value in [*rows, ("together", metrics[head])])
    return f"\n## Cost, CPU seconds a frame\n\n| stage | CPU s |\n|---|---|\n{costs}\nSeed {seed}. {machine}.\n"


def cell(metrics: dict[str, float], name: str) -> str:
    """Format a number; '' for none."""
    if name not in metrics:
        return ""
    return f"{metrics[name]:.1f}" if name.endswith("_db") else f"{metrics[name]:.3f}"


def into_readme(block: str) -> None:
    """Replace the text between the two markers of README.md."""
    path = ROOT / "README.md"
    before, _, rest = path.read_text().partition(START)
    _, _, after = rest.partition(END)
    path.write_text(f"{before}{START}\n{block}{END}{after}")


def pictures(report: Path) -> None:
    """Write the sheet of all clips, and four of its rows for the README."""
    folder = ROOT / "docs" / "pictures"
    folder.mkdir(parents=True, exist_ok=True)
    sheet = cv2.imread(str(report / "sheet.jpg"))
    size = SHEET_PX, round(sheet.shape[0] * SHEET_PX / sheet.shape[1])
    small = cv2.resize(sheet, size, interpolation=cv2.INTER_AREA)
    cv2.imwrite(str(folder / "report.jpg"), small, [cv2.IMWRITE_JPEG_QUALITY, SHEET_QUALITY])
    head, body = sheet[:24], sheet[24:]
    height = round(sheet.shape[1] / 6 * 256 / 456)
    rows = [body[i * height : (i + 1) * height] for i in (0, 1, 4, 6) if (i + 1) * height <= len(body)]
    cv2.imwrite(str(folder / "overview.jpg"), np.vstack([head, *rows]), [cv2.IMWRITE_JPEG_QUALITY, 88])


def main() -> None:
    """Measure, then write."""
    parser = argparse.ArgumentParser()
    parser.add_argument("--eval-seed", type=int, default=20261)
    parser.add_argument("--store")
    asked = parser.parse_args()
    found = measure(asked.eval_seed, asked.store)
    report = Path(found["outputs"]["report"])
    text = (report / "report.md").read_text() + PICTURES + footer(found["metrics"], asked.eval_seed)
    (ROOT / "benchmarks" / "extraction.md").write_text(text)
    into_readme(readme_table(found["metrics"], asked.eval_seed))
    pictures(report)


if __name__ == "__main__":
    main()
