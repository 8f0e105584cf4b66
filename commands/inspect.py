"""The verb `inspect`: show the content, integrity and pictures of recordings and artifacts.

An artifact is described by its fields, their shapes and types, and the sizes of its files; no array is decoded.
"""

from __future__ import annotations

import json
import os
import re
import shutil
import sys
from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any

from rich.console import Console
from rich.markup import escape
from rich.table import Table

from afford.recording.summary import Summary, summarise
from commands.errors import UsageError, unknown
from commands.inspect_tables import SORTS, print_json, show_many, show_one, size

if TYPE_CHECKING:
    from runner import Runner

SUFFIX = ".mcap"
PICTURES = (".png", ".jpg", ".jpeg", ".webp", ".bmp", ".tif", ".tiff")
"""suffixes for contact sheets; .png is lossless"""
VIEWER, DISPLAYS = "rerun", ("DISPLAY", "WAYLAND_DISPLAY")
DIGEST = re.compile("[0-9a-f]{4,64}")


@dataclass(frozen=True)
class Options:
    """Options of `inspect`."""

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
    """Summary and problems of one recording."""

    summary: Summary
    problems: list[str] = field(default_factory=list)


def inspect(paths: Sequence[str], options: Options) -> int:
    """Inspect recordings (files or folders of them) or one artifact (a digest).

    Returns 0 when all is fine, 1 for a problem. UsageError for a wrong call.
    """
    if options.sort not in SORTS:
        raise unknown("--sort", options.sort, SORTS)
    if options.diff:
        return _difference(paths, options)
    if len(paths) == 1 and DIGEST.fullmatch(paths[0]) and not Path(paths[0]).exists():
        return inspect_artifact(paths[0], options.store, options.json)
    files = _recordings(paths)
    _one_only(files, options)
    _named(options)
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
            raise UsageError(f"{path}: no such path; give recordings, a folder of them, or the digest of one artifact")
        inside = sorted(p for p in path.rglob(f"*{SUFFIX}")) if path.is_dir() else [path]
        if not inside:
            raise UsageError(f"{path}: no recordings ({SUFFIX}) here; make some with `pipeline.py run dataset`")
        found += inside
    return found


def _one_only(files: list[Path], options: Options) -> None:
    if len(files) > 1 and (options.rerun or options.save or options.layout):
        raise UsageError(f"--rerun, --save and --layout: expected one recording, got {len(files)}; name one of them")


def _named(options: Options) -> None:
    """Check the suffix of the contact sheet, which selects its format."""
    if options.sheet and options.sheet.suffix.lower() not in PICTURES:
        raise UsageError(f"--sheet {options.sheet}: expected a name with one of the suffixes {', '.join(PICTURES)}")


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
    """Write pictures and open viewers, which load more than a summary needs."""
    if options.sheet:
        from afford.recording.contact_sheet import write_sheet

        _fitting("--sheet", lambda out: write_sheet(files, out), options.sheet)
    if options.save:
        from afford.recording import rerun_viewer

        _fitting("--save", lambda out: rerun_viewer.save(files[0], out), options.save)
    if options.rerun:
        _show(files[0])


def _show(path: Path) -> None:
    """Open the viewer that is installed next to this Python; its environment need not be active.

    UsageError without a viewer or a display.
    """
    program = shutil.which(VIEWER, path=str(Path(sys.executable).parent)) or shutil.which(VIEWER)
    if program is None:
        raise UsageError(f"--rerun: the program {VIEWER} is not installed next to {sys.executable}; run `make setup`")
    if sys.platform == "linux" and not any(os.environ.get(name) for name in DISPLAYS):
        file = f"{path.stem}.rrd"
        raise UsageError(f"--rerun: no display, since neither {' nor '.join(DISPLAYS)} is set; write a file with "
                         f"`--save {file}`, and open it in a browser with `{program} {file} --web-viewer`")
    from afford.recording import rerun_viewer

    rerun_viewer.show(path, program)


