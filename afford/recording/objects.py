"""Recorders of objects: views, part candidates, scores, negative and positive affordances as pictures and clouds.

An object has no media time: view n is n milliseconds after the fixed base of all recordings. Messages about the whole object have
the time of the first view.
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
"""colours of the candidates in one picture, most visible first (Okabe and Ito)"""
OPACITY = 150
FRAME = "object"
"""frame_id of clouds: the frame of the mesh, metres"""


def record_negative(views: ObjectViews, candidates: PartCandidates, descriptions: PartDescriptions, scores: PartScores,
           found: NegativeAffordances, mesh: ObjectMesh | None = None, made_by: str = "mesh_read") -> Recording:  # fmt: skip
    """Record an object with its negative affordances; `mesh` is recorded below the stage that made it."""
    prefixes = [f"{NEGATIVE}/{number}_{task_slug(one.task)}" for number, one in enumerate(found.tasks)]
    channels: list[Channel] = [image_channel(VIEW, views=list(views.views)), image_channel(CANDIDATES), channel(SCORES, Document),
                               channel(NOTES, Document), channel(NOTES_LOG, Log)]  # fmt: skip
    for prefix, one in zip(prefixes, found.tasks, strict=True):
        channels += [image_channel(f"{prefix}/overlay", task=one.task), channel(f"{prefix}/points", PointCloud),
                     channel(f"{prefix}/N_t", PointCloud)]  # fmt: skip
    shape = [] if mesh is None else [_shape(f"/{made_by}/mesh", mesh)]
    channels += [channel(one.topic, SceneUpdate) for one in shape]
    return Recording(tuple(channels), chain(shape, _negative_messages(views, candidates, descriptions, scores, found, prefixes)))


def _negative_messages(views: ObjectViews, candidates: PartCandidates, descriptions: PartDescriptions, scores: PartScores,
              found: NegativeAffordances, prefixes: list[str]) -> Iterator[Message]:  # fmt: skip
    yield from _notes(descriptions)
    for prefix, one in zip(prefixes, found.tasks, strict=True):
        yield _cloud(f"{prefix}/points", found.points, one.negative)
        yield _cloud(f"{prefix}/N_t", one.N_t, np.ones(len(one.N_t), bool))
    for view in range(len(views.views)):
        time_ns, mine = EPOCH_NS + view * STEP_NS, np.flatnonzero(candidates.view == view)
        yield image(VIEW, time_ns, jpeg(views.rgb[view]), "jpeg")
        masks, colours = candidates.masks[mine[: len(COLOURS)]], COLOURS[: len(mine)]
        yield image(CANDIDATES, time_ns, overlay_png(masks[::-1], colours[::-1]))
        yield _document(SCORES, time_ns, views.views[view], _scored(mine, candidates, descriptions, scores))
        for prefix, one in zip(prefixes, found.tasks, strict=True):
            yield image(f"{prefix}/overlay", time_ns, _negative_overlay(views.face[view], one))


def _shape(topic: str, mesh: ObjectMesh) -> Message:
    """Triangles of a mesh in the mean colour of its texture."""
    r, g, b = mesh.texture.reshape(-1, 3).mean(0).round().astype(int).tolist()
    return scene(topic, EPOCH_NS, [entity(mesh.name, FRAME, [triangles(mesh.vertices, mesh.faces, (r, g, b))])])


def _cloud(topic: str, points: np.ndarray, negative: np.ndarray) -> Message:
    """Cloud of points (n, 3) coloured by their labels (n,): red is negative."""
    return cloud(topic, EPOCH_NS, FRAME, points, probability_colours(negative.astype(np.float32)))


def _notes(descriptions: PartDescriptions) -> Iterator[Message]:
    tasks = [{"task": one.task, "category": one.category, "notes": [vars(note) for note in one.notes]}
             for one in descriptions.descriptions]  # fmt: skip
    yield _document(NOTES, EPOCH_NS, descriptions.name, tasks)
    for one in descriptions.descriptions:
        bad = ", ".join(note.part for note in one.notes if note.role == "negative") or "nothing"
        yield log(NOTES_LOG, EPOCH_NS, f"{one.category}, {one.task or 'any use'}: not {bad}", descriptions.name)


def _scored(mine: np.ndarray, candidates: PartCandidates, descriptions: PartDescriptions,
            scores: PartScores) -> list[dict[str, object]]:  # fmt: skip
    """Scores of a view's candidates for each part; a part of several tasks is listed once."""
    column = {note.part: k for k, note in enumerate(descriptions.notes)}
    return [{"area_px": int(candidates.masks[n].sum()), "quality": round(float(candidates.quality[n]), 4),
             "share": {part: round(float(scores.share[n, k]), 4) for part, k in column.items()}} for n in mine]  # fmt: skip


