"""Narrations of EPIC-KITCHENS-100: the 15-column CSV -> `Narration`s of one video, in file order."""

from __future__ import annotations

from afford.common.errors import SourceError
from afford.extraction.sources.classes import Classes
from afford.extraction.sources.tables import read_table, whole, words
from schemas.video import Narration

COLUMNS = (
    "narration_id", "participant_id", "video_id", "narration_timestamp", "start_timestamp", "stop_timestamp", "start_frame",
    "stop_frame", "narration", "verb", "verb_class", "noun", "noun_class", "all_nouns", "all_noun_classes")


def read_narrations(data: bytes, name: str, video_id: str, verbs: Classes, nouns: Classes) -> list[Narration]:
    """Rows of `video_id`; rows of other videos are not looked at. SourceError names the line and column that is wrong."""
    rows = read_table(data, name, COLUMNS)
    return [_narration(row, where, verbs, nouns) for where, row in rows if _belongs(row, video_id)]


def _belongs(row: dict[str, str], video_id: str) -> bool:
    """Of this video, also when the row is too broken to say so in its own column."""
    return row["video_id"] == video_id or (not row["video_id"] and row["narration_id"].startswith(f"{video_id}_"))


def _narration(row: dict[str, str], where: str, verbs: Classes, nouns: Classes) -> Narration:
    verb_class, verb_key = verbs.look_up(row["verb"], _number(row, "verb_class", where))
    noun_class, noun_key = nouns.look_up(row["noun"], _number(row, "noun_class", where))
    start, stop = _number(row, "start_frame", where), _number(row, "stop_frame", where)
    refuse_reversed(start, stop, where)
    return Narration(
        narration_id=row["narration_id"], start_frame=start, stop_frame=stop, text=row["narration"], verb=row["verb"],
        verb_class=verb_class, verb_key=verb_key, noun=row["noun"], noun_class=noun_class, noun_key=noun_key,
        all_nouns=words(row["all_nouns"], f"{where}, column 'all_nouns'"))


def refuse_reversed(start: int, stop: int, where: str) -> None:
    """SourceError when an interval ends before it starts."""
    if stop < start:
        raise SourceError(where, "a stop that is not before the start", f"frames {start} to {stop}", "correct the row")


def _number(row: dict[str, str], column: str, where: str) -> int:
    try:
        return whole(row[column])
    except ValueError as error:
        label = f"{where}, column {column!r}"
        raise SourceError(label, "a whole number", repr(row[column]), "correct or remove the row") from error
