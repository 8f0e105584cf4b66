"""Runs a toy graph in a process that a benchmark may kill: toy_run.py PROJECT FOLDER JOBS SLEEP_S WORD...

Prints the report as one line of JSON, the last one. Exit 0: all is well; 1: a shard failed; 3: the store cannot be used, in one
sentence on stderr; 130: interrupted.
"""

from __future__ import annotations

import json
import signal
import sys
from pathlib import Path

sys.path.insert(0, str(Path(__file__).resolve().parents[2]))

from afford.common.registry import load
from runner import StoreError

PROJECTS = {"FlippedStore": "tests.helpers.flipped_stores:FlippedStore",
            "BadStore": "benchmarks.reliability.stages:BadStore",
            "LargeStore": "benchmarks.reliability.disk:LargeStore",
            "WideStore": "benchmarks.reliability.turns:WideStore"}  # fmt: skip


def main(project: str, folder: str, jobs: str, sleep_s: str, *words: str) -> int:
    """Run, print, and say how it went."""
    signal.signal(signal.SIGINT, signal.default_int_handler)  # a shell's background job ignores it
    try:
        report = load(PROJECTS, project)(Path(folder), words).run(int(jobs), float(sleep_s))
    except StoreError as error:
        sys.stderr.write(f"{error}\n")
        return 3
    except KeyboardInterrupt:
        return 130
    sys.stdout.write(f"\n{json.dumps(report)}\n")
    return 0 if report["ok"] else 1


if __name__ == "__main__":
    sys.exit(main(*sys.argv[1:]))
