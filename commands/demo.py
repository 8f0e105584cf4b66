"""The verb `demo`: a local web page that predicts with a trained model."""

from __future__ import annotations

import errno
from pathlib import Path
from typing import TYPE_CHECKING

from rich.console import Console
from rich.markup import escape

from commands.errors import UsageError
from commands.publish import FILES
from commands.session import STORE, open_existing
from runner import LostError, is_store

if TYPE_CHECKING:
    from afford.twohands.demo.examples import Example
    from afford.twohands.model.model_folder import ModelFolder

LAST_PORT = 65535


def demo(host: str, port: int, model: Path | None, device: str, store: Path | None) -> int:
    """Serve until the user stops it.

    UsageError when there is no model, or the address cannot be used.
    """
    if not 0 <= port <= LAST_PORT:
        raise UsageError(f"--port {port}: expected a port from 0 (any free port) to {LAST_PORT}")
    from commands.predict import open_model

    stored, predictor = open_model(model, store, device)
    from afford.twohands.demo.server import Site
    from afford.twohands.demo.service import PredictionService

    ask = PredictionService(predictor, stored)
    console = Console(stderr=True)
    try:
        site = Site(host, port, ask, ask.about(), _examples(stored, store or STORE, console))
    except OSError as error:
        wanted = "that is free; stop what listens there, or give --port 0" if error.errno == errno.EADDRINUSE else "of this machine"
        raise UsageError(f"--host {host} --port {port}: the address must be one {wanted} ({error})") from error
    console.print(f"model {escape(stored.name)} {stored.digest[:12]}", highlight=False)
    console.print(f"[bold]{site.url}[/]  (Ctrl+C stops it)", highlight=False)
    if not site.is_local:
        console.print("[yellow]every machine that reaches this one can use the model[/]")
    with site:
        try:
            site.serve_forever()
        except KeyboardInterrupt:
            console.print("stopped")
    return 0


def _examples(model: ModelFolder, store: Path, console: Console) -> list[Example]:
    """Example pictures: those beside a shipped model, else stills of a benchmark, else of the data set of the model's training.

    Unreadable examples, and their absence, are reported.
    """
    from afford.twohands.demo.examples import beside, examples, held_out

    try:
        found = beside(model.folder) or examples(store / "benchmarks") or held_out(_learned_from(model, store))
    except (ValueError, OSError) as error:
        console.print(f"[yellow]no examples[/] {escape(str(error))}", highlight=False, soft_wrap=True)
        return []
    if not found:
        console.print(f"no examples: {escape(str(store))} holds neither stills of `run benchmark-set` nor pictures of the data set "
                      "that the model was trained on", highlight=False, soft_wrap=True)  # fmt: skip
    return found


def _learned_from(model: ModelFolder, store: Path) -> dict[str, Path]:
    """Name -> file of the training set that a model's card names; empty if the store does not hold it."""
    from afford.twohands.demo.examples import data_set

    digest = data_set(model.folder)
    if digest is None or not is_store(store):
        return {}
    try:
        found = open_existing(store).files(digest)
    except LostError:
        return {}
    return {name.removeprefix(FILES): path for name, path in found.items() if name.startswith(FILES)}