def _lay_out(found: Summary, out: Path | None) -> None:
    if out:
        from afford.recording.foxglove_layout import layout

        _fitting("--layout", lambda path: path.write_text(json.dumps(layout(found), indent=1) + "\n", encoding="utf-8"), out)


def _fitting(option: str, write: Callable[[Path], object], out: Path) -> None:
    """Write a view, and report it.

    UsageError where the recordings hold no data of that kind, or the file cannot be written.
    """
    try:
        out.parent.mkdir(parents=True, exist_ok=True)
        write(out)
    except ValueError as error:
        raise UsageError(f"{option}: {error}") from error
    except OSError as error:
        raise UsageError(f"{option} {out}: the file cannot be written ({error.strerror or error})") from error
    Console(stderr=True).print(f"wrote {out}", highlight=False, soft_wrap=True)


def _difference(paths: Sequence[str], options: Options) -> int:
    files = _recordings(paths)
    if len(files) != 2:
        raise UsageError(f"--diff: expected two recordings, got {len(files)}")
    from afford.recording.difference import difference

    differences: list[Any] = difference(*files)
    if options.json:
        print_json({"differences": differences, "ok": not differences})
    else:
        sys.stdout.write("\n".join(differences or ["the same content"]) + "\n")
    return int(bool(differences))


VALUE = "value.json"
MANY = 3
"""elements shown of a list"""


def inspect_artifact(artifact: str, store: Path | None, as_json: bool) -> int:
    """Describe the artifact with this digest or digest prefix.

    Returns 1 when its files are damaged or lost. UsageError when there is no such artifact.
    """
    from commands.session import open_existing  # loads the engine, which a recording does not need
    from runner import LostError

    runner = open_existing(store)
    with runner.reading():
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
    print_json(about) if as_json else _show_artifact(about)
    return 0


def _describe(runner: Runner, digest: str) -> dict[str, Any]:
    children = runner.children(digest)
    if children is not None:
        return {"digest": digest, "kind": runner.kind(digest), "children": dict(children)}
    files = runner.files(digest)
    tree = json.loads(files[VALUE].read_text(encoding="ascii"))
    fields = {name: _described(part) for name, part in tree["fields"].items()}
    sizes = {name: path.stat().st_size for name, path in sorted(files.items())}
    return {"digest": digest, "kind": runner.kind(digest), "fields": fields, "files": sizes}


def _described(part: Any) -> str:
    """Describe one field: a plain value as text, an array by type, shape and encoding, a list by length."""
    if isinstance(part, list):
        inside = ", ".join(_described(item) for item in part[:MANY])
        return f"{len(part)}: {inside}{', ...' if len(part) > MANY else ''}"
    if not isinstance(part, dict):
        return str(part)
    if "of" in part:
        first = next((value for value in part["fields"].values() if isinstance(value, (str, int))), "")
        return f"{part['of']} {first}".strip()
    ((encoding, where),) = part.items()
    return str(where) if encoding == "float" else _array(encoding, where)


def _array(encoding: str, where: list[Any]) -> str:
    """Describe an array reference of the codec (afford/codecs/pools.py).

    The shape is its last entry; the type precedes the shape or is fixed.
    """
    *_, shape = where
    dtype = {"raw": where[0], "zstd": where[-2], "rle": "bool", "video": "uint8"}[encoding]
    return f"{dtype} ({' '.join(str(n) for n in shape)}), {encoding}"


def _show_artifact(about: dict[str, Any]) -> None:
    console = Console()
    made = f", made by {about['stage']} {about['shard']}" if "stage" in about else ", from outside the pipeline"
    console.print(f"[bold]{about['kind']}[/] {about['digest'][:12]}{escape(made)}", highlight=False)
    for title in ("fields", "children", "files"):
        if title in about:
            table = Table(title, "", box=None)
            for name, value in about[title].items():
                table.add_row(escape(name), size(value) if title == "files" else escape(str(value)))
            console.print(table)
