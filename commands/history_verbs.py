"""Options of `runs` and its verbs; the implementations are in `commands.history`."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from commands.options import Json, Store

app = typer.Typer(invoke_without_command=True)


@app.callback()
def runs(
    context: typer.Context,
    count: Annotated[int, typer.Option("-n", min=1, help="number of runs")] = 20,
    store: Store = None,
    json: Json = False,
) -> None:
    """List past runs, the newest first; `runs diff` compares two, `runs timeline` draws one."""
    if context.invoked_subcommand is None:
        from commands.history import runs as show

        raise typer.Exit(show(store, count, json))


@app.command("diff")
def runs_diff(
    a: Annotated[str, typer.Argument(help="a run: its id, a beginning of it, last, or last~1 for the one before")],
    b: Annotated[str, typer.Argument(help="the run to compare it with")],
    store: Store = None,
    json: Json = False,
) -> None:
    """Show the stages that differ between two runs, the reasons, and differences of outputs and costs."""
    from commands.history import diff

    raise typer.Exit(diff(a, b, store, json))


@app.command("timeline")
def runs_timeline(
    run: Annotated[str, typer.Argument(help="a run: its id, a beginning of it, last, or last~1 for the one before")] = "last",
    out: Annotated[Path, typer.Option("--out", help="draw to this .svg or .png")] = Path("timeline.svg"),
    store: Store = None,
) -> None:
    """Draw the tasks of a run over time, with cores and memory in use."""
    from commands.history import timeline

    raise typer.Exit(timeline(run, out, store))
