"""Spatial messages of Foxglove: poses, transforms, triangles, lines, coloured points. Metres; quaternions x, y, z, w."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from typing import Any

import numpy as np
from foxglove_schemas_protobuf.CameraCalibration_pb2 import CameraCalibration
from foxglove_schemas_protobuf.Color_pb2 import Color
from foxglove_schemas_protobuf.FrameTransform_pb2 import FrameTransform
from foxglove_schemas_protobuf.FrameTransforms_pb2 import FrameTransforms
from foxglove_schemas_protobuf.LinePrimitive_pb2 import LinePrimitive
from foxglove_schemas_protobuf.PackedElementField_pb2 import PackedElementField
from foxglove_schemas_protobuf.PointCloud_pb2 import PointCloud
from foxglove_schemas_protobuf.PoseInFrame_pb2 import PoseInFrame
from foxglove_schemas_protobuf.SceneEntity_pb2 import SceneEntity
from foxglove_schemas_protobuf.SceneUpdate_pb2 import SceneUpdate
from foxglove_schemas_protobuf.TriangleListPrimitive_pb2 import TriangleListPrimitive
from scipy.spatial.transform import Rotation

from afford.common.palette import Colour
from afford.recording.mcap_files import Message
from afford.recording.messages import stamped

WORLD = "world"
"""frame_id of the root frame: z up, table top at 0"""
POINT = np.dtype([("xyz", "<f4", 3), ("rgba", "u1", 4)])
"""dtype of a point of a cloud"""
LINE_M = 0.002


def transforms(topic: str, time_ns: int, T: dict[str, np.ndarray], parent: str = WORLD) -> Message:
    """Frame transforms: child frame -> (4, 4) T_parent_child."""
    found = [FrameTransform(parent_frame_id=parent, child_frame_id=child) for child in T]
    for message, matrix in zip(found, T.values(), strict=True):
        _put(message.translation, message.rotation, pose_of(matrix))
    return stamped(topic, time_ns, FrameTransforms(transforms=found))


def pose(topic: str, time_ns: int, where: np.ndarray, frame: str = WORLD) -> Message:
    """Pose message of (7,) position and quaternion."""
    message = PoseInFrame(frame_id=frame)
    _put(message.pose.position, message.pose.orientation, where)
    return stamped(topic, time_ns, message)


def pose_of(T: np.ndarray) -> np.ndarray:
    """Pose (7,) x y z, quaternion x y z w of a matrix (4, 4)."""
    return np.concatenate([T[:3, 3], Rotation.from_matrix(T[:3, :3]).as_quat()])


def triangles(vertices: np.ndarray, faces: np.ndarray, colour: Colour) -> TriangleListPrimitive:
    """Mesh of one colour."""
    out = TriangleListPrimitive(color=_colour(colour), indices=faces.reshape(-1).tolist())
    out.pose.orientation.w = 1.0
    for x, y, z in vertices.tolist():
        out.points.add(x=x, y=y, z=z)
    return out


def loop(corners: np.ndarray, colour: Colour, closed: bool = True) -> LinePrimitive:
    """A line through (k, 3), closed or from the first to the last."""
    kind = LinePrimitive.Type.Value("LINE_LOOP" if closed else "LINE_STRIP")
    out = LinePrimitive(type=kind, thickness=LINE_M, color=_colour(colour))
    out.pose.orientation.w = 1.0
    for x, y, z in corners.tolist():
        out.points.add(x=x, y=y, z=z)
    return out


def entity(name: str, frame: str, meshes: Iterable[TriangleListPrimitive] = (), lines: Iterable[LinePrimitive] = ()) -> SceneEntity:
    """A thing that moves with its frame; one of the same name takes its place."""
    return SceneEntity(id=name, frame_id=frame, frame_locked=True, triangles=meshes, lines=lines)


def scene(topic: str, time_ns: int, entities: Sequence[SceneEntity]) -> Message:
    """Things from now on."""
    return stamped(topic, time_ns, SceneUpdate(entities=entities))


def cloud(topic: str, time_ns: int, frame: str, points: np.ndarray, rgba: np.ndarray) -> Message:
    """(n, 3) points and their (n, 4) uint8 colours, sRGB and opacity."""
    rows = np.empty(len(points), POINT)
    rows["xyz"], rows["rgba"] = points, rgba
    kind = PackedElementField.NumericType
    fields = [PackedElementField(name=axis, offset=4 * k, type=kind.Value("FLOAT32")) for k, axis in enumerate("xyz")]
    fields += [PackedElementField(name=name, offset=12 + k, type=kind.Value("UINT8"))
               for k, name in enumerate(("red", "green", "blue", "alpha"))]  # fmt: skip
    message = PointCloud(frame_id=frame, point_stride=rows.itemsize, fields=fields, data=rows.tobytes())
    message.pose.orientation.w = 1.0
    return stamped(topic, time_ns, message)


def calibration(topic: str, time_ns: int, frame: str, K: np.ndarray, width: int, height: int) -> Message:
    """A pinhole without distortion: K (3, 3) px."""
    P = np.concatenate([K, np.zeros((3, 1))], axis=1)
    return stamped(topic, time_ns, CameraCalibration(
        frame_id=frame, width=width, height=height, K=K.reshape(-1).tolist(), R=np.eye(3).reshape(-1).tolist(),
        P=P.reshape(-1).tolist()))  # fmt: skip


def _put(place: Any, turn: Any, where: np.ndarray) -> None:
    place.x, place.y, place.z, turn.x, turn.y, turn.z, turn.w = where.tolist()


def _colour(colour: Colour) -> Color:
    r, g, b = (number / 255 for number in colour)
    return Color(r=r, g=g, b=b, a=1.0)
