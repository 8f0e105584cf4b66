"""4 and 5: the demo page, the network and security, by the tests that state their laws."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path
from xml.etree import ElementTree

from benchmarks.pages import ROOT
from benchmarks.reliability.rows import Plan, Row, skipped

SUITES = {"demo page: addresses, hosts, origins, paths, lengths, bodies, many questions": ("test_demo.py",),
          "model servers: keys, proxies, deadlines, answers": ("test_describe_endpoint.py", "test_describe_prompt.py"),
          "sources: bad input, one clear sentence": ("test_bad_input.py", "test_pipeline_bad_input.py", "test_discover.py"),
          "checkpoints and pickles that would run code": ("test_tensor_files.py", "test_published_weights.py", "test_weights.py"),
          "recordings and links: nothing outside a source is read": ("test_readers_video.py", "test_malformed_annotations.py"),
          "publishing": ("test_publish.py",)}  # fmt: skip
QUICK = ("test_demo.py", "test_readers_video.py", "test_publish.py")
"""suites of a quick run, by their first file"""


def rows(plan: Plan) -> list[Row]:
    """One for each suite."""
    return [_suite(plan, what, files) for what, files in SUITES.items()]


def _suite(plan: Plan, what: str, files: tuple[str, ...]) -> Row:
    there = [f"tests/{name}" for name in files if (ROOT / "tests" / name).exists()]
    if plan.quick and files[0] not in QUICK:
        return skipped(what, "a quick run")
    if not there:
        return skipped(what, f"none of {', '.join(files)} is there")
    return _counted(Row(f"{what} ({', '.join(Path(name).name for name in there)})"), there, plan.folder / "junit.xml", plan.quick)


def _counted(row: Row, files: list[str], report: Path, quick: bool) -> Row:
    report.unlink(missing_ok=True)
    command = [sys.executable, "-m", "pytest", "-q", "-p", "no:xdist", f"--junitxml={report}", *files]
    done = subprocess.run([*command, *(["-m", "not slow"] if quick else [])], cwd=ROOT, capture_output=True, text=True)
    if not report.exists():
        row.count([f"pytest ended with {done.returncode}: {done.stdout[-200:]}"])
        return row
    skips = 0
    for case in ElementTree.parse(report).iter("testcase"):
        if case.find("skipped") is not None:
            skips += 1
            continue
        bad = [found for found in (case.find("failure"), case.find("error")) if found is not None]
        row.count([f"{case.get('name')}: {bad[0].get('message', '')[:200]}"] if bad else [])
    row.figures = f"{skips} skipped" if skips else ""
    return row
