"""An object and what was found on it -> its views, candidates, scores, and where a hand must not go, as pictures and clouds.

An object has no media time: view n comes n milliseconds after the fixed base of all recordings, what is said of the whole object
with the first view.
"""

from __future__ import annotations

import json
from collections.abc import Iterator
from itertools import chain

import numpy as np
from foxglove_schemas_protobuf.Log_pb2 import Log
from foxglove_schemas_protobuf.PointCloud_pb2 import PointCloud
from foxglove_schemas_protobuf.SceneUpdate_pb2 import SceneUpdate

from afford.common.image_files import PNG, encode_png, jpeg, overlay_png
from afford.common.palette import LEFT, RIGHT, Palette
from afford.recording.mcap_files import EPOCH_NS, Channel, Message, Recording
from afford.recording.messages import Document, channel, image, image_channel, log, stamped
from afford.recording.spatial import cloud, entity, scene, triangles
from afford.surface.negative.export import probability_colours, task_slug
from schemas.affordance import TAXONOMY
from schemas.mesh import ObjectMesh, ObjectViews
from schemas.surface import (
    NegativeAffordance,
    NegativeAffordances,
    PartCandidates,
    PartDescriptions,
    PartScores,
    PositiveAffordance,
    PositiveAffordances,
)

VIEW, CANDIDATES, SCORES = "/view_render/image", "/mask_propose/overlay", "/mask_score/scores"
NOTES, NOTES_LOG = "/part_describe/notes", "/part_describe/log"
NEGATIVE = "/negative_affordance"
STEP_NS = 1_000_000
COLOURS: Palette = ((230, 159, 0), (86, 180, 233), (0, 158, 115), (240, 228, 66), (0, 114, 178), (213, 94, 0), (204, 121, 167))
"""candidates in one picture, the most striking first (Okabe and Ito's colours)"""
OPACITY = 150
FRAME = "object"
"""frame_id of clouds: the frame of the mesh, metres"""


def record_negative(views: ObjectViews, candidates: PartCandidates, told: PartDescriptions, scores: PartScores,
           found: NegativeAffordances, mesh: ObjectMesh | None = None, made_by: str = "mesh_read") -> Recording:  # fmt: skip
    """Everything about one object; its mesh, where it is given, below the stage that made it."""
    rooms = [f"{NEGATIVE}/{number}_{task_slug(one.task)}" for number, one in enumerate(found.tasks)]
    channels: list[Channel] = [image_channel(VIEW, views=list(views.views)), image_channel(CANDIDATES), channel(SCORES, Document),
                               channel(NOTES, Document), channel(NOTES_LOG, Log)]  # fmt: skip
    for room, one in zip(rooms, found.tasks, strict=True):
        channels += [image_channel(f"{room}/overlay", task=one.task), channel(f"{room}/points", PointCloud),
                     channel(f"{room}/N_t", PointCloud)]  # fmt: skip
    shape = [] if mesh is None else [_shape(f"/{made_by}/mesh", mesh)]
    channels += [channel(one.topic, SceneUpdate) for one in shape]
    return Recording(tuple(channels), chain(shape, _negative_messages(views, candidates, told, scores, found, rooms)))


def _negative_messages(views: ObjectViews, candidates: PartCandidates, told: PartDescriptions, scores: PartScores,
              found: NegativeAffordances, rooms: list[str]) -> Iterator[Message]:  # fmt: skip
    yield from _words(told)
    for room, one in zip(rooms, found.tasks, strict=True):
        yield _cloud(f"{room}/points", found.points, one.negative)
        yield _cloud(f"{room}/N_t", one.N_t, np.ones(len(one.N_t), bool))
    for view in range(len(views.views)):
        time_ns, mine = EPOCH_NS + view * STEP_NS, np.flatnonzero(candidates.view == view)
        yield image(VIEW, time_ns, jpeg(views.rgb[view]), "jpeg")
        masks, colours = candidates.masks[mine[: len(COLOURS)]], COLOURS[: len(mine)]
        yield image(CANDIDATES, time_ns, overlay_png(masks[::-1], colours[::-1]))
        yield _document(SCORES, time_ns, views.views[view], _scored(mine, candidates, told, scores))
        for room, one in zip(rooms, found.tasks, strict=True):
            yield image(f"{room}/overlay", time_ns, _negative_overlay(views.face[view], one))


def _shape(topic: str, mesh: ObjectMesh) -> Message:
    """The triangles of a mesh in the mean colour of its texture."""
    r, g, b = mesh.texture.reshape(-1, 3).mean(0).round().astype(int).tolist()
    return scene(topic, EPOCH_NS, [entity(mesh.name, FRAME, [triangles(mesh.vertices, mesh.faces, (r, g, b))])])


