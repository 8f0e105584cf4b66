"""Tables, text and JSON on standard output."""

from __future__ import annotations

import json
import sys
from typing import Any

from rich.console import Console
from rich.table import Table

PIPED_WIDTH = 1000
"""width in columns without a terminal, so that long paths are not cut in a pipe"""


def console() -> Console:
    """Console as wide as the terminal, or as the longest line in a pipe."""
    return Console(width=None if sys.stdout.isatty() else PIPED_WIDTH)


def plain_table(*titles: str, folded: str = "") -> Table:
    """Table without a frame, whose columns are never cut; the last column, `folded`, wraps."""
    table = Table(box=None)
    for title in titles:
        table.add_column(title, no_wrap=True)
    if folded:
        table.add_column(folded, overflow="fold")
    return table


def print_json(value: Any) -> None:
    """Print one JSON object as one line."""
    sys.stdout.write(json.dumps(value, sort_keys=True, default=str) + "\n")
