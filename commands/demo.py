"""The verb `demo`: a page on this machine where a trained model is asked about a picture."""

from __future__ import annotations

import errno
from pathlib import Path
from typing import TYPE_CHECKING

from rich.console import Console
from rich.markup import escape

from commands.errors import UsageError
from commands.session import STORE

if TYPE_CHECKING:
    from afford.demo.examples import Example

LAST_PORT = 65535


def demo(host: str, port: int, model: Path | None, device: str, store: Path | None) -> int:
    """Serve until the user stops it. UsageError when there is no model, or the address cannot be had."""
    if not 0 <= port <= LAST_PORT:
        raise UsageError(f"--port {port}: expected a port of 0 (any that is free) to {LAST_PORT}")
    from commands.predict import open_model

    stored, predictor = open_model(model, store, device)
    from afford.demo.answer import Asker
    from afford.demo.server import Site

    ask = Asker(predictor, stored)
    console = Console(stderr=True)
    try:
        site = Site(host, port, ask, ask.about(), _examples((store or STORE) / "benchmarks", console))
    except OSError as error:
        wanted = "that is free; stop what listens there, or give --port 0" if error.errno == errno.EADDRINUSE else "of this machine"
        raise UsageError(f"--host {host} --port {port}: expected an address {wanted} ({error})") from error
    console.print(f"model {escape(stored.name)} {stored.digest[:12]}", highlight=False)
    console.print(f"[bold]{site.url}[/]  (Ctrl+C stops it)", highlight=False)
    if not site.is_local:
        console.print("[yellow]every machine that reaches this one can ask the model[/]")
    with site:
        try:
            site.serve_forever()
        except KeyboardInterrupt:
            console.print("stopped")
    return 0


def _examples(benchmarks: Path, console: Console) -> list[Example]:
    """Pictures to begin with; a set that cannot be read is named and left out."""
    from afford.demo.examples import examples

    try:
        return examples(benchmarks)
    except (ValueError, OSError) as error:
        console.print(f"[yellow]no examples[/] {escape(str(error))}", highlight=False, soft_wrap=True)
        return []
