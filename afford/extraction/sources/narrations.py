"""Narrations of one video from EPIC-KITCHENS-100's 15-column tables or own tables, class maps and frame rates.

Own tables need a sentence and an interval; verb and nouns are parsed from imperative sentences if they are not given: 'pick up
the red mug' -> pick-up, mug:red. The first word is the verb, particles join it, the last word before a preposition is the head of
a noun.
"""

from __future__ import annotations

import math
import re
from collections.abc import Callable

from afford.common.errors import SourceError
from afford.extraction.sources.rows import Note
from afford.extraction.sources.tables import UNKNOWN, Classes, header, read_classes, read_table, whole_number, word_list
from schemas.files import FileRef, FileTree
from schemas.video import Narration

COLUMNS = (
    "narration_id", "participant_id", "video_id", "narration_timestamp", "start_timestamp", "stop_timestamp", "start_frame",
    "stop_frame", "narration", "verb", "verb_class", "noun", "noun_class", "all_nouns", "all_noun_classes")


def read_epic_narrations(data: bytes, name: str, video_id: str, verbs: Classes, nouns: Classes) -> list[Narration]:
    """Read the narrations of `video_id`; rows of other videos are ignored. SourceError names the wrong line and column."""
    rows = read_table(data, name, COLUMNS)
    return [_narration(row, where, verbs, nouns) for where, row in rows if _belongs(row, video_id)]


def _belongs(row: dict[str, str], video_id: str) -> bool:
    """Test for a row of this video, also by its narration id where the column of the video is empty."""
    return row["video_id"] == video_id or (not row["video_id"] and row["narration_id"].startswith(f"{video_id}_"))


def _narration(row: dict[str, str], where: str, verbs: Classes, nouns: Classes) -> Narration:
    verb_class, verb_key = verbs.look_up(row["verb"], _number(row, "verb_class", where))
    noun_class, noun_key = nouns.look_up(row["noun"], _number(row, "noun_class", where))
    start, stop = _number(row, "start_frame", where), _number(row, "stop_frame", where)
    refuse_reversed(start, stop, where)
    return Narration(
        narration_id=row["narration_id"], start_frame=start, stop_frame=stop, text=row["narration"], verb=row["verb"],
        verb_class=verb_class, verb_key=verb_key, noun=row["noun"], noun_class=noun_class, noun_key=noun_key,
        all_nouns=word_list(row["all_nouns"], f"{where}, column 'all_nouns'"))


def refuse_reversed(start: int, stop: int, where: str) -> None:
    """Raise SourceError for an interval that ends before it starts."""
    if stop < start:
        raise SourceError(where, "a stop that is not before the start", f"frames {start} to {stop}", "correct the row")


def _number(row: dict[str, str], column: str, where: str) -> int:
    try:
        return whole_number(row[column])
    except ValueError as error:
        label = f"{where}, column {column!r}"
        raise SourceError(label, "a whole number", repr(row[column]), "correct or remove the row") from error


STANDARD = ("EPIC_100_train.csv", "EPIC_100_validation.csv")
"""tables that must have EPIC's 15 columns; other EPIC_100_*.csv files are read if they have them"""
INFO = "EPIC_100_video_info.csv"
FASTEST = 1e6
"""largest valid frame rate, 1/s"""
NO_SAMPLES = "without narrations it gives no samples"
DEFAULT_TASK = ("hold", "object")
"""verb and noun of a video without narrations"""


def frame_rates(files: FileTree) -> dict[str, float]:
    """Read video id -> frames per second from the video info table. SourceError for an invalid rate."""
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


def video_narrations(
    files: FileTree, frame_at: Callable[[float], int], notes: list[Note], silent: str = NO_SAMPLES
) -> list[Narration]:
    """Read the narrations of the video in file order, each id once. SourceError for a malformed table.

    silent: end of the remark on a video without narrations.
    """
    verbs, nouns = _classes(files, "verb_classes"), _classes(files, "noun_classes")
    found: dict[str, Narration] = {}
    for file in _tables(files):
        data = file.path.read_bytes()
        if file.name in STANDARD or set(COLUMNS) <= set(header(data, file.name)):
            rows = read_epic_narrations(data, file.name, files.name, verbs, nouns)
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


def default_narration(first: int, last: int) -> Narration:
    """Build the narration of a video without narrations: a touched object is held."""
    verb, noun = DEFAULT_TASK
    return Narration(
        narration_id="untold", start_frame=first, stop_frame=last, text=f"{verb} {noun}", verb=verb, verb_class=UNKNOWN,
        verb_key=verb, noun=noun, noun_class=UNKNOWN, noun_key=noun, all_nouns=(noun,))


def _classes(files: FileTree, kind: str) -> Classes:
    """Read the newest class map of a kind (v2 sorts last); an empty map if the source has no such table."""
    maps = [file for file in files.files if kind in file.name and file.name.endswith(".csv")]
    return read_classes(maps[-1].path.read_bytes(), maps[-1].name) if maps else Classes()


