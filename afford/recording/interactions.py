"""Recorder and contact sheet of RGB-D interactions: frames, motion, predictions of a model, on the model's grid.

Frame i is i / rate_hz after the fixed base of all recordings. The motion at frame i is the one that led to it, as in the model's
input; the first frame has none.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from pathlib import Path

import cv2
import numpy as np
from foxglove_schemas_protobuf.Log_pb2 import Log
from mcap.reader import make_reader

from afford.common.drawing import pad_tile, title_row
from afford.common.image_files import PNG, encode_png, jpeg, overlay_png
from afford.dataset.packed_sequences import PackedSequence
from afford.recording.mcap_files import EPOCH_NS, Message, Recording
from afford.recording.messages import SECOND_NS, ActionState, channel, image, image_channel, log, stamped
from afford.recording.moments import moments, tile_of
from afford.rgbd.prediction import COLOURS, Prediction, attention_heat, likeliest_action
from schemas.interaction import AFFORDANCES

FRAME, DEPTH, DEPTH_COLOUR = "/interaction_read/image", "/interaction_read/depth", "/interaction_read/depth_colour"
FLOW, TRUTH = "/scene_flow/image", "/interaction_label/overlay"
LIKELIEST, CONFIDENT, ATTENTION = "/sor3d/overlay", "/sor3d/confident", "/sor3d/attention"
ACTION, LOG = "/sor3d/action", "/sor3d/log"
PALETTE = [COLOURS[name] for name in AFFORDANCES]


def record_interaction(shown: PackedSequence, found: Sequence[Prediction], rate_hz: float, threshold: float) -> Recording:
    """Record a sequence at the model's size with its motion in space and a prediction for each of its frames.

    ValueError when they do not fit.
    """
    if len(found) != len(shown.rgb) or found[0].label.shape != shown.label.shape or len(shown.flow) != len(shown.rgb) - 1:
        raise ValueError(f"{shown.name}: expected an answer for each of {len(shown.rgb)} frames of {shown.label.shape} px, and the "
                         f"motion between them, got {len(found)} of {found[0].label.shape} px and {len(shown.flow)}")
    named = {name: list(colour) for name, colour in COLOURS.items()}
    pictures = [FRAME, FLOW, *([ATTENTION] if found[0].attention.size else [])]
    channels = [image_channel(topic) for topic in (*pictures, DEPTH_COLOUR)]
    channels += [image_channel(DEPTH, unit="millimetres, 16 bit, 0 = hole")]
    channels += [image_channel(topic, palette=named) for topic in (LIKELIEST, CONFIDENT, TRUTH)]
    channels += [channel(ACTION, ActionState), channel(LOG, Log)]
    return Recording(tuple(channels), _messages(shown, found, rate_hz, threshold))


def _messages(shown: PackedSequence, found: Sequence[Prediction], rate_hz: float, threshold: float) -> Iterator[Message]:
    height, width = shown.label.shape
    still = np.broadcast_to(shown.still, (1, height, width, 3))
    span = _depth_span(shown.depth_m)
    for n, (rgb, depth_m, moved, prediction) in enumerate(zip(shown.rgb, shown.depth_m, [*still, *shown.flow], found, strict=True)):
        time_ns = EPOCH_NS + round(n * SECOND_NS / rate_hz)
        yield image(FRAME, time_ns, jpeg(rgb), "jpeg")
        yield image(DEPTH, time_ns, encode_png((1000 * depth_m).round().clip(0, 65535).astype(np.uint16), PNG).tobytes())
        yield image(DEPTH_COLOUR, time_ns, encode_png(_depth_colours(depth_m, span), PNG).tobytes())
        yield image(FLOW, time_ns, _png(moved))
        yield image(LIKELIEST, time_ns, _overlay(prediction.label))
        yield image(CONFIDENT, time_ns, _overlay(prediction.confident(threshold)))
        if prediction.attention.size:
            yield image(ATTENTION, time_ns, _png(attention_heat(prediction.attention, height, width)))
        yield stamped(ACTION, time_ns, ActionState(
            step=n, said=likeliest_action(prediction.action),
            **{name: float(p) for name, p in zip(AFFORDANCES, prediction.action, strict=True)}))
    yield image(TRUTH, time_ns, _overlay(shown.label))
    yield log(LOG, time_ns, f"{shown.object_type}: {shown.affordance} is done, {likeliest_action(found[-1].action)} was said",
              shown.name)  # fmt: skip


def _png(rgb: np.ndarray) -> bytes:
    return encode_png(np.ascontiguousarray(rgb[..., ::-1]), PNG).tobytes()


def _overlay(label: np.ndarray) -> bytes:
    """Overlay of the affordances, transparent for background."""
    return overlay_png(np.stack([label == n for n in range(len(AFFORDANCES))]), PALETTE)


def _depth_span(depth_m: np.ndarray) -> tuple[float, float]:
    """Nearest and farthest depth of a sequence without the extreme percent on each side; 0 and 1 without depth."""
    known = depth_m[depth_m > 0]
    return (float(np.quantile(known, 0.01)), float(np.quantile(known, 0.99))) if known.size else (0.0, 1.0)


def _depth_colours(depth_m: np.ndarray, span: tuple[float, float]) -> np.ndarray:
    """Colours (h, w, 3) uint8 BGR of depth: near is yellow, far is dark blue, holes are black."""
    near, far = span
    grey = (255 * (1 - (depth_m - near) / max(far - near, 1e-6)).clip(0, 1)).round().astype(np.uint8)
    colour = cv2.applyColorMap(grey, cv2.COLORMAP_VIRIDIS)
    colour[depth_m == 0] = 0
    return colour


SHOWN, SIDE = 10, 150
"""maximum number of frames, spread evenly up to the last one; width of a tile in px"""
ROWS = {"frames": (FRAME, ""), "motion that led to them": (FLOW, ""), "depth": (DEPTH_COLOUR, ""),
        "likeliest affordance": (FRAME, LIKELIEST), "affordance, confident": (FRAME, CONFIDENT), "attention": (ATTENTION, ""),
        "true affordance of the last frame": (FRAME, TRUTH)}  # fmt: skip
"""title -> picture and overlay"""


def is_interaction(path: Path) -> bool:
    """Return True for a recording of an interaction."""
    with path.open("rb") as stream:
        summary = make_reader(stream).get_summary()
    return summary is not None and any(channel.topic == ACTION for channel in summary.channels.values())


def interaction_strips(path: Path) -> list[np.ndarray]:
    """Strips of the contact sheet with titles: frames, motion, depth, predictions, attention, truth."""
    every = list(moments(path))
    chosen = [every[int(k)] for k in np.linspace(0, len(every) - 1, min(SHOWN, len(every)))]
    strips = []
    for title, (picture, overlay) in ROWS.items():
        mine = chosen[-1:] if overlay == TRUTH else chosen
        tiles = [pad_tile(t) for moment in mine if (t := tile_of(moment, picture, overlay, SIDE, False)) is not None]
        if tiles:
            strip = np.concatenate(tiles, axis=1)
            strips += [title_row([title], max(strip.shape[1], 4 * SIDE), SIDE), strip]
    text = " ".join(line.message for moment in every for line in moment.values.get(LOG, []))
    return [title_row([f"{path.stem}   {text}"], 8 * SIDE, SIDE), *strips]
