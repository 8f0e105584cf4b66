"""Warn before pip starts about packages without a wheel for this Python and machine, and large downloads.

Uses only the standard library. `python install/preflight.py` returns 1 where pip cannot succeed.
"""

from __future__ import annotations

import platform
import shutil
import subprocess
import sys
from pathlib import Path

OLDEST, NEWEST = (3, 11), (3, 13)


def main(python: tuple[int, int], system: str, machine: str, compiler: bool, cuda: bool) -> int:
    """Print the warnings; return 1 where the installation cannot succeed."""
    if not OLDEST <= python <= NEWEST:
        sys.stderr.write(f"error: expected Python 3.{OLDEST[1]} to 3.{NEWEST[1]}, got {python[0]}.{python[1]}; "
                         f"use another one: make setup PYTHON=python3.{OLDEST[1]}\n")  # fmt: skip
        return 1
    for line in notes(python, system, machine, compiler, cuda):
        sys.stdout.write(f"note: {line}\n")
    return 0


def notes(python: tuple[int, int], system: str, machine: str, compiler: bool, cuda: bool) -> list[str]:
    """Warnings for this machine."""
    linux, found = system == "Linux", []
    if linux and (python > OLDEST or machine != "x86_64"):
        need = "minutes" if compiler else "minutes and needs a C++ compiler, which is missing: install g++ first"
        found.append(f"pybullet has no wheel for Python {python[0]}.{python[1]} on {machine}: "
                     f"it will be compiled, which takes {need}")  # fmt: skip
    if linux and machine != "x86_64":
        found.append(f"embreex has no build for {machine}: it is skipped, and stages that cast rays (mesh_read, surface stages, "
                     "object_solids) will fail")
    if linux and cuda:
        found.append("torch may bring CUDA packages, a download of several GB; an index of CPU builds in pip's settings "
                     "avoids them")  # fmt: skip
    return found


def cuda_offered() -> bool:
    """Return True when pip's settings name no index with CPU builds of torch."""
    output = subprocess.run([sys.executable, "-m", "pip", "config", "list"], capture_output=True, text=True).stdout
    places = [place for line in output.splitlines() if "index-url" in line or "find-links" in line
              for place in line.partition("=")[2].strip("'").split()]  # fmt: skip
    return not any("cpu" in place or any(Path(place).glob("torch-*cpu*")) for place in places)


if __name__ == "__main__":
    compiler = shutil.which("g++") or shutil.which("c++")
    raise SystemExit(main(sys.version_info[:2], platform.system(), platform.machine(), bool(compiler), cuda_offered()))
