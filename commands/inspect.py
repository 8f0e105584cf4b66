"""The verb `inspect`: what recordings and artifacts hold, whether they are whole, and how they look."""

from __future__ import annotations

import json
import re
import sys
from collections.abc import Sequence
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Any

from rich.console import Console

from afford.recording.summary import Summary, summarise
from commands.errors import UsageError, unknown
from commands.inspect_tables import SORTS, print_json, show_many, show_one

SUFFIX = ".mcap"
DIGEST = re.compile("[0-9a-f]{4,64}")


@dataclass(frozen=True)
class Options:
    """What is asked for beside the summary."""

    json: bool = False
    strict: bool = False
    sheet: Path | None = None
    rerun: bool = False
    save: Path | None = None
    layout: Path | None = None
    diff: bool = False
    sort: str = "name"
    store: Path | None = None


@dataclass
class Verdict:
    """One recording: what it holds and what is wrong with it."""

    summary: Summary
    problems: list[str] = field(default_factory=list)


def inspect(paths: Sequence[str], options: Options) -> int:
    """Recordings (files or folders of them) or one artifact (a digest); 0 fine, 1 a problem. UsageError for a wrong call."""
    if options.sort not in SORTS:
        raise unknown("--sort", options.sort, SORTS)
    if options.diff:
        return _difference(paths, options)
    if len(paths) == 1 and DIGEST.fullmatch(paths[0]) and not Path(paths[0]).exists():
        from commands.inspect_artifact import inspect_artifact

        return inspect_artifact(paths[0], options.store, options.json)
    files = _recordings(paths)
    _one_only(files, options)
    verdicts = [_verdict(path, options.strict) for path in files]
    _tell(verdicts, options)
    if all(not verdict.summary.problem for verdict in verdicts):
        _views(files, options)
        _lay_out(verdicts[0].summary, options.layout)
    return int(any(verdict.problems for verdict in verdicts))


def _recordings(paths: Sequence[str]) -> list[Path]:
    found: list[Path] = []
    for path in map(Path, paths):
        if not path.exists():
            raise UsageError(f"{path}: expected a recording, a folder of them, or the digest of one artifact; no such path")
        inside = sorted(p for p in path.rglob(f"*{SUFFIX}")) if path.is_dir() else [path]
        if not inside:
            raise UsageError(f"{path}: expected recordings ({SUFFIX}), got none; make them with `pipeline.py run dataset`")
        found += inside
    return found


def _one_only(files: list[Path], options: Options) -> None:
    if len(files) > 1 and (options.rerun or options.save or options.layout):
        raise UsageError(f"--rerun, --save and --layout: expected one recording, got {len(files)}; name one of them")


def _verdict(path: Path, strict: bool) -> Verdict:
    summary = summarise(path)
    problems = [summary.problem] if summary.problem else []
    if strict:
        from afford.recording.check_file import check_file

        problems = check_file(path) or problems
    if strict and not problems:
        from afford.recording.check_content import check_content

        problems += check_content(path)
    return Verdict(summary, problems)


def _tell(verdicts: list[Verdict], options: Options) -> None:
    if options.json:
        tree = [{**asdict(v.summary), "problems": v.problems, "ok": not v.problems} for v in verdicts]
        print_json({"recordings": tree, "ok": all(not v.problems for v in verdicts)})
    elif len(verdicts) == 1:
        show_one(verdicts[0].summary, verdicts[0].problems, options.strict)
    else:
        show_many([(v.summary, v.problems) for v in verdicts], options.sort)


def _views(files: list[Path], options: Options) -> None:
    """Pictures and viewers, which load what a summary does not need."""
    if options.sheet:
        from afford.recording.sheet import write_sheet

        write_sheet(files, options.sheet)
        _made(options.sheet)
    if options.save:
        from afford.recording import viewer

        viewer.save(files[0], options.save)
        _made(options.save)
    if options.rerun:
        from afford.recording import viewer

        viewer.show(files[0])


def _lay_out(found: Summary, out: Path | None) -> None:
    if out:
        from afford.recording.layout import layout

        out.parent.mkdir(parents=True, exist_ok=True)
        out.write_text(json.dumps(layout(found), indent=1) + "\n", encoding="utf-8")
        _made(out)


def _made(path: Path) -> None:
    Console(stderr=True).print(f"wrote {path}", highlight=False, soft_wrap=True)


def _difference(paths: Sequence[str], options: Options) -> int:
    files = _recordings(paths)
    if len(files) != 2:
        raise UsageError(f"--diff: expected two recordings, got {len(files)}")
    from afford.recording.difference import difference

    said: list[Any] = difference(*files)
    if options.json:
        print_json({"differences": said, "ok": not said})
    else:
        sys.stdout.write("\n".join(said or ["the same content"]) + "\n")
    return int(bool(said))
