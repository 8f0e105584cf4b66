"""What an artifact of the store holds: its fields, their shapes and types, the size of its files. No array is decoded."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

from rich.console import Console
from rich.markup import escape
from rich.table import Table

from commands.errors import UsageError
from commands.inspect_tables import print_json, size
from commands.session import seen_runner
from runner import LostError, Runner

VALUE = "value.json"
MANY = 3
"""elements of a list that are shown"""


def inspect_artifact(artifact: str, store: Path | None, as_json: bool) -> int:
    """Describe the artifact of a digest (or its beginning); 1 when its files are damaged or lost, UsageError for none."""
    runner = seen_runner(store)
    try:
        found = runner.lineage(artifact)
    except ValueError as error:
        raise UsageError(str(error)) from error
    try:
        about = _describe(runner, found.digest)
    except LostError as error:
        Console(stderr=True).print(f"[red]{escape(str(error))}[/]", highlight=False)
        return 1
    about |= {"stage": found.trace.stage, "shard": found.trace.shard} if found.trace else {}
    print_json(about) if as_json else _show(about)
    return 0


def _describe(runner: Runner, digest: str) -> dict[str, Any]:
    children = runner.children(digest)
    if children is not None:
        return {"digest": digest, "kind": runner.kind(digest), "children": dict(children)}
    files = runner.files(digest)
    tree = json.loads(files[VALUE].read_text(encoding="ascii"))
    fields = {name: _told(part) for name, part in tree["fields"].items()}
    sizes = {name: path.stat().st_size for name, path in sorted(files.items())}
    return {"digest": digest, "kind": runner.kind(digest), "fields": fields, "files": sizes}


def _told(part: Any) -> str:
    """One field in words: a plain value as it is, an array by encoding, type and shape, a list by its length."""
    if isinstance(part, list):
        inside = ", ".join(_told(item) for item in part[:MANY])
        return f"{len(part)}: {inside}{', ...' if len(part) > MANY else ''}"
    if not isinstance(part, dict):
        return str(part)
    if "of" in part:
        first = next((value for value in part["fields"].values() if isinstance(value, (str, int))), "")
        return f"{part['of']} {first}".strip()
    ((encoding, where),) = part.items()
    return str(where) if encoding == "float" else _array(encoding, where)


def _array(encoding: str, where: list[Any]) -> str:
    """A reference of the codec (afford/codecs/pools.py): its shape comes last, its type stands before the shape or is fixed."""
    *_, shape = where
    dtype = {"raw": where[0], "zstd": where[-2], "rle": "bool", "video": "uint8"}[encoding]
    return f"{dtype} ({' '.join(str(n) for n in shape)}), {encoding}"


def _show(about: dict[str, Any]) -> None:
    console = Console()
    made = f", made by {about['stage']} {about['shard']}" if "stage" in about else ", from outside"
    console.print(f"[bold]{about['kind']}[/] {about['digest'][:12]}{escape(made)}", highlight=False)
    for title in ("fields", "children", "files"):
        if title in about:
            table = Table(title, "", box=None)
            for name, value in about[title].items():
                table.add_row(escape(name), size(value) if title == "files" else escape(str(value)))
            console.print(table)
