"""Run the toy graph in a process that a test may kill. Arguments: store, code, jobs, sleep, words..."""

from __future__ import annotations

import os
import sys
from pathlib import Path

store, code, jobs, sleep_s, *words = sys.argv[1:]
sys.path[:0] = [str(Path(__file__).resolve().parents[2]), str(Path(__file__).resolve().parent)]

from toy import shout  # noqa: E402
from toy_project import graph  # noqa: E402

from runner import Runner  # noqa: E402

runner = Runner(Path(store), Path(code), "toy.values:CODEC", None, jobs=int(jobs), remote=os.environ.get("TOY_REMOTE"))
report = runner.run(graph(*words, params=shout.Params(sleep_s=float(sleep_s))), "all")
sys.stdout.write(f"{sum(report.ran.values())} {sum(report.cached.values())}\n")
sys.exit(0 if report.ok else 1)
