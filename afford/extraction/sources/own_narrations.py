"""The narration table of one's own video: start and stop in frames, seconds or hh:mm:ss, and a sentence."""

from __future__ import annotations

import math
from collections.abc import Callable

from afford.common.errors import SourceError
from afford.extraction.sources.classes import Classes
from afford.extraction.sources.narrations import refuse_reversed
from afford.extraction.sources.tables import header, read_table, whole
from afford.extraction.sources.words import verb_and_nouns
from schemas.video import Narration

TIME_COLUMNS = {"start": ("start", "start_s", "start_timestamp"), "stop": ("stop", "stop_s", "stop_timestamp", "end", "end_s")}
FRAME_COLUMNS = {"start": ("start_frame",), "stop": ("stop_frame", "end_frame")}
FrameAt = Callable[[float], int]
"""seconds from the start of the video -> frame number"""


def read_own_narrations(data: bytes, name: str, frame_at: FrameAt, verbs: Classes, nouns: Classes) -> list[Narration]:
    """Every row, in file order. SourceError names the line and column that is wrong.

    Without columns `verb` and `noun` they are read off the sentence.
    """
    start, stop = _column(data, name, "start"), _column(data, name, "stop")
    found = []
    for number, (where, row) in enumerate(read_table(data, name, ("narration",))):
        interval = _frame(row, start, where, frame_at), _frame(row, stop, where, frame_at)
        found.append(_narration(number, row, where, interval, verbs, nouns))
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
        return whole(text) if column.endswith("_frame") else frame_at(seconds(text))
    except ValueError as error:
        expected = "a whole number" if column.endswith("_frame") else "seconds, mm:ss or hh:mm:ss"
        raise SourceError(f"{where}, column {column!r}", expected, repr(text), "correct or remove the row") from error


def seconds(text: str) -> float:
    """12.5, 1:02.5 and 00:01:02.50 as seconds; ValueError otherwise, also for a time that is not finite."""
    parts = [float(part) for part in text.split(":")]
    total = sum(part * 60**power for power, part in enumerate(reversed(parts)))
    if len(parts) > 3 or min(parts) < 0 or not math.isfinite(total):
        raise ValueError(text)
    return total


def _narration(
    number: int, row: dict[str, str], where: str, interval: tuple[int, int], verbs: Classes, nouns: Classes
) -> Narration:
    refuse_reversed(*interval, where)
    said_verb, said_nouns = verb_and_nouns(row["narration"])
    verb = row.get("verb", "").strip() or said_verb
    all_nouns = (row["noun"].strip(),) if row.get("noun", "").strip() else said_nouns
    noun = all_nouns[0] if all_nouns else ""
    verb_class, verb_key = verbs.look_up(verb, None)
    noun_class, noun_key = nouns.look_up(noun, None)
    return Narration(
        narration_id=row.get("narration_id") or str(number), start_frame=interval[0], stop_frame=interval[1],
        text=row["narration"], verb=verb, verb_class=verb_class, verb_key=verb_key, noun=noun, noun_class=noun_class,
        noun_key=noun_key, all_nouns=all_nouns)
