"""Tables of recording summaries for people, and JSON output."""

from __future__ import annotations

import json
import sys
from collections.abc import Callable
from typing import Any

from rich.console import Console
from rich.markup import escape
from rich.table import Table

from afford.recording.summary import Summary

SORTS: dict[str, Callable[[Summary], Any]] = {
    "name": lambda s: s.path,
    "messages": lambda s: -s.messages,
    "seconds": lambda s: -s.seconds,
    "bytes": lambda s: -s.bytes,
    "problem": lambda s: (not s.problem, s.path),
}
MANY_PROBLEMS = 8
JSON_ONLY = ("stage", "schema_version", "log_time")
"""metadata that only --json shows"""
NARROW = 55
"""width of the number columns"""


def show_one(found: Summary, problems: list[str], strict: bool) -> None:
    """Print topics, provenance and verdict of one recording."""
    console = _console(max((len(topic.topic) + len(topic.schema) for topic in found.topics), default=0) + NARROW)
    span = f"{found.start_s:.2f} s to {found.start_s + found.seconds:.2f} s, {found.chunks} chunk(s)"
    counts = f"{size(found.bytes)}, {found.messages} messages on {len(found.topics)} topics"
    console.print(f"[bold]{escape(found.path)}[/]  {counts}, {span}", highlight=False, soft_wrap=True)
    if found.topics:
        console.print(_topics(found))
    for name, values in sorted((found.metadata or {}).items()):
        shown = {key: text for key, text in values.items() if key not in JSON_ONLY}
        text = "  ".join(f"[dim]{escape(key)}[/] {escape(_short(text))}" for key, text in shown.items())
        console.print(f"[bold]{escape(name)}[/]  {text}", highlight=False, soft_wrap=True)
    if found.attachments:
        console.print(f"[bold]attachments[/]  {escape(', '.join(found.attachments))}", highlight=False)
    _problems(console, problems)
    console.print(_verdict(problems, strict), highlight=False)


def show_many(found: list[tuple[Summary, list[str]]], sort: str) -> None:
    """Print one line per recording, in an order of SORTS."""
    table = Table(box=None)
    table.add_column("recording", no_wrap=True)
    for title in ("topics", "messages", "seconds", "Hz", "size"):
        table.add_column(title, justify="right", no_wrap=True)
    table.add_column("problem", overflow="fold")
    for summary, problems in sorted(found, key=lambda item: SORTS[sort](item[0])):
        rate = max((topic.hz for topic in summary.topics), default=0.0)
        table.add_row(escape(summary.path), str(len(summary.topics)), str(summary.messages), f"{summary.seconds:.2f}",
                      f"{rate:.1f}", size(summary.bytes), f"[red]{escape(problems[0])}[/]" if problems else "")  # fmt: skip
    console = _console(max(len(summary.path) for summary, _ in found) + 2 * NARROW)
    console.print(table)
    bad = sum(bool(problems) for _, problems in found)
    verdict = f"[red]{bad} with problems[/]" if bad else "[green]no problem found[/]"
    console.print(f"{len(found)} recordings, {size(sum(summary.bytes for summary, _ in found))}: {verdict}")


def print_json(value: Any) -> None:
    """Print one JSON object on one line."""
    sys.stdout.write(json.dumps(value, sort_keys=True) + "\n")


def size(count: int) -> str:
    """Format a size in bytes: 1536 -> '1.5 kB'."""
    number, unit = float(count), "B"
    for larger in ("kB", "MB", "GB"):
        if number < 1000:
            break
        number, unit = number / 1000, larger
    return f"{number:.1f} {unit}" if unit != "B" else f"{count} B"


def _console(width: int) -> Console:
    """Console wide enough for long names, also in a narrow terminal."""
    console = Console()
    console.width = max(console.width, width)
    return console


def _topics(found: Summary) -> Table:
    table = Table(box=None)
    table.add_column("topic", no_wrap=True)
    table.add_column("schema", no_wrap=True)
    for title in ("messages", "Hz", "gap s", "payload", "share"):
        table.add_column(title, justify="right", no_wrap=True)
    total = sum(topic.bytes for topic in found.topics) or 1
    for t in found.topics:
        table.add_row(escape(t.topic), t.schema, str(t.messages), f"{t.hz:.1f}", f"{t.longest_gap_s:.2f}", size(t.bytes),
                      f"{100 * t.bytes / total:.1f} %")  # fmt: skip
    return table


def _problems(console: Console, problems: list[str]) -> None:
    for problem in problems[:MANY_PROBLEMS]:
        console.print(f"[red]problem[/] {escape(problem)}", highlight=False)
    if len(problems) > MANY_PROBLEMS:
        console.print(f"[red]and {len(problems) - MANY_PROBLEMS} more[/]")


def _verdict(problems: list[str], strict: bool) -> str:
    if problems:
        return f"[bold red]{len(problems)} problem(s)[/]"
    whole, glance = "intact: every checksum, index and payload is valid", "no problem in the index (--strict reads everything)"
    return f"[bold green]{whole}[/]" if strict else f"[green]{glance}[/]"


def _short(text: str) -> str:
    """Shorten digests to twelve letters, and cut long text."""
    if len(text) == 64 and all(letter in "0123456789abcdef" for letter in text):
        return text[:12]
    return text if len(text) <= 100 else text[:97] + "..."
