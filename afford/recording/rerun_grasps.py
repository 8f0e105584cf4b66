"""Grasps in Rerun: hand and object as meshes in 3-D, the camera picture, and curves of distance, height and forces."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import rerun as rr
import rerun.blueprint as rrb

from afford.recording.grasps import FORCE, GRASPS, IMAGE, LENS, LOG, N_T, SCENE, STATE, TRANSFORMS
from afford.recording.messages import CAMERA, PRESSING
from afford.recording.moments import Moment, moments
from afford.recording.spatial import POINT, WORLD

EYE = f"{WORLD}/{CAMERA}"
HOW = ("goal_m", "height_m")
AFFORDANCE = ("as_violation_pct", "penetration_mm")
POINT_M = 0.0015


def grasp_blueprint() -> rrb.Blueprint:
    """Layout of grasps: 3-D view next to the camera picture, curves and text."""
    beside = rrb.Vertical(
        rrb.Spatial2DView(origin=EYE, name="camera"),
        rrb.TimeSeriesView(origin="/plots/how", name="object: to its goal and above the table, m"),
        rrb.TimeSeriesView(origin="/plots/force", name="force on the object, N"),
        rrb.TimeSeriesView(origin="/plots/negative", name="force on negative parts, N"),
        rrb.TimeSeriesView(origin="/plots/affordance", name="unsafe fingertips, %; penetration, mm"),
        rrb.TimeSeriesView(origin="/plots/reward", name="reward by term"),
        rrb.TextLogView(origin="/log", name="episodes"),
        row_shares=[5, 2, 2, 2, 2, 2, 2],
    )
    room = rrb.Spatial3DView(origin=f"/{WORLD}", name="hand and object")
    return rrb.Blueprint(rrb.Horizontal(room, beside, column_shares=[3, 2]), collapse_panels=True)


def log_grasps(path: Path, stream: rr.RecordingStream) -> None:
    """Log every moment of the grasps on the recording's own clock."""
    stream.log(WORLD, rr.ViewCoordinates.RIGHT_HAND_Z_UP, static=True)
    for moment in moments(path):
        stream.set_time("media_time", duration=moment.time_ns / 1e9)
        _space(moment, stream)
        _camera(moment, stream)
        for name, number in _numbers(moment):
            stream.log(f"plots/{name}", rr.Scalars(number))
        for line in moment.values.get(LOG, []):
            stream.log("log", rr.TextLog(line.message))


def _space(moment: Moment, stream: rr.RecordingStream) -> None:
    for message in moment.values.get(SCENE, []):
        for entity in message.entities:
            _entity(entity, stream)
    for message in moment.values.get(N_T, []):
        points = np.frombuffer(message.data, POINT)
        stream.log(f"{WORLD}/{message.frame_id}/N_t", rr.Points3D(points["xyz"], colors=points["rgba"], radii=POINT_M))
    for message in moment.values.get(TRANSFORMS, []):
        for one in message.transforms:
            t, q = one.translation, one.rotation
            stream.log(f"{WORLD}/{one.child_frame_id}",
                       rr.Transform3D(translation=(t.x, t.y, t.z), quaternion=rr.Quaternion(xyzw=(q.x, q.y, q.z, q.w))))


def _entity(entity: Any, stream: rr.RecordingStream) -> None:
    """Log the triangles of an entity as one mesh of flat faces, and its lines."""
    place = f"{WORLD}/{entity.id}" if entity.frame_id == WORLD else f"{WORLD}/{entity.frame_id}"
    if entity.triangles:
        corners = np.concatenate([_corners(one) for one in entity.triangles])
        colours = np.concatenate([np.tile(_rgb(one.color), (len(one.indices), 1)) for one in entity.triangles])
        a, b, c = corners.reshape(-1, 3, 3).swapaxes(0, 1)
        stream.log(f"{place}/mesh", rr.Mesh3D(vertex_positions=corners, vertex_colors=colours,
                                              triangle_indices=np.arange(len(corners)).reshape(-1, 3),
                                              vertex_normals=np.repeat(np.cross(b - a, c - a), 3, axis=0)))  # fmt: skip
    if entity.lines:
        strips = [[(p.x, p.y, p.z) for p in (*line.points, line.points[0])] for line in entity.lines]
        stream.log(f"{place}/lines", rr.LineStrips3D(strips, colors=[_rgb(line.color) for line in entity.lines]))


def _corners(one: Any) -> np.ndarray:
    """Corners (3 f, 3) of all triangles in turn."""
    found: np.ndarray = np.array([(p.x, p.y, p.z) for p in one.points])[list(one.indices)]
    return found


def _rgb(colour: Any) -> tuple[int, int, int]:
    return round(255 * colour.r), round(255 * colour.g), round(255 * colour.b)


def _camera(moment: Moment, stream: rr.RecordingStream) -> None:
    lens, picture = moment.one(LENS), moment.one(IMAGE)
    if lens is not None:
        stream.log(EYE, rr.Pinhole(image_from_camera=np.array(lens.K).reshape(3, 3), resolution=[lens.width, lens.height],
                                   image_plane_distance=0.1))  # fmt: skip
    if picture is not None:
        stream.log(EYE, rr.EncodedImage(contents=picture.data, media_type="image/jpeg"))


def _numbers(moment: Moment) -> Iterator[tuple[str, float]]:
    """Name and value of each curve."""
    state, force = moment.one(STATE), moment.one(FORCE)
    if state is not None:
        yield from ((f"{group}/{name}", getattr(state, name))
                    for group, names in (("how", HOW), ("affordance", AFFORDANCE)) for name in names)  # fmt: skip
    if force is not None:
        yield from ((f"{group}/{one}", getattr(force, f"{one}{what}_n"))
                    for group, what in (("force", ""), ("negative", "_negative")) for one in PRESSING)  # fmt: skip
    for topic, values in moment.values.items():
        if topic.startswith(f"{GRASPS}/reward/"):
            yield topic.removeprefix(f"{GRASPS}/"), values[-1].value
