"""`params`: every parameter of every stage."""

from __future__ import annotations

import dataclasses
import json as encoder
import sys

from rich.console import Console
from rich.markup import escape
from rich.table import Table

from commands.errors import unknown
from commands.settings import described
from maps.settings import Settings


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
    table = Table("parameter", "type", "default", "meaning", box=None)
    for name, field, kind, default, doc in rows:
        table.add_row(f"{name}.{field}", escape(kind), escape(repr(default)), escape(doc))
    Console().print(table)
    return 0
