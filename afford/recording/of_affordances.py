"""Affordances -> /affordance/left, /affordance/right, /affordance/overlay, /affordance/state."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from afford.common.image_files import mask_png, overlay_png
from afford.common.palette import HANDS, LEFT, RIGHT
from afford.recording.content import Message, Recording
from afford.recording.own_types import AffordanceState
from afford.recording.topics import channel, image, image_channel, stamped, times_of
from schemas.affordance import Affordances, Rejection, Taxonomy
from schemas.video import SIDES, Frames

ROOM = "/affordance"


def record(value: Affordances, frames: Frames) -> Recording:
    """Where each hand acts on its object; what kind of two-handed task it is, and whether the frame becomes a sample."""
    masks = tuple(image_channel(f"{ROOM}/{side}", side=side, classes={"0": "background", "255": f"{side} affordance"})
                  for side in SIDES)  # fmt: skip
    overlay = image_channel(f"{ROOM}/overlay", palette={side: list(colour) for side, colour in HANDS.items()})
    return Recording((*masks, overlay, channel(f"{ROOM}/state", AffordanceState)), _messages(value, frames))


def _messages(value: Affordances, frames: Frames) -> Iterator[Message]:
    for t, time_ns in enumerate(times_of(value.frame, frames)):
        for side, mask in zip(SIDES, value.masks[:, t], strict=True):
            yield image(f"{ROOM}/{side}", time_ns, mask_png(mask))
        yield image(f"{ROOM}/overlay", time_ns, overlay_png(value.masks[:, t], (LEFT, RIGHT)))
        yield stamped(f"{ROOM}/state", time_ns, _state(value, t))


def _state(value: Affordances, t: int) -> AffordanceState:
    left, right = ("" if n < 0 else value.objects[n].entity_id for n in value.object_index[:, t].tolist())
    rejection, taxonomy = Rejection(int(value.rejection[t])), Taxonomy(int(value.taxonomy[t]))
    return AffordanceState(
        frame=int(value.frame[t]), accepted=rejection is Rejection.ACCEPTED, rejection=rejection.name.lower(),
        taxonomy=taxonomy.name.lower(), taxonomy_id=int(taxonomy), taxonomy3_id=int(value.taxonomy3[t]),
        quality=float(value.quality[t]), left_object=left, right_object=right,
        left_area_px=float(np.count_nonzero(value.masks[0, t])),
        right_area_px=float(np.count_nonzero(value.masks[1, t])))  # fmt: skip
