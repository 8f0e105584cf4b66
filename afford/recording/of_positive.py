"""An object and where hands belong on it -> its views, both hands' regions over them, A_t as a cloud, task by task.

An object has no media time: view n comes n milliseconds after the fixed base of all recordings, what is said of the whole object
with the first view.
"""

from __future__ import annotations

import json
from collections.abc import Iterator

import numpy as np
from foxglove_schemas_protobuf.PointCloud_pb2 import PointCloud

from afford.common.image_files import PNG, encode_png, jpeg
from afford.common.palette import LEFT, RIGHT
from afford.recording.content import EPOCH_NS, Channel, Message, Recording
from afford.recording.of_object import FRAME, OPACITY, STEP_NS, VIEW
from afford.recording.own_types import Document
from afford.recording.spatial import cloud
from afford.recording.topics import channel, image, image_channel, stamped
from afford.surface.negative.export import task_slug
from schemas.affordance import TAXONOMY
from schemas.mesh import ObjectViews
from schemas.surface import PositiveAffordance, PositiveAffordances

ROOM = "/positive_affordance"


def record(views: ObjectViews, found: PositiveAffordances) -> Recording:
    """Everything about one object."""
    rooms = [f"{ROOM}/{number}_{task_slug(one.task)}" for number, one in enumerate(found.tasks)]
    channels: list[Channel] = [image_channel(VIEW, views=list(views.views))]
    for room, one in zip(rooms, found.tasks, strict=True):
        channels += [image_channel(f"{room}/overlay", task=one.task, palette={"left": list(LEFT), "right": list(RIGHT)}),
                     channel(f"{room}/A_t", PointCloud), channel(f"{room}/state", Document)]  # fmt: skip
    return Recording(tuple(channels), _messages(views, found, rooms))


def _messages(views: ObjectViews, found: PositiveAffordances, rooms: list[str]) -> Iterator[Message]:
    for room, one in zip(rooms, found.tasks, strict=True):
        yield cloud(f"{room}/A_t", EPOCH_NS, FRAME, one.A_t, np.tile(np.array([*RIGHT, 255], np.uint8), (len(one.A_t), 1)))
        yield stamped(f"{room}/state", EPOCH_NS, Document(name=one.task, media_type="application/json", text=_said(one)))
    for view in range(len(views.views)):
        time_ns = EPOCH_NS + view * STEP_NS
        yield image(VIEW, time_ns, jpeg(views.rgb[view]), "jpeg")
        for room, one in zip(rooms, found.tasks, strict=True):
            yield image(f"{room}/overlay", time_ns, _overlay(views.face[view], one))


def _said(one: PositiveAffordance) -> str:
    taxonomy = {name: round(float(share), 4) for name, share in zip(TAXONOMY, one.taxonomy, strict=True)}
    return json.dumps({"task": one.task, "taxonomy": taxonomy, "points": len(one.A_t)}, sort_keys=True)


def _overlay(face: np.ndarray, one: PositiveAffordance) -> bytes:
    """Transparent beside the object and where no hand belongs; the colour of the likelier hand shows through elsewhere."""
    left, right = one.hand.astype(np.float64)
    share = (right / np.maximum(left + right, 1e-9))[:, None]
    paint = np.zeros((len(left) + 1, 4), np.uint8)
    paint[:-1, :3] = ((1 - share) * np.array(LEFT) + share * np.array(RIGHT)).round()
    paint[:-1, 3] = (OPACITY * np.maximum(left, right).clip(0, 1)).round()
    return encode_png(paint[:, [2, 1, 0, 3]][face], PNG).tobytes()
