"""Recordings as moments: all decoded messages of one time."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, field
from itertools import groupby
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from mcap.reader import make_reader
from mcap_protobuf.decoder import DecoderFactory

from afford.common.drawing import TILE_W
from afford.recording.mcap_files import EPOCH_NS

IMAGE_SCHEMA = "foxglove.CompressedImage"


@dataclass(frozen=True)
class Moment:
    """Messages of one media time; a topic can have several."""

    time_ns: int
    """media time"""
    values: dict[str, list[Any]] = field(default_factory=dict)

    def one(self, topic: str) -> Any:
        """Last message of a topic, None without any at this time."""
        return self.values[topic][-1] if topic in self.values else None

    def picture(self, topic: str) -> np.ndarray | None:
        """Picture of a topic, (h, w), (h, w, 3) or (h, w, 4) uint8 in RGB order; None without any at this time."""
        found = self.one(topic)
        return None if found is None else decode(found.data)


def decode(data: bytes) -> np.ndarray:
    """Decode a JPEG or PNG to RGB order; ValueError for a damaged picture."""
    pixels = cv2.imdecode(np.frombuffer(data, np.uint8), cv2.IMREAD_UNCHANGED)
    if pixels is None:
        raise ValueError("a picture of the recording cannot be decoded; `inspect --strict` says which")
    if pixels.ndim == 2:
        return pixels
    return cv2.cvtColor(pixels, cv2.COLOR_BGRA2RGBA if pixels.shape[2] == 4 else cv2.COLOR_BGR2RGB)


def moments(path: Path, topics: list[str] | None = None, times_ns: list[int] | None = None) -> Iterator[Moment]:
    """Yield moments in time order: of some topics or all, at some media times or all."""
    with path.open("rb") as stream:
        reader = make_reader(stream, validate_crcs=True, decoder_factories=[DecoderFactory()])
        instants = [None] if times_ns is None else [EPOCH_NS + t for t in sorted(times_ns)]
        for at in instants:
            found = reader.iter_decoded_messages(topics=topics, starting_at=at, ending_at=at)
            for time_ns, group in groupby(found, key=lambda item: item[2].log_time):
                moment = Moment(time_ns - EPOCH_NS)
                for _, channel, _, value in group:
                    moment.values.setdefault(channel.topic, []).append(value)
                yield moment


def tile_of(moment: Moment, picture: str, overlay: str, width: int = TILE_W, edges: bool = True) -> np.ndarray | None:
    """Picture with its overlay, (h, width, 3), None without a picture; `edges` draws the overlay's edges opaque."""
    image = moment.picture(picture)
    if image is None:
        return None
    layer = moment.picture(overlay) if overlay else None
    if layer is not None:
        image = _laid(image, layer, edges)
    return cv2.resize(image, (width, round(image.shape[0] * width / image.shape[1])), interpolation=cv2.INTER_AREA)


def _laid(image: np.ndarray, layer: np.ndarray, edges: bool) -> np.ndarray:
    """Blend an RGBA overlay over a picture."""
    alpha = layer[..., 3:].astype(np.float32) / 255
    mixed = (image * (1 - alpha) + layer[..., :3] * alpha).astype(np.uint8)
    if edges:
        code = layer[..., :3].astype(np.int32) @ np.array([65536, 256, 1]) * (layer[..., 3] > 0)
        edge = cv2.morphologyEx(code.astype(np.float32), cv2.MORPH_GRADIENT, np.ones((3, 3), np.uint8)) > 0
        edge &= layer[..., 3] > 0
        mixed[edge] = layer[..., :3][edge]
    return mixed
