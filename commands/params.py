"""`params`: every parameter of every stage."""

from __future__ import annotations

import dataclasses
import json as encoder
import sys

from rich.console import Console
from rich.markup import escape
from rich.padding import Padding

from commands.errors import unknown
from commands.settings import described
from maps.settings import Settings

PIPED_WIDTH = 100
"""columns where no terminal says how many"""


def show(stage: str | None, json: bool) -> int:
    """Print name, type, what holds when nothing is said, and meaning; UsageError for an unknown stage."""
    stages = {field.name: field.default for field in dataclasses.fields(Settings)}
    if stage and stage.replace("-", "_") not in stages:
        raise unknown("stage", stage, stages)
    chosen = {name: value for name, value in stages.items() if stage in (None, name, name.replace("_", "-"))}
    rows = [(name, *row) for name, value in chosen.items() for row in described(value)]
    if json:
        columns = ("stage", "name", "type", "default", "doc")
        sys.stdout.write(encoder.dumps([dict(zip(columns, row, strict=True)) for row in rows]) + "\n")
        return 0
    _print([(f"{name}.{field}", kind, repr(default), doc) for name, field, kind, default, doc in rows])
    return 0


def _print(rows: list[tuple[str, str, str, str]]) -> None:
    """The meaning stands under each parameter, wrapped; nothing is cut, on a terminal or in a pipe."""
    console = Console(width=None if sys.stdout.isatty() else PIPED_WIDTH)
    for name, kind, default, doc in rows:
        console.print(f"[bold]{name}[/]  {escape(default)}  [dim]{escape(kind)}[/]", highlight=False, overflow="fold")
        console.print(Padding(escape(doc), (0, 0, 0, 4)), highlight=False, overflow="fold")
