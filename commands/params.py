"""The verb `params`: list every parameter of every stage, by system."""

from __future__ import annotations

import dataclasses
import json as encoder
import sys
from collections.abc import Sequence

from rich.console import Console
from rich.markup import escape
from rich.padding import Padding
from rich.table import Table

from commands.errors import UsageError, unknown
from commands.settings import Parameter, parameters_of, settings
from maps.settings import PRESETS, SYSTEM_OF, SYSTEMS, Settings

PIPED_WIDTH = 100
"""width in columns without a terminal"""
COLUMNS = ("system", "stage", "name", "type", "default", "doc", "selected")


def show(word: str | None, json: bool, sets: Sequence[str] = (), paper: bool = False) -> int:
    """Print name, type, default and meaning of the parameters: all, of a system, or of a stage.

    With `paper` those that differ from the paper's, where the project has them. UsageError for another word.
    """
    wanted = (word or "").replace("-", "_")
    if word and wanted not in (*SYSTEMS, *SYSTEM_OF):
        raise unknown("stage", word, SYSTEM_OF)
    if paper:
        return _differences(wanted, json, settings(sets, None))
    chosen = settings(sets, None)
    rows = [(system, stage, *row) for stage, system in SYSTEM_OF.items() if not wanted or wanted in (stage, system)
            for row in parameters_of(chosen.params(stage))]  # fmt: skip
    if json:
        sys.stdout.write(encoder.dumps([dict(zip(COLUMNS, row, strict=True)) for row in rows]) + "\n")
        return 0
    for system in dict.fromkeys(row[0] for row in rows):
        _print(system, [(stage, Parameter(*row)) for home, stage, *row in rows if home == system])
    return 0


def _differences(wanted: str, json: bool, chosen: Settings) -> int:
    """Print the parameters that differ from those of a paper: stage, name, chosen value, value of the paper."""
    papers = {stage: preset for (stage, _, _), preset in reversed(PRESETS.items()) if wanted in ("", stage, SYSTEM_OF[stage])}
    if not papers:
        raise UsageError(f"--diff paper: no paper's parameters are known for {wanted}; they are for "
                         f"{', '.join(sorted({stage for stage, _, _ in PRESETS}))}")  # fmt: skip
    rows = [(stage, field.name, getattr(chosen.params(stage), field.name), getattr(preset, field.name))
            for stage, preset in sorted(papers.items()) for field in dataclasses.fields(preset)
            if getattr(chosen.params(stage), field.name) != getattr(preset, field.name)]  # fmt: skip
    if json:
        sys.stdout.write(encoder.dumps([dict(zip(("stage", "name", "chosen", "paper"), row, strict=True)) for row in rows]) + "\n")
        return 0
    table = Table("parameter", "chosen", "paper", box=None)
    for stage, name, mine, theirs in rows:
        table.add_row(f"{stage}.{name}", escape(repr(mine)), escape(repr(theirs)))
    Console(width=None if sys.stdout.isatty() else PIPED_WIDTH).print(table)
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
