"""Read UniDexGrasp's lists of objects: one YAML file for each of three splits, every object in every size.

A line is `'core/bottle-<hash>': [0.06, 0.1]`. The files are named by split: train.yaml, unseen_objects.yaml,
unseen_categories.yaml. Written after the description of the data set; never run on the real lists.
"""

from __future__ import annotations

import re
from collections import Counter

import numpy as np

from afford.common.errors import SourceError
from afford.common.text import read_utf8
from schemas.files import FileRef, FileTree
from schemas.grasp import SPLITS, GraspObjects

LINE = re.compile(r"""^(['"]?)(?P<code>[\w./-]+)\1\s*:\s*\[(?P<scales>[^\]]+)\]$""")
SCALES = (0.01, 1.0)
Row = tuple[str, str, str, float]


def read(files: FileTree) -> GraspObjects:
    """Read all three splits; SourceError for a missing split, a malformed line, or an object in the wrong split."""
    rows = [row for split in SPLITS for row in sorted(_split(_file(files, f"{split}.yaml"), split))]
    _apart(files.name, rows)
    code, category, split, scale = zip(*rows, strict=True)
    return GraspObjects(files.name, code, category, split, np.array(scale))


def category(code: str) -> str:
    """Return the category of an object code: bottle for core/bottle-1a2b and for sem/Bottle-1a2b."""
    return code.rpartition("/")[2].split("-")[0].lower()


def _split(file: FileRef, split: str) -> list[Row]:
    out: list[Row] = []
    for number, line in enumerate(read_utf8(file.path, file.name).splitlines(), 1):
        if line.strip() and not line.startswith("#"):
            out += [(code, category(code), split, scale) for code, scale in _line(f"{file.name}, line {number}", line.strip())]
    counts = Counter(out)
    twice = next((row for row in out if counts[row] > 1), None)
    if twice is not None or not out:
        got = f"{twice[0]} at {twice[3]} twice" if twice else "nothing"
        raise SourceError(file.name, "objects, each size once", got, "correct the list")
    return out


def _line(where: str, line: str) -> list[tuple[str, float]]:
    found = LINE.match(line)
    try:
        scales = [float(word) for word in found["scales"].split(",")] if found else []
    except ValueError:
        scales = []
    if found is None or not scales or not all(SCALES[0] <= scale <= SCALES[1] for scale in scales):
        raise SourceError(where, f"'code': [scale, ...] with scales of {SCALES[0]} to {SCALES[1]}", repr(line), "correct the line")
    return [(found["code"], scale) for scale in scales]


def _apart(name: str, rows: list[Row]) -> None:
    """Check that no object is in two splits, and that no category of the last split is in the first."""
    of = {split: {row[0] for row in rows if row[2] == split} for split in SPLITS}
    for k, split in enumerate(SPLITS):
        shared = sorted(set().union(*(of[other] for other in SPLITS[:k])) & of[split])
        if shared:
            raise SourceError(f"{name}, {split}.yaml", "objects of no other split", shared[0], "remove it from one of them")
    known = {category(code) for code in of[SPLITS[0]]}
    seen = sorted(code for code in of[SPLITS[2]] if category(code) in known)
    if seen:
        raise SourceError(f"{name}, {SPLITS[2]}.yaml", "categories that train.yaml lacks", seen[0],
                          "move it to unseen_objects.yaml")


def _file(files: FileTree, name: str) -> FileRef:
    found = files.find(name)
    if found is None:
        raise SourceError(files.name, f"a file {name}", "no such file", f"name the lists {', '.join(SPLITS)}.yaml")
    return found
