"""Depth cameras around the table: triangles of hand and object, depth images of both, and a model of depth noise.

Triangles are those of the hand's collision shapes and of the object's convex hulls; rendering needs no physics engine. Cameras
are placed as in the paper and look at a point 15 cm above the table; their field of view is not published. The table is not
drawn: it is flat, below everything, and cropped from the clouds anyway.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
import trimesh
from scipy.spatial.transform import Rotation

from afford.grasping.hand.kinematics import forward_kinematics
from afford.grasping.hand.link_meshes import link_meshes
from afford.grasping.sim.scene import Range
from afford.render.camera import facing
from afford.render.raster import edges, fill, project
from afford.render.scene import Camera
from schemas.grasp import GraspObject
from schemas.hand import HandModel

SIDES = 12
"""corners around a capsule: a finger 1 cm thick is at most 0.4 mm too thin"""


@dataclass(frozen=True, eq=False)
class HandShape:
    """Triangles of a robot hand."""

    hand: HandModel
    corners: np.ndarray
    """(v, 3) m, each in the frame of its link"""
    link: np.ndarray
    """(v,) link of each corner"""
    faces: np.ndarray
    """(t, 3) int32"""

    def at(self, q: np.ndarray) -> np.ndarray:
        """(n, d) joints -> (n, v, 3) corners in the world."""
        T = forward_kinematics(self.hand.joints, q)[:, self.link]
        found: np.ndarray = (T[..., :3, :3] @ self.corners[:, :, None])[..., 0] + T[..., :3, 3]
        return found


@dataclass(frozen=True, eq=False)
class BodyShape:
    """Triangles of an object's hulls, in its frame."""

    corners: np.ndarray
    faces: np.ndarray

    def at(self, pose: np.ndarray) -> np.ndarray:
        """(7,) -> (v, 3) corners in the world."""
        found: np.ndarray = Rotation.from_quat(pose[3:]).apply(self.corners) + pose[:3]
        return found


def hand_shape(hand: HandModel) -> HandShape:
    """Triangles of the collision shapes of all links. ValueError for a hand without collision shapes."""
    solids = link_meshes(hand, ("collision",), SIDES)
    if not solids:
        raise ValueError(f"{hand.name}: the hand has no link with a collision shape; cameras would not see it")
    corners, faces = _joined([(one.vertices, one.faces) for one in solids])
    return HandShape(hand, corners, np.repeat([one.link for one in solids], [len(one.vertices) for one in solids]), faces)


def body_shape(body: GraspObject) -> BodyShape:
    """Triangles of all hulls of an object."""
    solids = [trimesh.convex.convex_hull(hull) for hull in body.hulls()]
    return BodyShape(*_joined([(one.vertices, one.faces) for one in solids]))


def _joined(solids: Sequence[tuple[np.ndarray, np.ndarray]]) -> tuple[np.ndarray, np.ndarray]:
    """Join solids into (v, 3) corners and (t, 3) faces."""
    ends = np.cumsum([0, *(len(corners) for corners, _ in solids)])
    faces = [np.asarray(one) + first for (_, one), first in zip(solids, ends[:-1], strict=True)]
    return np.concatenate([corners for corners, _ in solids]).astype(np.float64), np.concatenate(faces).astype(np.int32)


PLACES_M = ((0.0, 0.0, 0.55), (0.5, 0.0, 0.15), (0.0, 0.5, 0.15), (-0.5, 0.0, 0.15), (0.0, -0.5, 0.15))
"""places of cameras relative to the middle of the table's top: above, and at four sides"""
LOOK_M = (0.0, 0.0, 0.15)
"""point that all cameras look at"""
NOTHING, HAND, OBJECT = 0, 1, 2


@dataclass(frozen=True)
class CameraRig:
    """Number, resolution and field of view of the cameras. ValueError for values out of range."""

    views: int = 2
    """number of cameras, the first of PLACES_M"""
    size_px: int = 96
    """width and height of an image"""
    view_deg: float = 60.0
    """field of view"""

    def __post_init__(self) -> None:
        if not 1 <= self.views <= len(PLACES_M) or self.size_px < 1 or not 0 < self.view_deg < 180:
            raise ValueError(f"CameraRig: expected 1 to {len(PLACES_M)} views, size_px of 1 or more and view_deg in 0 to 180, "
                             f"got {self}")

    def cameras(self) -> tuple[Camera, ...]:
        """Cameras of the rig."""
        focal = self.size_px / 2 / np.tan(np.radians(self.view_deg) / 2)
        middle = (self.size_px - 1) / 2
        K = np.array([[focal, 0, middle], [0, focal, middle], [0, 0, 1.0]])
        return tuple(Camera(K, _looking(np.array(place)), self.size_px, self.size_px) for place in PLACES_M[: self.views])