def _tables(files: FileTree) -> list[FileRef]:
    return [file for file in files.files if file.name.endswith(".csv") and "_classes" not in file.name and file.name != INFO]


TIME_COLUMNS = {"start": ("start", "start_s", "start_timestamp"), "stop": ("stop", "stop_s", "stop_timestamp", "end", "end_s")}
FRAME_COLUMNS = {"start": ("start_frame",), "stop": ("stop_frame", "end_frame")}
FrameAt = Callable[[float], int]
"""function from seconds since the start of the video to the frame number"""


def read_own_narrations(data: bytes, name: str, frame_at: FrameAt, verbs: Classes, nouns: Classes) -> list[Narration]:
    """Read every row of an own table in file order. SourceError names the wrong line and column.

    Without columns `verb` and `noun`, both are parsed from the sentence.
    """
    start, stop = _column(data, name, "start"), _column(data, name, "stop")
    found = []
    for number, (where, row) in enumerate(read_table(data, name, ("narration",))):
        interval = _frame(row, start, where, frame_at), _frame(row, stop, where, frame_at)
        found.append(_own_narration(number, row, where, interval, verbs, nouns))
    return found


def _column(data: bytes, name: str, end: str) -> str:
    choices = (*FRAME_COLUMNS[end], *TIME_COLUMNS[end])
    there = header(data, name)
    found = next((column for column in choices if column in there), None)
    if found is None:
        raise SourceError(name, f"a column {' or '.join(choices)}", f"columns {', '.join(there)}", "add it")
    return found


def _frame(row: dict[str, str], column: str, where: str, frame_at: FrameAt) -> int:
    text = row[column].strip()
    try:
        return whole_number(text) if column.endswith("_frame") else frame_at(seconds(text))
    except ValueError as error:
        expected = "a whole number" if column.endswith("_frame") else "seconds, mm:ss or hh:mm:ss"
        raise SourceError(f"{where}, column {column!r}", expected, repr(text), "correct or remove the row") from error


def seconds(text: str) -> float:
    """Parse 12.5, 1:02.5 and 00:01:02.50 as seconds; ValueError for other text, and for a time that is not finite."""
    parts = [float(part) for part in text.split(":")]
    total = sum(part * 60**power for power, part in enumerate(reversed(parts)))
    if len(parts) > 3 or min(parts) < 0 or not math.isfinite(total):
        raise ValueError(text)
    return total


def _own_narration(
    number: int, row: dict[str, str], where: str, interval: tuple[int, int], verbs: Classes, nouns: Classes
) -> Narration:
    refuse_reversed(*interval, where)
    parsed_verb, parsed_nouns = verb_and_nouns(row["narration"])
    verb = row.get("verb", "").strip() or parsed_verb
    all_nouns = (row["noun"].strip(),) if row.get("noun", "").strip() else parsed_nouns
    noun = all_nouns[0] if all_nouns else ""
    verb_class, verb_key = verbs.look_up(verb, None)
    noun_class, noun_key = nouns.look_up(noun, None)
    return Narration(
        narration_id=row.get("narration_id") or str(number), start_frame=interval[0], stop_frame=interval[1],
        text=row["narration"], verb=verb, verb_class=verb_class, verb_key=verb_key, noun=noun, noun_class=noun_class,
        noun_key=noun_key, all_nouns=all_nouns)


PARTICLES = {"up", "down", "on", "off", "in", "out", "away", "over", "back", "together", "apart"}
PREPOSITIONS = {"into", "onto", "in", "on", "from", "to", "with", "of", "under", "over", "for", "at", "by", "inside", "and",
                "through", "around", "off", "out", "using", "against", "towards", "near"}
SKIPPED = {"the", "a", "an", "some", "my", "his", "her", "their", "this", "that", "both", "then"}


def verb_and_nouns(text: str) -> tuple[str, tuple[str, ...]]:
    """Parse the (verb, nouns) of a sentence, in EPIC's spelling: verb-particle, head:modifiers; ('', ()) for an empty one."""
    found = [word for word in re.findall(r"[^\W_]+(?:'[^\W_]+)?", text.lower()) if word not in SKIPPED]
    if not found:
        return "", ()
    particle = len(found) > 1 and found[1] in PARTICLES
    verb = "-".join(found[: 1 + particle])
    return verb, tuple(_noun(group) for group in _noun_groups(found[1 + particle :]))


def _noun_groups(found: list[str]) -> list[list[str]]:
    groups: list[list[str]] = [[]]
    for word in found:
        if word in PREPOSITIONS:
            groups.append([])
        else:
            groups[-1].append(word)
    return [group for group in groups if group]


def _noun(group: list[str]) -> str:
    return ":".join([group[-1], *group[:-1]])
