"""Several rendered clips -> ONE EPIC-format root on disk: tables joined, class files united, everything else copied."""

from __future__ import annotations

import csv
import shutil
from collections.abc import Iterable
from pathlib import Path

from afford.synthetic.kitchens.write_epic import write_csv
from schemas.files import FileRef, FileTree

CLASS_FILES = ("EPIC_100_verb_classes.csv", "EPIC_100_noun_classes_v2.csv")


def write_root(trees: Iterable[FileTree], root: Path) -> None:
    """Write all files of `trees` (the `files` and, when wanted, the `truth` of rendered clips) under `root`.

    Raises ValueError when two clips bring different files of the same name that are no tables, or rows with the same key that
    differ.
    """
    by_name: dict[str, list[FileRef]] = {}
    for tree in trees:
        for file in tree.files:
            by_name.setdefault(file.name, []).append(file)
    for name in sorted(by_name):
        _write(root / name, by_name[name])


def _write(path: Path, files: list[FileRef]) -> None:
    path.parent.mkdir(parents=True, exist_ok=True)
    if path.suffix == ".csv":
        _join(path, files, by_id=path.name in CLASS_FILES)
    elif len({file.digest for file in files}) > 1:
        raise ValueError(f"{files[0].name}: two clips bring different files of this name; give them different video ids")
    else:
        shutil.copyfile(files[0].path, path)


def _join(path: Path, files: list[FileRef], by_id: bool) -> None:
    rows: dict[str, dict[str, str]] = {}
    columns: tuple[str, ...] = ()
    for file in files:
        with file.path.open(newline="", encoding="utf-8") as stream:
            reader = csv.DictReader(stream)
            columns = columns or tuple(reader.fieldnames or ())
            for row in reader:
                key = row[columns[0]]
                if rows.setdefault(key, row) != row:
                    raise ValueError(f"{path.name}: {columns[0]} {key} has two different rows; give clips different video ids")
    ordered = sorted(rows.values(), key=lambda row: int(row[columns[0]])) if by_id else list(rows.values())
    write_csv(path, columns, ordered)
