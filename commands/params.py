"""The verb `params`: list every parameter of every stage, by system."""

from __future__ import annotations

import json as encoder
import sys

from rich.console import Console
from rich.markup import escape
from rich.padding import Padding

from commands.errors import unknown
from commands.settings import Parameter, parameters_of
from maps.settings import SYSTEM_OF, SYSTEMS, Settings

PIPED_WIDTH = 100
"""width in columns without a terminal"""
COLUMNS = ("system", "stage", "name", "type", "default", "doc", "selected")


def show(word: str | None, json: bool) -> int:
    """Print name, type, default and meaning of the parameters: all, of a system, or of a stage.

    UsageError for another word.
    """
    wanted = (word or "").replace("-", "_")
    if word and wanted not in (*SYSTEMS, *SYSTEM_OF):
        raise unknown("stage", word, SYSTEM_OF)
    chosen = Settings()
    rows = [(system, stage, *row) for stage, system in SYSTEM_OF.items() if not wanted or wanted in (stage, system)
            for row in parameters_of(chosen.params(stage))]  # fmt: skip
    if json:
        sys.stdout.write(encoder.dumps([dict(zip(COLUMNS, row, strict=True)) for row in rows]) + "\n")
        return 0
    for system in dict.fromkeys(row[0] for row in rows):
        _print(system, [(stage, Parameter(*row)) for home, stage, *row in rows if home == system])
    return 0


def _print(system: str, rows: list[tuple[str, Parameter]]) -> None:
    """Print the meaning under each parameter, wrapped, never cut.

    A line above each block of a backend says whether this backend is selected.
    """
    console = Console(width=None if sys.stdout.isatty() else PIPED_WIDTH)
    console.print(f"[bold underline]{system}[/]", highlight=False)
    before = ""
    for stage, one in rows:
        block, dot, _ = one.name.rpartition(".")
        if dot and f"{stage}.{block}" != before:
            used = "selected" if one.selected else f"used with {stage}.backend={block}"
            console.print(f"[bold]{stage}.{block}[/]  [dim]{used}[/]", highlight=False, overflow="fold")
        before = f"{stage}.{block}" if dot else ""
        console.print(f"[bold]{stage}.{one.name}[/]  {escape(repr(one.value))}  [dim]{escape(one.type)}[/]", highlight=False,
                      overflow="fold")
        console.print(Padding(escape(one.doc), (0, 0, 0, 4)), highlight=False, overflow="fold")
