"""The verb `export`: write the last data set, or the rendered clips, in a format that other tools read."""

from __future__ import annotations

import sys
from pathlib import Path

from afford.common.registry import load
from commands.errors import UsageError, unknown
from commands.origin import origin
from commands.outputs import PART
from commands.session import open_runner
from commands.settings import settings
from commands.targets import build

FORMATS = {
    "2hands": "afford.dataset.export_2hands:export",
    "coco": "afford.dataset.exports:export_coco",
    "webdataset": "afford.dataset.exports:export_webdataset",
    "epic": "afford.synthetic.kitchens.epic_files:write_root",
}


def export(format: str, folder: Path, source: Path | None, store: Path | None) -> int:
    """Write into a new or empty folder.

    `epic` writes the rendered clips with their ground truth; the other formats write the last data set.
    """
    if format not in FORMATS:
        raise unknown("format", format, FORMATS)
    if folder.exists() and (not folder.is_dir() or any(folder.iterdir())):
        raise UsageError(f"{folder}: the folder is not empty; give a new or empty one")
    runner = open_runner(store)
    if format == "epic":
        place, _ = origin("scenes", source, settings((), None), lambda path: runner.hash_file(path)[0])
        report = runner.run(build("scenes", place, settings((), None)), "scenes")
        clips = [runner.load(digest) for _, digest in next(iter(report.outputs.values()))]
        load(FORMATS, format)([tree for clip in clips for tree in (clip.files, clip.truth)], folder)
        for clip in clips:
            sys.stdout.write(f"{folder}: {clip.files.name}\n")
        return 0 if report.ok else 1
    name = source.resolve().name if source else "synthetic"
    dataset = runner.store.root / "datasets" / name
    if not dataset.is_dir():
        part = dataset.with_name(f"{name}{PART}")
        hint = f"; {part} is partial, `run dataset --replace` publishes it as {name}" if part.is_dir() else ""
        make = f"make dataset{f' SOURCE={source}' if source else ''}"
        raise UsageError(f"{dataset}: no data set there; run `{make}` first{hint}")
    folder.mkdir(parents=True, exist_ok=True)
    files = load(FORMATS, format)(dataset, folder)
    sys.stdout.write(f"{len(files)} files in {folder}\n")
    return 0
