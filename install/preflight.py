"""Say, before pip starts, what of afford has no wheel for this Python and machine, and what is large. The standard library only.

python install/preflight.py                           # 1 where pip cannot succeed
"""

from __future__ import annotations

import platform
import shutil
import subprocess
import sys
from pathlib import Path

OLDEST, NEWEST = (3, 11), (3, 13)


def main(python: tuple[int, int], system: str, machine: str, compiler: bool, cuda: bool) -> int:
    """Say it; 1 where it is of no use to go on."""
    if not OLDEST <= python <= NEWEST:
        sys.stderr.write(f"error: expected Python 3.{OLDEST[1]} to 3.{NEWEST[1]}, got {python[0]}.{python[1]}; "
                         f"name another: make setup PYTHON=python3.{OLDEST[1]}\n")  # fmt: skip
        return 1
    for line in notes(python, system, machine, compiler, cuda):
        sys.stdout.write(f"note: {line}\n")
    return 0


def notes(python: tuple[int, int], system: str, machine: str, compiler: bool, cuda: bool) -> list[str]:
    """What is worth a sentence."""
    linux, found = system == "Linux", []
    if linux and (python > OLDEST or machine != "x86_64"):
        need = "minutes" if compiler else "minutes and a C++ compiler, of which none is found: install g++ first"
        found.append(f"pybullet has no wheel for Python {python[0]}.{python[1]} on {machine}: "
                     f"it is compiled here, which takes {need}")  # fmt: skip
    if linux and machine != "x86_64":
        found.append(f"embreex has no build for {machine}: it is left out, and what casts rays (mesh_read, the surface stages, "
                     "object_solids) fails")
    if linux and cuda:
        found.append("torch may come with CUDA's packages, several GB to download; a place of CPU builds in pip's settings "
                     "avoids that")  # fmt: skip
    return found


def cuda_offered() -> bool:
    """Whether pip's settings name no place that has CPU builds of torch."""
    said = subprocess.run([sys.executable, "-m", "pip", "config", "list"], capture_output=True, text=True).stdout
    places = [place for line in said.splitlines() if "index-url" in line or "find-links" in line
              for place in line.partition("=")[2].strip("'").split()]  # fmt: skip
    return not any("cpu" in place or any(Path(place).glob("torch-*cpu*")) for place in places)


if __name__ == "__main__":
    compiler = shutil.which("g++") or shutil.which("c++")
    raise SystemExit(main(sys.version_info[:2], platform.system(), platform.machine(), bool(compiler), cuda_offered()))
