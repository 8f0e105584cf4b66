"""Evaluate negative affordance on objects with known parts and write the results into the documentation.

    PYTHONPATH=. python benchmarks/bench_negative.py [--store DIR]

Writes the results block of docs/surface/negative-affordance.md, the table of the README and docs/pictures/negative.jpg. All of
them are generated.
"""

from __future__ import annotations

import argparse
import shutil
from pathlib import Path

from benchmarks.pages import ROOT, into, make, took


def main() -> None:
    """Measure, then write."""
    parser = argparse.ArgumentParser()
    parser.add_argument("--store")
    found = make("negative-affordance", parser.parse_args().store)
    report = Path(found["outputs"]["report"])
    minutes = found["seconds"] / 60
    line = f"`make negative-affordance` took {minutes:.1f} minutes on this machine, the scorer's training included.\n\n"
    page = (ROOT / "docs" / "surface" / "negative-affordance.md", "results", Path(__file__).name)
    trained = took(*page, line if found["ran"].get("scorer_train") else "")
    text = (report / "report.md").read_text().partition("\n\n")[2]
    head = f"{trained}{found['metrics']['cpu_s_per_object']:.1f} CPU seconds an object.\n\n"
    into(*page, head + text)
    into(ROOT / "README.md", "negative", Path(__file__).name, f"{text.split(chr(10) * 2)[1]}\n")
    shutil.copyfile(report / "sheet.jpg", ROOT / "docs" / "pictures" / "negative.jpg")


if __name__ == "__main__":
    main()