PAPER = CameraRig(5, 256)
"""rig of AffordDex"""


@dataclass(frozen=True, eq=False)
class DepthImages:
    """Depth images of c cameras in n worlds."""

    depth_m: np.ndarray
    """(n, c, h, w) float32 depth along the axis of the camera; 0 where neither hand nor object is visible"""
    kind: np.ndarray
    """(n, c, h, w) uint8 NOTHING, HAND or OBJECT"""


def render_depth(cameras: Sequence[Camera], hand: HandShape, bodies: Sequence[BodyShape], q: np.ndarray,
                 body: np.ndarray) -> DepthImages:  # fmt: skip
    """Render n worlds with joints q (n, d) and object poses (n, 7)."""
    shape = (len(q), len(cameras), cameras[0].height, cameras[0].width)
    near, seen = np.zeros(shape, np.float32), np.full(shape, -1, np.int32)
    for k, (fingers, solid) in enumerate(zip(hand.at(q), bodies, strict=True)):
        corners = np.concatenate([fingers, solid.at(body[k])])
        faces = np.concatenate([hand.faces, solid.faces + np.int32(len(fingers))])
        for view, camera in enumerate(cameras):
            E, bounds = edges(project(corners, camera), faces, camera.width, camera.height)
            fill(E, bounds, 0, len(faces), 1, near[k, view], seen[k, view])
    kind = np.where(seen < 0, NOTHING, np.where(seen < len(hand.faces), HAND, OBJECT)).astype(np.uint8)
    return DepthImages(np.divide(1.0, near, out=np.zeros_like(near), where=near > 0), kind)


def unproject(cameras: Sequence[Camera], depth_m: np.ndarray, pixels: np.ndarray) -> np.ndarray:
    """(k, 3) world points of `pixels` (k,), flat indices into the depth images depth_m (c, h, w) of one world."""
    view, y, x = np.unravel_index(pixels, depth_m.shape)
    turn = np.stack([camera.T_world_cam[:3, :3] @ np.linalg.inv(camera.K) for camera in cameras])
    eye = np.stack([camera.T_world_cam[:3, 3] for camera in cameras])
    rays = np.stack([x, y, np.ones_like(x)], axis=1).astype(np.float64)
    found: np.ndarray = eye[view] + (turn[view] @ rays[:, :, None])[:, :, 0] * depth_m.reshape(-1)[pixels, None]
    return found


def _looking(place: np.ndarray) -> np.ndarray:
    """(4, 4) T_world_cam of a camera at a place (3,), facing LOOK_M."""
    T = np.eye(4)
    T[:3, :3], T[:3, 3] = facing(np.array(LOOK_M) - place), place
    return T


@dataclass(frozen=True)
class DepthNoise:
    """Depth noise of the cameras of one world: scatter and quantization, which grow with the squared distance, and holes."""

    scatter_m: float = 0.0
    """standard deviation of depth at 1 m"""
    step_m: float = 0.0
    """resolution of depth at 1 m: cameras measure disparity in whole steps"""
    holes: float = 0.0
    """share of pixels without a depth"""


RANDOM_DEPTH: Mapping[str, Range] = {
    "scatter_m": Range(0.0, 0.006),
    "step_m": Range(0.0, 0.004),
    "holes": Range(0.0, 0.05),
}
"""field of DepthNoise -> its range over worlds"""


def random_depth_noise(seed: int, ranges: Mapping[str, Range] = RANDOM_DEPTH) -> DepthNoise:
    """Draw the noise of one world; the same seed gives the same noise."""
    rng = np.random.default_rng([seed, 2])
    return DepthNoise(**{name: ranges[name].draw(rng) for name in sorted(ranges)})


def add_depth_noise(images: DepthImages, noise: Sequence[DepthNoise], rng: np.random.Generator) -> DepthImages:
    """Add its own noise to the images of each of n worlds. Without any noise no random number is drawn."""
    if all(one == DepthNoise() for one in noise):
        return images
    scatter, step, holes = (np.array([getattr(one, name) for one in noise])[:, None, None, None]
                            for name in ("scatter_m", "step_m", "holes"))  # fmt: skip
    depth = images.depth_m + scatter * images.depth_m**2 * rng.standard_normal(images.depth_m.shape)
    disparity = np.divide(1.0, depth, out=np.zeros_like(depth), where=depth > 0)
    whole = np.divide(disparity, step, out=disparity.copy(), where=step > 0)
    whole = np.where(step > 0, np.maximum(np.round(whole), 1.0) * step, disparity)
    gone = (images.kind == NOTHING) | (depth <= 0) | (rng.random(depth.shape) < holes)
    depth = np.divide(1.0, whole, out=np.zeros_like(depth), where=~gone)
    return replace(images, depth_m=depth.astype(np.float32), kind=np.where(gone, NOTHING, images.kind))
