"""Measure every part, one process each, and write README.md: all of "The runner, measured".

    PYTHONPATH=. python benchmarks/runner/all.py [--store DIR] [--only noop,cold] [--resume] [--quick]

`--resume` leaves out the parts that are measured already at this commit. The other options are those of the parts.
"""

from __future__ import annotations

import argparse
import os
import subprocess
import sys
import time
from pathlib import Path

from benchmarks.pages import ROOT, head
from benchmarks.runner.parts import HERE, ORDER, kept, parser


def parts() -> list[str]:
    """Parts that have a script, in the order of the page."""
    found = {path.stem.removeprefix("bench_") for path in HERE.glob("bench_*.py")}
    return [part for part in ORDER if part in found] + sorted(found - set(ORDER))


def parsed() -> tuple[argparse.Namespace, list[str]]:
    """Own options, and those that are passed on."""
    made = parser(__doc__ or "")
    made.add_argument("--only", default=",".join(parts()), help="parts, with commas between")
    made.add_argument("--resume", action="store_true", help="leave out what is measured at this commit")
    chosen = made.parse_args()
    unknown = set(chosen.only.split(",")) - set(parts())
    if unknown:
        made.error(f"--only: expected parts out of {', '.join(parts())}, got {', '.join(sorted(unknown))}")
    own = argparse.ArgumentParser(add_help=False, allow_abbrev=False)
    own.add_argument("--only")
    own.add_argument("--resume", action="store_true")
    return chosen, own.parse_known_args()[1]


def is_measured(out: Path, part: str, quick: bool) -> bool:
    """Return True for a part that is measured at this commit, at full size unless `quick`."""
    known = kept(out).get(part, {})
    return known.get("commit") == head() and (quick or not known.get("quick"))


def main() -> int:
    """Run the parts; 1 when a part failed or missed a goal."""
    chosen, passed = parsed()
    missed = []
    for part in chosen.only.split(","):
        if chosen.resume and is_measured(chosen.out, part, chosen.quick):
            continue
        began = time.monotonic()
        path = os.pathsep.join(filter(None, (str(ROOT), os.environ.get("PYTHONPATH"))))
        done = subprocess.run([sys.executable, str(HERE / f"bench_{part}.py"), *passed], env=os.environ | {"PYTHONPATH": path})
        print(f"{part}: {time.monotonic() - began:.0f} s", flush=True)
        missed += [part] if done.returncode else []
    if missed:
        print(f"failed, or a goal missed: {', '.join(missed)}", flush=True)
    return 1 if missed else 0


if __name__ == "__main__":
    sys.exit(main())
