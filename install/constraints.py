"""Pin every package that afford installs, with the hashes of all its files, and show that the pins resolve on each Python.

    make constraints                                      # write constraints*.txt; keep pins that still resolve
    make constraints ARGS="--upgrade"                     # update every pin to the newest release that resolves
    make constraints ARGS="--check"                       # write nothing; check for wheels on each Python and machine

uv resolves for all Pythons and machines together, from the index in `UV_INDEX_URL` or its default index. torch and the packages of
its CUDA builds have no hash, because each index has its own build of the same version.
"""

from __future__ import annotations

import argparse
import re
import subprocess
import sys
import tempfile
from pathlib import Path

ROOT = Path(__file__).resolve().parent.parent
PYTHONS = ("3.11", "3.12", "3.13")
MACHINES = ("x86_64-manylinux_2_28", "aarch64-manylinux_2_34")
GROUPS = ("", "gpu", "film", "ray", "dev")
"""dependencies of users (''), and the extras of pyproject.toml that add to them"""
TORCH = re.compile(r"^(torch|triton|nvidia-[\w-]+|cuda-[\w-]+)==")
EVERYWHERE = " ; python_full_version < '3.14' and (sys_platform == 'darwin' or sys_platform == 'linux')"
"""marker of packages for all Pythons and machines of pyproject.toml, which is omitted"""
BUILT = {"pybullet": lambda python, machine: python != "3.11" or machine.startswith("aarch64")}
"""package -> function that is true where it has no wheel; install/preflight.py warns about it"""
HEAD = "# Written by `make constraints`: {what}. Installed by `make setup` with --require-hashes.\n"
UNHASHED = "# Written by `make constraints`. Without a hash: each index has its own build.\n"
Pins = dict[str, str]
"""name -> its pin and hashes, as lines of a requirements file"""


def main() -> int:
    """Write the pins, then check them; return 1 when they do not resolve somewhere."""
    parser = argparse.ArgumentParser(description="pin the packages that afford installs")
    parser.add_argument("--upgrade", action="store_true", help="update every pin to the newest release that resolves")
    parser.add_argument("--check", action="store_true", help="write nothing; check for wheels on each Python and machine")
    asked = parser.parse_args()
    if not asked.check:
        write(asked.upgrade)
    return check()


def write(upgrade: bool) -> None:
    """Write one file of pins for users, one for each extra, and one for torch."""
    every = resolved([extra for extra in GROUPS if extra], [] if upgrade else kept())
    seen = set[str]()
    for extra in GROUPS:
        names = set(resolved([extra] if extra else [], [pin(lines) for lines in every.values()]))
        what = f"what the extra `{extra}` adds" if extra else "what everybody installs, but for torch"
        chosen = [every[name] for name in sorted(names - seen) if not TORCH.match(every[name])]
        place(extra).write_text(HEAD.format(what=what) + "".join(chosen), encoding="utf-8")
        seen |= names
    place("torch").write_text(UNHASHED + pin(every["torch"]) + "\n", encoding="utf-8")


def check() -> int:
    """Report for each Python and machine which packages have no wheel; return 1 where BUILT disagrees."""
    wrong = 0
    for python in PYTHONS:
        for machine in MACHINES:
            built = [name for name, where in BUILT.items() if where(python, machine)]
            wheeled = [name for name in built if not refused(python, machine, only=name)]
            trouble = refused(python, machine, leave_out=built) or (wheeled and f"take {', '.join(wheeled)} out of BUILT")
            state = trouble or (f"wheels for all but {', '.join(built)}" if built else "wheels for all")
            sys.stdout.write(f"Python {python} on {machine}: {state}\n")
            wrong += bool(trouble)
    return min(wrong, 1)


def refused(python: str, machine: str, leave_out: list[str] | None = None, only: str = "") -> str:
    """Error of uv when these pins cannot be installed from wheels alone, '' when they can. Nothing is downloaded."""
    pins = {name: lines for group in GROUPS for name, lines in read(group).items()}
    chosen = [lines for name, lines in pins.items() if name not in (leave_out or []) and only in ("", name)]
    with tempfile.TemporaryDirectory() as folder:
        (Path(folder) / "pins.txt").write_text("".join(chosen), encoding="utf-8")
        done = uv("pip", "install", "--dry-run", "--no-deps", "--require-hashes", "--only-binary", ":all:",
                  "--target", f"{folder}/none", "--python-version", python, "--python-platform", machine,
                  "--requirement", f"{folder}/pins.txt")  # fmt: skip
    return "" if done.returncode == 0 else " ".join(done.stderr.partition("cause: ")[2].split()) or done.stderr.strip()


def resolved(extras: list[str], pins: list[str]) -> Pins:
    """Pins of all packages that the project and these extras need on any Python and machine.

    SystemExit when there is no solution.
    """
    with tempfile.TemporaryDirectory() as folder:
        given, made = Path(folder) / "given.txt", Path(folder) / "made.txt"
        given.write_text("\n".join(pins) + "\n", encoding="utf-8")
        done = uv("pip", "compile", "pyproject.toml", *(word for extra in extras for word in ("--extra", extra)), "--universal",
                  "--python-version", PYTHONS[0], "--generate-hashes", "--no-header", "--no-annotate", "--constraint", str(given),
                  "--output-file", str(made))  # fmt: skip
        if done.returncode:
            raise SystemExit(f"error: no set of pins resolves: {done.stderr.strip()}")
        return parse(made.read_text(encoding="utf-8"))


def kept() -> list[str]:
    """Existing pins, without hashes."""
    return [pin(lines) for group in (*GROUPS, "torch") for lines in read(group).values()]


def read(group: str) -> Pins:
    """Pins of one file; empty if it does not exist."""
    return parse(place(group).read_text(encoding="utf-8")) if place(group).is_file() else {}


def parse(text: str) -> Pins:
    """Split a requirements file into pins, each with its continuation lines."""
    entries = re.findall(r"^[^\s#].*\n(?:[ \t]+.*\n)*", text, re.MULTILINE)
    return {entry.split("==")[0].lower(): entry.replace(EVERYWHERE, "") for entry in entries}


def pin(lines: str) -> str:
    """NAME==VERSION of a requirement, without markers."""
    return lines.split(";")[0].split("\\")[0].strip()


def place(group: str) -> Path:
    """Path of the file of a group."""
    return ROOT / (f"constraints-{group}.txt" if group else "constraints.txt")


def uv(*words: str) -> subprocess.CompletedProcess[str]:
    """Run uv from this environment."""
    return subprocess.run([sys.executable, "-m", "uv", *words], cwd=ROOT, capture_output=True, text=True)


if __name__ == "__main__":
    raise SystemExit(main())