def _document(topic: str, time_ns: int, name: str, value: object) -> Message:
    return stamped(topic, time_ns, Document(name=name, media_type="application/json", text=json.dumps(value, sort_keys=True)))


def _negative_overlay(face: np.ndarray, one: NegativeAffordance) -> bytes:
    """Overlay of one view: green to red on the object, transparent elsewhere."""
    paint = probability_colours(np.append(one.probability, np.float32(0)))
    paint[:, 3], paint[-1] = OPACITY, 0
    return encode_png(paint[:, [2, 1, 0, 3]][face], PNG).tobytes()


POSITIVE = "/positive_affordance"


def record_positive(views: ObjectViews, found: PositiveAffordances) -> Recording:
    """Record an object with its positive affordances: both hands' regions over the views, A_t as a cloud, per task."""
    prefixes = [f"{POSITIVE}/{number}_{task_slug(one.task)}" for number, one in enumerate(found.tasks)]
    channels: list[Channel] = [image_channel(VIEW, views=list(views.views))]
    for prefix, one in zip(prefixes, found.tasks, strict=True):
        channels += [image_channel(f"{prefix}/overlay", task=one.task, palette={"left": list(LEFT), "right": list(RIGHT)}),
                     channel(f"{prefix}/A_t", PointCloud), channel(f"{prefix}/state", Document)]  # fmt: skip
    return Recording(tuple(channels), _positive_messages(views, found, prefixes))


def _positive_messages(views: ObjectViews, found: PositiveAffordances, prefixes: list[str]) -> Iterator[Message]:
    for prefix, one in zip(prefixes, found.tasks, strict=True):
        yield cloud(f"{prefix}/A_t", EPOCH_NS, FRAME, one.A_t, np.tile(np.array([*RIGHT, 255], np.uint8), (len(one.A_t), 1)))
        state = Document(name=one.task, media_type="application/json", text=_positive_state(one))
        yield stamped(f"{prefix}/state", EPOCH_NS, state)
    for view in range(len(views.views)):
        time_ns = EPOCH_NS + view * STEP_NS
        yield image(VIEW, time_ns, jpeg(views.rgb[view]), "jpeg")
        for prefix, one in zip(prefixes, found.tasks, strict=True):
            yield image(f"{prefix}/overlay", time_ns, _positive_overlay(views.face[view], one))


def _positive_state(one: PositiveAffordance) -> str:
    taxonomy = {name: round(float(share), 4) for name, share in zip(TAXONOMY, one.taxonomy, strict=True)}
    return json.dumps({"task": one.task, "taxonomy": taxonomy, "points": len(one.A_t)}, sort_keys=True)


def _positive_overlay(face: np.ndarray, one: PositiveAffordance) -> bytes:
    """Overlay of one view in the colour of the more likely hand, transparent off the object and without affordance."""
    left, right = one.hand.astype(np.float64)
    share = (right / np.maximum(left + right, 1e-9))[:, None]
    paint = np.zeros((len(left) + 1, 4), np.uint8)
    paint[:-1, :3] = ((1 - share) * np.array(LEFT) + share * np.array(RIGHT)).round()
    paint[:-1, 3] = (OPACITY * np.maximum(left, right).clip(0, 1)).round()
    return encode_png(paint[:, [2, 1, 0, 3]][face], PNG).tobytes()
