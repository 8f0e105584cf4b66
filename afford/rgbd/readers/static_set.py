"""Pictures of a root, listed before any is decoded -> those that are asked for, read one by one; one that is bad stops no other."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import NamedTuple

from afford.common.errors import SourceError
from schemas.interaction import StaticSample, StaticSet


class Listed(NamedTuple):
    """A picture that is not read yet."""

    split: str
    """train, val or test; '' when the source does not say"""
    read: Callable[[], StaticSample]


def gathered(source: str, listed: Sequence[Listed], split: str) -> StaticSet:
    """Pictures of one split, '' for all. SourceError when there is none, or none of them can be read."""
    wanted = [one for one in listed if split in ("", one.split)]
    if not wanted:
        known = ", ".join(sorted({one.split for one in listed} - {""})) or "none at all"
        raise SourceError(f"{source}, static_read.split", f"a split that the root has ({known})", repr(split), "leave it out")
    found = [_tried(one) for one in wanted]
    samples = tuple(one for one in found if isinstance(one, StaticSample))
    refused = tuple(one for one in found if isinstance(one, str))
    if not samples:
        got = f"none of {len(wanted)}, of which the first: {refused[0]}"
        raise SourceError(source, "one picture at least that can be read", got, "see docs/rgbd/interaction-data.md")
    return StaticSet(samples, refused)


def _tried(one: Listed) -> StaticSample | str:
    """The picture, or the sentence that says why not."""
    try:
        return one.read()
    except SourceError as error:
        return str(error)
