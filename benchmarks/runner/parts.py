"""Rows of the table, the options of the scripts, and the page that they write.

Each script of this folder measures one part. Its rows replace those of the part in rows.json, and README.md is written again.
"""

from __future__ import annotations

import argparse
import json
import os
import platform
import shutil
import tempfile
from collections.abc import Callable
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Any

from benchmarks.pages import head

HERE = Path(__file__).resolve().parent
ORDER = ("noop", "large", "cold", "edits", "command", "kills", "at_once", "flips", "ray", "verify")
"""parts in the order of the page; others follow"""


@dataclass
class Row:
    """One line of the table."""

    what: str
    goal: str
    measured: str
    reached: bool | None = None
    """None: no goal, or not measured"""
    figures: dict[str, float] = field(default_factory=dict)
    """the numbers behind `measured`"""
    note: str = ""


@dataclass(frozen=True)
class Plan:
    """Sizes of a measurement, and its folder."""

    folder: Path
    """empty, removed afterwards"""
    quick: bool
    shards: int
    large: int
    cold: tuple[int, ...]
    rounds: int
    kills: int
    mib: int
    venvs: Path
    store: str
    source: str

    def place(self, name: str) -> Path:
        """A new folder."""
        folder = self.folder / name
        folder.mkdir(parents=True)
        return folder


def parser(about: str) -> argparse.ArgumentParser:
    """Options that all scripts share."""
    made = argparse.ArgumentParser(description=about, formatter_class=argparse.RawDescriptionHelpFormatter)
    made.add_argument("--quick", action="store_true", help="small sizes, to try the scripts; the figures mean nothing")
    made.add_argument("--shards", type=int, help="shards of each stage of the small graph (default 1000)")
    made.add_argument("--large", type=int, help="tasks of the large graph (default 100000)")
    made.add_argument("--cold", help="numbers of tasks of cold runs, with commas between (default 99,999,9999)")
    made.add_argument("--rounds", type=int, help="interleaved rounds of each measure; medians count (default 5)")
    made.add_argument("--kills", type=int, help="moments of kill -9 (default 100)")
    made.add_argument("--mib", type=int, help="size of each of four large files for verify, MiB (default 256)")
    made.add_argument("--venvs", type=Path, default=Path(tempfile.gettempdir()) / "runner-peers",
                      help="folder of the peers' virtual environments, made where missing")  # fmt: skip
    made.add_argument("--store", default="", help="store in which `run dataset` has nothing to do")
    made.add_argument("--source", default="", help="source of that store (default: that of the command)")
    made.add_argument("--out", type=Path, default=HERE, help="folder of rows.json and README.md")
    return made


def plan_of(chosen: argparse.Namespace, folder: Path) -> Plan:
    """Sizes that the options ask for."""
    quick = chosen.quick
    cold = chosen.cold or ("9,30" if quick else "99,999,9999")
    return Plan(
        folder, quick, chosen.shards or (10 if quick else 1000), chosen.large or (200 if quick else 100_000),
        tuple(int(count) for count in cold.split(",")), chosen.rounds or (1 if quick else 5),
        chosen.kills or (2 if quick else 100), chosen.mib or (2 if quick else 256),
        chosen.venvs, chosen.store, chosen.source)  # fmt: skip


def measure(part: str, rows: Callable[[Plan], list[Row]], about: str | None) -> int:
    """Measure a part and write its rows; returns 1 when a goal was missed."""
    chosen = parser(about or part).parse_args()
    folder = Path(tempfile.mkdtemp(prefix=f"runner-{part}-"))
    try:
        found = rows(plan_of(chosen, folder))
    finally:
        shutil.rmtree(folder, ignore_errors=True)
    for row in found:
        print(f"{part}: {row.what}: {row.measured} (goal: {row.goal or '-'})", flush=True)
    keep(chosen.out, part, found, chosen.quick)
    return 1 if any(row.reached is False for row in found) else 0


def keep(out: Path, part: str, rows: list[Row], quick: bool) -> None:
    """Replace the rows of a part, and write the page."""
    out.mkdir(parents=True, exist_ok=True)
    known = kept(out)
    known[part] = {"commit": head(), "quick": quick, "machine": machine(), "rows": [asdict(row) for row in rows]}
    (out / "rows.json").write_text(json.dumps(known, indent=1, sort_keys=True) + "\n")
    (out / "README.md").write_text(page(known))


def kept(out: Path) -> dict[str, Any]:
    """Rows of all parts that were measured before."""
    path = out / "rows.json"
    return dict(json.loads(path.read_text())) if path.exists() else {}


def machine() -> str:
    """Description of this machine."""
    cpu = next((line.partition(":")[2].strip() for line in _cpuinfo() if line.startswith("model name")), platform.machine())
    return f"{cpu}, {os.cpu_count()} cores, {platform.system()}, Python {platform.python_version()}"


def _cpuinfo() -> list[str]:
    path = Path("/proc/cpuinfo")
    return path.read_text().splitlines() if path.exists() else []


def page(known: dict[str, Any]) -> str:
    """The table, and the notes below it."""
    parts = [part for part in (*ORDER, *sorted(set(known) - set(ORDER))) if part in known]
    rows = [row for part in parts for row in known[part]["rows"]]
    about = sorted({_measured_on(known[part]) for part in parts})
    return "\n".join([
        "# The runner, measured", "",
        "CPU seconds are user and system of the whole process tree, with the start of Python; medians of interleaved rounds. "
        "Each row is written by a script of this folder, all of them by", "",
        "    PYTHONPATH=. python benchmarks/runner/all.py", "", *(f"{line}.  " for line in about), "",
        "| what | goal | measured | reached |", "|---|---|---|---|",
        *(f"| {row['what']} | {row['goal']} | {row['measured']} | {_reached(row['reached'])} |" for row in rows), "",
        *(f"* {row['what']}: {row['note']}" for row in rows if row["note"])]).rstrip() + "\n"


def _measured_on(part: dict[str, Any]) -> str:
    return f"{part['machine']}; commit {part['commit']}" + ("; --quick" if part["quick"] else "")


def _reached(reached: bool | None) -> str:
    return "" if reached is None else "yes" if reached else "**no**"