def _cloud(topic: str, points: np.ndarray, negative: np.ndarray) -> Message:
    """Points (n, 3) with their labels (n,) as colours: red where a hand must not go."""
    return cloud(topic, EPOCH_NS, FRAME, points, probability_colours(negative.astype(np.float32)))


def _words(told: PartDescriptions) -> Iterator[Message]:
    tasks = [{"task": one.task, "category": one.category, "notes": [vars(note) for note in one.notes]} for one in told.descriptions]
    yield _document(NOTES, EPOCH_NS, told.name, tasks)
    for one in told.descriptions:
        bad = ", ".join(note.part for note in one.notes if note.role == "negative") or "nothing"
        yield log(NOTES_LOG, EPOCH_NS, f"{one.category}, {one.task or 'any use'}: not {bad}", told.name)


def _scored(mine: np.ndarray, candidates: PartCandidates, told: PartDescriptions, scores: PartScores) -> list[dict[str, object]]:
    """Candidates of a view with how well they fit the parts; a part that several tasks speak of is told once."""
    column = {note.part: k for k, note in enumerate(told.notes)}
    return [{"area_px": int(candidates.masks[n].sum()), "quality": round(float(candidates.quality[n]), 4),
             "share": {part: round(float(scores.share[n, k]), 4) for part, k in column.items()}} for n in mine]  # fmt: skip


def _document(topic: str, time_ns: int, name: str, value: object) -> Message:
    return stamped(topic, time_ns, Document(name=name, media_type="application/json", text=json.dumps(value, sort_keys=True)))


def _negative_overlay(face: np.ndarray, one: NegativeAffordance) -> bytes:
    """Transparent beside the object; on it from green to red."""
    paint = probability_colours(np.append(one.probability, np.float32(0)))
    paint[:, 3], paint[-1] = OPACITY, 0
    return encode_png(paint[:, [2, 1, 0, 3]][face], PNG).tobytes()


POSITIVE = "/positive_affordance"


def record_positive(views: ObjectViews, found: PositiveAffordances) -> Recording:
    """Everything about one object."""
    rooms = [f"{POSITIVE}/{number}_{task_slug(one.task)}" for number, one in enumerate(found.tasks)]
    channels: list[Channel] = [image_channel(VIEW, views=list(views.views))]
    for room, one in zip(rooms, found.tasks, strict=True):
        channels += [image_channel(f"{room}/overlay", task=one.task, palette={"left": list(LEFT), "right": list(RIGHT)}),
                     channel(f"{room}/A_t", PointCloud), channel(f"{room}/state", Document)]  # fmt: skip
    return Recording(tuple(channels), _positive_messages(views, found, rooms))


def _positive_messages(views: ObjectViews, found: PositiveAffordances, rooms: list[str]) -> Iterator[Message]:
    for room, one in zip(rooms, found.tasks, strict=True):
        yield cloud(f"{room}/A_t", EPOCH_NS, FRAME, one.A_t, np.tile(np.array([*RIGHT, 255], np.uint8), (len(one.A_t), 1)))
        yield stamped(f"{room}/state", EPOCH_NS, Document(name=one.task, media_type="application/json", text=_positive_state(one)))
    for view in range(len(views.views)):
        time_ns = EPOCH_NS + view * STEP_NS
        yield image(VIEW, time_ns, jpeg(views.rgb[view]), "jpeg")
        for room, one in zip(rooms, found.tasks, strict=True):
            yield image(f"{room}/overlay", time_ns, _positive_overlay(views.face[view], one))


def _positive_state(one: PositiveAffordance) -> str:
    taxonomy = {name: round(float(share), 4) for name, share in zip(TAXONOMY, one.taxonomy, strict=True)}
    return json.dumps({"task": one.task, "taxonomy": taxonomy, "points": len(one.A_t)}, sort_keys=True)


def _positive_overlay(face: np.ndarray, one: PositiveAffordance) -> bytes:
    """Transparent beside the object and where no hand belongs; the colour of the likelier hand shows through elsewhere."""
    left, right = one.hand.astype(np.float64)
    share = (right / np.maximum(left + right, 1e-9))[:, None]
    paint = np.zeros((len(left) + 1, 4), np.uint8)
    paint[:-1, :3] = ((1 - share) * np.array(LEFT) + share * np.array(RIGHT)).round()
    paint[:-1, 3] = (OPACITY * np.maximum(left, right).clip(0, 1)).round()
    return encode_png(paint[:, [2, 1, 0, 3]][face], PNG).tobytes()
