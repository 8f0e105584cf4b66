"""Every table about one video: narrations, verb and noun classes, frame rates."""

from __future__ import annotations

import math
from collections.abc import Callable

from afford.common.errors import SourceError
from afford.extraction.sources.classes import UNKNOWN, Classes, read_classes
from afford.extraction.sources.narrations import COLUMNS, read_narrations
from afford.extraction.sources.own_narrations import read_own_narrations
from afford.extraction.sources.rows import Note
from afford.extraction.sources.tables import header, read_table
from schemas.files import FileRef, FileTree
from schemas.video import Narration

STANDARD = ("EPIC_100_train.csv", "EPIC_100_validation.csv")
"""must have EPIC's 15 columns; other EPIC_100_*.csv files count when they have them"""
INFO = "EPIC_100_video_info.csv"
FASTEST = 1e6
"""frames per second of the fastest cameras"""
SILENT = "without narrations it gives no samples"
UNTOLD = ("hold", "object")
"""verb and noun where nothing was ever said"""


def frame_rates(files: FileTree) -> dict[str, float]:
    """Video id -> frames per second, from the video info table. SourceError when a rate is not a number."""
    info = files.find(INFO)
    rates: dict[str, float] = {}
    for where, row in read_table(info.path.read_bytes(), INFO, ("video_id", "fps")) if info else ():
        if row["video_id"] == files.name:
            rates[files.name] = _rate(row["fps"], where)
    return rates


def _rate(text: str, where: str) -> float:
    try:
        rate = float(text)
    except ValueError:
        rate = math.nan
    if not 0 < rate <= FASTEST:
        raise SourceError(f"{where}, column 'fps'", f"a rate above 0 and up to {FASTEST:g}", repr(text), "correct the row")
    return rate


def read_speech(files: FileTree, frame_at: Callable[[float], int], notes: list[Note], silent: str = SILENT) -> list[Narration]:
    """The narrations of the video, in file order, each id once; `silent` says what it means when there is none. SourceError when a
    table is malformed.
    """
    verbs, nouns = _classes(files, "verb_classes"), _classes(files, "noun_classes")
    found: dict[str, Narration] = {}
    for file in _tables(files):
        data = file.path.read_bytes()
        if file.name in STANDARD or set(COLUMNS) <= set(header(data, file.name)):
            rows = read_narrations(data, file.name, files.name, verbs, nouns)
        elif file.name.startswith("EPIC_100_"):
            continue
        else:
            rows = read_own_narrations(data, file.name, frame_at, verbs, nouns)
        for row in rows:
            found.setdefault(row.narration_id, row)
    if not found:
        names = ", ".join(file.name for file in _tables(files)) or "any table"
        notes.append((0, f"no narration of {files.name} in {names}; {silent}"))
    return list(found.values())


def untold(first: int, last: int) -> Narration:
    """What is said of frames of which nobody says anything: whatever a hand touches there, it holds."""
    verb, noun = UNTOLD
    return Narration(
        narration_id="untold", start_frame=first, stop_frame=last, text=f"{verb} {noun}", verb=verb, verb_class=UNKNOWN,
        verb_key=verb, noun=noun, noun_class=UNKNOWN, noun_key=noun, all_nouns=(noun,))


def _classes(files: FileTree, kind: str) -> Classes:
    """The newest class map of a kind (v2 sorts last); an empty one when the source has none."""
    maps = [file for file in files.files if kind in file.name and file.name.endswith(".csv")]
    return read_classes(maps[-1].path.read_bytes(), maps[-1].name) if maps else Classes()


def _tables(files: FileTree) -> list[FileRef]:
    return [file for file in files.files if file.name.endswith(".csv") and "_classes" not in file.name and file.name != INFO]
