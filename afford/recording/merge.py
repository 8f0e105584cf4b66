"""Several recordings of one clip -> one, in time order."""

from __future__ import annotations

import heapq
from collections.abc import Mapping, Sequence
from contextlib import ExitStack
from operator import attrgetter
from pathlib import Path

from afford.recording.content import Attachment, Channel, Recording
from afford.recording.files import opened, write


def merge(parts: Sequence[Path], path: Path, metadata: Mapping[str, Mapping[str, str]]) -> None:
    """Write one recording out of several, with `metadata` added; ValueError when two of them use one name differently."""
    with ExitStack() as stack:
        recordings = [stack.enter_context(opened(part)) for part in parts]
        messages = heapq.merge(*(r.messages for r in recordings), key=attrgetter("time_ns", "topic"))
        write(path, Recording(_channels(recordings), messages, _metadata(recordings, metadata), _attachments(recordings)))


def _channels(recordings: Sequence[Recording]) -> tuple[Channel, ...]:
    topics: dict[str, Channel] = {}
    schemas: dict[str, bytes] = {}
    for channel in (c for r in recordings for c in r.channels):
        if channel.topic in topics:
            raise ValueError(f"topic {channel.topic}: expected in one part only, got it twice")
        if schemas.setdefault(channel.schema, channel.definition) != channel.definition:
            raise ValueError(f"schema {channel.schema}: expected one definition, got two; record the parts again")
        topics[channel.topic] = channel
    return tuple(topics.values())


def _metadata(recordings: Sequence[Recording], more: Mapping[str, Mapping[str, str]]) -> dict[str, Mapping[str, str]]:
    merged: dict[str, Mapping[str, str]] = {}
    for name, values in [*more.items(), *(item for r in recordings for item in r.metadata.items())]:
        if name in merged:
            raise ValueError(f"metadata {name}: expected in one part only, got it twice")
        merged[name] = values
    return merged


def _attachments(recordings: Sequence[Recording]) -> tuple[Attachment, ...]:
    return tuple(item for recording in recordings for item in recording.attachments)
