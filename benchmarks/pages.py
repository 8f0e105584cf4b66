"""Blocks of pages that scripts write, and the targets whose figures they hold."""

from __future__ import annotations

import json
import re
import subprocess
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import cv2
import numpy as np

ROOT = Path(__file__).resolve().parent.parent
PICTURE_PX, QUALITY = 1100, 85
"""width of a picture of a page, and its JPEG quality"""
TOOK = re.compile(r"`make [\w-]+` took .*\n\n")
"""how long a target took, at the head of a block"""


def make(target: str, store: str | None, *more: str) -> dict[str, Any]:
    """The JSON summary of a target."""
    command = [sys.executable, str(ROOT / "pipeline.py"), "run", target, "--json", *more, *(["--store", store] if store else [])]
    done = subprocess.run(command, stdout=subprocess.PIPE, text=True, check=True)
    found: dict[str, Any] = json.loads(done.stdout.strip().splitlines()[-1])
    return found


def into(page: Path, name: str, by: str, block: str) -> None:
    """Replace what stands between the two marks of a page; `by` is the script that its mark names. SystemExit without marks."""
    before, _, after = _parts(page, name, by)
    page.write_text(f"{before}{block}{after}")


def stack_sheets(sheets: Sequence[Path], name: str) -> None:
    """Write docs/pictures/<name>: sheets of recordings, equally wide, one below the other. SystemExit without a sheet."""
    if not sheets:
        raise SystemExit(f"{name}: expected the sheet of a recording, got none")
    found = [np.asarray(cv2.imread(str(sheet))) for sheet in sheets]
    narrow = [cv2.resize(one, (PICTURE_PX, round(one.shape[0] * PICTURE_PX / one.shape[1])), interpolation=cv2.INTER_AREA)
              for one in found]  # fmt: skip
    cv2.imwrite(str(ROOT / "docs" / "pictures" / name), np.concatenate(narrow), [cv2.IMWRITE_JPEG_QUALITY, QUALITY])


def took(page: Path, name: str, by: str, line: str) -> str:
    """Return `line`, the run time of a target, or the line of the block when `line` is empty (the target was cached).

    Raises SystemExit without marks.
    """
    kept = TOOK.match(_parts(page, name, by)[1])
    return line or (kept.group() if kept else "")


def head() -> str:
    """The commit that is checked out."""
    command = ("git", "rev-parse", "--short", "HEAD")
    return subprocess.run(command, cwd=ROOT, stdout=subprocess.PIPE, text=True, check=True).stdout.strip()


def _parts(page: Path, name: str, by: str) -> tuple[str, str, str]:
    """A page up to its block, the block, and the rest."""
    start, end = f"<!-- {name}: written by benchmarks/{by} -->", f"<!-- end of {name} -->"
    before, found, rest = page.read_text().partition(start)
    if not found or end not in rest:
        raise SystemExit(f"{page}: expected the marks of the part {name}")
    block, _, after = rest.partition(end)
    return f"{before}{start}\n", block.removeprefix("\n"), f"{end}{after}"
