"""Blocks of pages that scripts write, and the targets whose figures they hold."""

from __future__ import annotations

import json
import subprocess
import sys
from pathlib import Path
from typing import Any

ROOT = Path(__file__).resolve().parent.parent


def make(target: str, store: str | None, *more: str) -> dict[str, Any]:
    """The JSON summary of a target."""
    command = [sys.executable, str(ROOT / "pipeline.py"), "run", target, "--json", *more, *(["--store", store] if store else [])]
    done = subprocess.run(command, stdout=subprocess.PIPE, text=True, check=True)
    found: dict[str, Any] = json.loads(done.stdout.strip().splitlines()[-1])
    return found


def into(page: Path, name: str, by: str, block: str) -> None:
    """Replace what stands between the two marks of a page; `by` is the script that its mark names. SystemExit without marks."""
    start, end = f"<!-- {name}: written by benchmarks/{by} -->", f"<!-- end of {name} -->"
    before, found, rest = page.read_text().partition(start)
    if not found or end not in rest:
        raise SystemExit(f"{page}: expected the marks of the part {name}")
    page.write_text(f"{before}{start}\n{block}{end}{rest.partition(end)[2]}")
