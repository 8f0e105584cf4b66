"""Differences between two recordings by content: chunks, compression and library versions do not count."""

from __future__ import annotations

from collections.abc import Mapping
from itertools import zip_longest
from pathlib import Path

from afford.recording.mcap_files import EPOCH_NS, Channel, Message, Recording, open_recording

SECOND_NS = 10**9


def difference(one: Path, two: Path) -> list[str]:
    """List differences as sentences: topics, then metadata, then the first differing message; [] for equal content."""
    with open_recording(one) as a, open_recording(two) as b:
        return [*_channels(a, b), *_metadata(a.metadata, b.metadata), *_attachments(a, b), *_first_message(a, b)]


def _channels(a: Recording, b: Recording) -> list[str]:
    left, right = ({channel.topic: channel for channel in r.channels} for r in (a, b))
    alone = {topic: "first" if topic in left else "second" for topic in sorted(left.keys() ^ right.keys())}
    lines = [f"topic {topic} is only in the {which}" for topic, which in alone.items()]
    return lines + [text for topic in sorted(left.keys() & right.keys()) for text in _channel(left[topic], right[topic])]


def _channel(a: Channel, b: Channel) -> list[str]:
    names = ("schema", "definition", "metadata")
    return [f"topic {a.topic} has another {name}" for name in names if getattr(a, name) != getattr(b, name)]


def _metadata(a: Mapping[str, Mapping[str, str]], b: Mapping[str, Mapping[str, str]]) -> list[str]:
    lines = []
    for name in sorted({*a, *b}):
        left, right = a.get(name, {}), b.get(name, {})
        lines += [f"metadata {name}.{key}: {left.get(key, 'nothing')} became {right.get(key, 'nothing')}"
                 for key in sorted({*left, *right}) if left.get(key) != right.get(key)]  # fmt: skip
    return lines


def _attachments(a: Recording, b: Recording) -> list[str]:
    left, right = ({item.name: item for item in r.attachments} for r in (a, b))
    return [f"attachment {name} differs" for name in sorted({*left, *right}) if left.get(name) != right.get(name)]


def _first_message(a: Recording, b: Recording) -> list[str]:
    for left, right in zip_longest(a.messages, b.messages):
        if left != right:
            return [_first_difference(left, right)]
    return []


def _first_difference(left: Message | None, right: Message | None) -> str:
    if left is None or right is None or (left.time_ns, left.topic) != (right.time_ns, right.topic):
        alone = min((m for m in (left, right) if m is not None), key=lambda m: (m.time_ns, m.topic))
        return f"first difference: {_where(alone)} is only in the {'first' if alone is left else 'second'}"
    return f"first difference: {_where(left)}, {len(left.data)} against {len(right.data)} bytes"


def _where(message: Message) -> str:
    return f"{message.topic} at {(message.time_ns - EPOCH_NS) / SECOND_NS:.6f} s"
