"""Samples -> /sample_assemble/image, left, right, state, and a line of text per sample."""

from __future__ import annotations

from collections.abc import Iterator

from foxglove_schemas_protobuf.Log_pb2 import Log

from afford.common.image_files import mask_png
from afford.recording.content import EPOCH_NS, Message, Recording
from afford.recording.own_types import SampleState
from afford.recording.topics import channel, image, image_channel, log, stamped
from schemas.affordance import Sample, Samples
from schemas.video import SIDES, Frames

ROOM = "/sample_assemble"


def record(value: Samples, frames: Frames) -> Recording:
    """What the data set gets from this clip: the JPEG itself, both masks, the task."""
    masks = tuple(image_channel(f"{ROOM}/{side}", side=side, classes={"0": "background", "255": f"{side} affordance"})
                  for side in SIDES)  # fmt: skip
    channels = (image_channel(f"{ROOM}/image", rejected=dict(value.rejected)), *masks, channel(f"{ROOM}/state", SampleState),
                channel(f"{ROOM}/log", Log))  # fmt: skip
    return Recording(channels, _messages(value))


def _messages(value: Samples) -> Iterator[Message]:
    for sample in sorted(value.samples, key=lambda s: (s.time_ns, s.sample_id)):
        time_ns = EPOCH_NS + sample.time_ns
        yield image(f"{ROOM}/image", time_ns, sample.image_jpeg.tobytes(), "jpeg")
        for side, mask in zip(SIDES, sample.masks[:2], strict=True):
            yield image(f"{ROOM}/{side}", time_ns, mask_png(mask))
        yield stamped(f"{ROOM}/state", time_ns, _state(sample))
        yield log(f"{ROOM}/log", time_ns, sample.narration.text, sample.sample_id)


def _state(sample: Sample) -> SampleState:
    return SampleState(
        frame=sample.frame, sample_id=sample.sample_id, text=sample.narration.text, taxonomy_id=sample.taxonomy,
        quality=sample.quality, inpaint_confidence=sample.inpaint_confidence, key_distance_frames=float(sample.key_distance),
        object_left=sample.object_left, object_right=sample.object_right)  # fmt: skip
