"""The verb `demo`: a page on this machine where a trained model is asked about a picture."""

from __future__ import annotations

from pathlib import Path

from rich.console import Console
from rich.markup import escape

from commands.errors import UsageError
from commands.session import STORE


def demo(host: str, port: int, model: Path | None, device: str, store: Path | None) -> int:
    """Serve until the user stops it. UsageError when there is no model, or the address cannot be had."""
    from commands.predict import open_model

    stored, predictor = open_model(model, store, device)
    from afford.demo.answer import Asker
    from afford.demo.examples import examples
    from afford.demo.server import Site

    ask = Asker(predictor, stored)
    console = Console(stderr=True)
    try:
        site = Site(host, port, ask, ask.about(), examples((store or STORE) / "benchmarks"))
    except (OSError, OverflowError) as error:
        raise UsageError(f"--host {host} --port {port}: expected an address that is free on this machine, got: {error}") from error
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
