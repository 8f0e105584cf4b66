"""Put Blender's module `bpy`, with the renderer Cycles, into an environment of its own: for `still_render.backend=cycles`.

Run by hand: `.venv/bin/python install/cycles.py`. About 1 GB. Blender is licensed under the GPL; it runs in a process of its own,
which exchanges files with this project. Uses only the standard library and pip.
"""

from __future__ import annotations

import subprocess
import sys
import tempfile
import venv
from collections.abc import Callable
from pathlib import Path

FOLDER = "share/afford/bpy-5.0.1"
"""below the prefix of the environment, as in afford/render/cycles/client.py"""
PACKAGES = ("bpy==5.0.1", "numpy==1.26.4")
PYTHON = (3, 11)
"""the one Python for which this bpy is published"""


def main(prefix: Path, install: Callable[[Path], str]) -> int:
    """Make the environment FOLDER below `prefix`; nothing is left of one that fails. Returns 0, or 1 with a sentence."""
    if sys.version_info[:2] != PYTHON:
        sys.stderr.write(f"error: bpy 5.0.1 is published for Python {PYTHON[0]}.{PYTHON[1]} only, this is "
                         f"{sys.version_info[0]}.{sys.version_info[1]}; make the environment with that Python\n")
        return 1
    folder = prefix / FOLDER
    if (folder / "bin" / "python").exists():
        return 0
    folder.parent.mkdir(parents=True, exist_ok=True)
    sys.stdout.write("fetching Blender's module with the renderer Cycles (360 MB, once)\n")
    sys.stdout.flush()
    with tempfile.TemporaryDirectory(prefix=".bpy-", dir=folder.parent) as scratch:
        made = Path(scratch) / "environment"
        failure = install(made)
        if failure:
            sys.stderr.write(f"error: cannot install {PACKAGES[0]}: {failure}; run `python install/cycles.py` again where there is "
                             "a network\n")
            return 1
        made.rename(folder)
    return 0


def pip_install(folder: Path) -> str:
    """Make an environment with the packages, and import bpy in it once; returns the last words of what failed, or ''."""
    venv.create(folder, with_pip=True, symlinks=True)
    python = folder / "bin" / "python"
    commands = ([python, "-m", "pip", "install", "--quiet", "--disable-pip-version-check", "--no-deps", "--only-binary=:all:",
                 *PACKAGES], [python, "-I", "-c", "import bpy"])  # fmt: skip
    for command in commands:
        done = subprocess.run(command, capture_output=True, text=True)
        if done.returncode:
            return (done.stderr.strip().splitlines() or ["no message"])[-1]
    return ""


if __name__ == "__main__":
    raise SystemExit(main(Path(sys.prefix), pip_install))
