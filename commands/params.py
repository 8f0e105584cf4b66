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

TITLES = ("parameter", "type", "default", "meaning")


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
    """On a terminal the meaning stands under each parameter; for a program each is one line. Names are whole in both."""
    if not sys.stdout.isatty():
        widths = [max(len(cell) for cell in column) for column in zip(TITLES, *rows, strict=True)]
        lines = ["  ".join(cell.ljust(width) for cell, width in zip(row, widths, strict=True)).rstrip() for row in (TITLES, *rows)]
        sys.stdout.write("\n".join(lines) + "\n")
        return
    console = Console()
    for name, kind, default, doc in rows:
        console.print(f"[bold]{name}[/]  {escape(default)}  [dim]{escape(kind)}[/]", highlight=False, overflow="fold")
        console.print(Padding(escape(doc), (0, 0, 0, 4)), highlight=False)
