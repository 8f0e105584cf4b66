"""Measure the effect of kills, damage, full disks, malformed files and concurrency on a run; writes benchmarks/reliability.md.

    PYTHONPATH=. python benchmarks/bench_reliability.py [--quick] [--seed N] [--only kills,flips] [--fuzz N] [--out DIR]

Every part can run alone: figures of the others are kept in reliability.json. The exit code is 1 when a test failed. No network
and no privileges are needed; a test that a machine cannot run is skipped with the reason.
"""

from __future__ import annotations

import argparse
import json
import os
import resource
import shutil
import signal
import sys
import tempfile
from pathlib import Path
from typing import Any

from afford.common.registry import load
from benchmarks.pages import head
from benchmarks.reliability.rows import Plan, Row

PAGE = "reliability"
PARTS = {name: f"benchmarks.reliability.{name}:rows" for name in (
    "kills", "concurrency", "flips", "rotten", "lost", "disk", "moved", "signals", "stages", "edits", "turns", "cli", "publishing",
    "fuzzing", "suites")}  # fmt: skip
TITLES = {"kills": "Kills", "concurrency": "Several runs at once", "flips": "One damaged file", "rotten": "Damage during a run",
          "lost": "Deleted files", "disk": "Full and read-only disks", "moved": "Moved stores, other times", "signals": "Signals",
          "stages": "Stages that crash, loop or print", "edits": "Edited code", "turns": "Wide tasks", "cli": "The command line",
          "publishing": "Publishing", "fuzzing": "Mutated files and bombs", "suites": "Demo page and security"}  # fmt: skip
HEAD = ("| test | tried | held | failed | by design | figures |", "|---|--:|--:|--:|--:|---|")


def measured(part: str, plan: Plan) -> list[dict[str, Any]]:
    """The rows of a part, printed as they are known."""
    rows: list[Row] = load(PARTS, part)(plan)
    for row in rows:
        print(f"{part}: {row.what}: {row.held} of {row.tried} held", *([f"({row.reason})"] if row.reason else []), flush=True)
        for failure in row.failures:
            print(f"    {failure}", flush=True)
    return [row.counted() for row in rows]


def page(known: dict[str, Any]) -> str:
    """The page: a table for each part, what failed, and what is by design or was skipped."""
    rows = [row for part in PARTS for row in known.get(part, {}).get("rows", [])]
    sums = {name: sum(row[name] for row in rows) for name in ("tried", "held", "failed", "design")}
    lines = ["# Reliability", "", "Attacks on stores, runs, readers and pages. "
             f"{sums['tried']} tries: {sums['held']} held, {sums['failed']} failed, {sums['design']} are by design. "
             "Written by `benchmarks/bench_reliability.py`."]
    for part in PARTS:
        if part in known:
            lines += ["", f"## {TITLES[part]}", "", _said(known[part]), "", *HEAD, *map(_line, known[part]["rows"])]
    return "\n".join([*lines, *_listed("Failed", _failures(rows)), *_listed("By design, or skipped", _reasons(rows))]) + "\n"


def _said(part: dict[str, Any]) -> str:
    amount = "a few of each (`--quick`)" if part["quick"] else "all"
    return f"Commit {part['commit']}, seed {part['seed']}, {amount}."


def _line(row: dict[str, Any]) -> str:
    counts = [str(row[name] or "") if name == "design" else str(row[name]) for name in ("tried", "held", "failed", "design")]
    return f"| {_cell(row['what'])} | {' | '.join(counts)} | {_cell(row['figures'])} |"


def _cell(text: str) -> str:
    return text.replace("|", "\\|")


def _failures(rows: list[dict[str, Any]]) -> list[str]:
    return [f"{row['what']}: `{failure}`" for row in rows for failure in row["failures"]]


def _reasons(rows: list[dict[str, Any]]) -> list[str]:
    return [f"{row['what']}: {row['reason']}" for row in rows if row["reason"]]


def _listed(title: str, lines: list[str]) -> list[str]:
    return ["", f"## {title}", "", *(f"- {line}" for line in lines)] if lines else []


def parsed() -> argparse.Namespace:
    """Parse the command line."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--quick", action="store_true", help="a few of each row")
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--only", default=",".join(PARTS), help="parts, with commas between")
    parser.add_argument("--fuzz", type=int, help="mutations of every reader; default: 1000, with --quick 10")
    parser.add_argument("--out", type=Path, default=Path(__file__).parent, help="folder of reliability.md and reliability.json")
    chosen = parser.parse_args()
    unknown = set(chosen.only.split(",")) - set(PARTS)
    if unknown:
        parser.error(f"--only: expected parts out of {', '.join(PARTS)}, got {', '.join(sorted(unknown))}")
    return chosen


def main() -> int:
    """Measure, keep, write; 1 where anything that was measured now failed."""
    chosen, failed = parsed(), 0
    signal.signal(signal.SIGINT, signal.default_int_handler)  # a shell's background job ignores it, and so would what it starts
    resource.setrlimit(resource.RLIMIT_CORE, (0, 0))
    os.environ.pop("PYTHONDONTWRITEBYTECODE", None)  # runs meet Python's cache of compiled modules, as those of users do
    chosen.out.mkdir(parents=True, exist_ok=True)
    kept = chosen.out / f"{PAGE}.json"
    for part in chosen.only.split(","):
        folder = Path(tempfile.mkdtemp(prefix="reliability-"))
        try:
            plan = Plan(folder, chosen.seed, chosen.quick, chosen.fuzz or (10 if chosen.quick else 1000))
            rows = measured(part, plan)
        finally:
            shutil.rmtree(folder, ignore_errors=True)
        known = json.loads(kept.read_text()) if kept.exists() else {}
        known[part] = {"commit": head(), "seed": chosen.seed, "quick": chosen.quick, "rows": rows}
        kept.write_text(json.dumps(known, indent=1, sort_keys=True) + "\n")
        (chosen.out / f"{PAGE}.md").write_text(page(known))
        failed += sum(row["failed"] for row in rows)
    return 1 if failed else 0


if __name__ == "__main__":
    sys.exit(main())
