"""Renderers of recorded grasps and of retargeted motions, without a physics engine.

`GraspRenderer` draws hand, object, table and goal of a trace, from a three-quarter view above. Negative parts are red, the part
to hold is ochre, the rest of the object slate; N_t that belongs to no part is drawn as red points. The hand has its own colour.
The goal is a ring around the goal of the centre of mass, with the radius of success. `MotionRenderer` draws the robot hand in its
own colour, and next to it the bones of the person's hand.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from functools import cache
from typing import NamedTuple

import numpy as np
from scipy.spatial import ConvexHull
from scipy.spatial.transform import Rotation

from afford.common.palette import Colour
from afford.grasping.env.measures import GOAL_M
from afford.grasping.hand.kinematics import forward_kinematics
from afford.grasping.hand.link_meshes import link_meshes
from afford.grasping.motion.retarget import M
from afford.render.draw import render
from afford.render.mesh import Mesh, merge, mesh, translate
from afford.render.scene import Camera, Instance, Light, Material, Rendered, Textures
from afford.render.solids import box, patch, tube
from schemas.episodes import GraspTrace
from schemas.grasp import GraspObject, GraspTask
from schemas.hand import HandModel, HandMotion, HandReference

NEGATIVE: Colour = (205, 45, 40)
HELD: Colour = (214, 158, 74)
OTHER: Colour = (104, 122, 138)
TABLE: Colour = (146, 140, 132)
GOAL: Colour = (30, 150, 90)
HAND_SHADE = 0.62
"""brightness of the hand relative to its own colour, so that a white hand shows its form"""
HAND, THING, GROUND, RING = 0, 1, 2, 3
"""entities of the id map"""
DOT_M = 0.006
"""side of the box that is drawn for a point of N_t"""
RING_M, RING_CORNERS = 0.0011, 48
"""thickness and corners of the goal's ring"""
TABLE_M = 3.0
"""side of the table"""
TURN_RAD, UP = 0.5, 0.6
"""direction to the camera: along the fingers, turned by TURN_RAD about the vertical away from the thumb, with slope UP"""
DISTANCE_M, SEEN_M, MIDDLE = 1.1, 0.44, 0.68
"""distance of the camera; height of its view there; height of the centre of the image, as a share of the goal's"""
FROM = (-0.55, 0.25, 0.9)
"""direction to the lamp from the centre of the image: to the right, towards the camera, up"""
LAMP = Light(colour=(1.0, 0.96, 0.88), ceiling=(0.3, 0.31, 0.33), sky=(0.3, 0.31, 0.33), ground=(0.2, 0.19, 0.18), softness=0.07,
             radius_m=0.5, vignette=0.06)  # fmt: skip


class Piece(NamedTuple):
    """Convex piece of an object."""

    part: int
    vertices: np.ndarray
    """(v, 3) float64 m, object frame"""
    faces: np.ndarray
    """(f, 3) int64, counter-clockwise seen from outside"""


class DrawableEpisode(NamedTuple):
    """Recorded episode, and a function that draws one row of it: (h, w, 3) uint8."""

    trace: GraspTrace
    task: GraspTask
    draw: Callable[[int], np.ndarray]


class GraspRenderer:
    """Renderer of traces of one hand and one object."""

    def __init__(self, hand: HandModel, task: GraspTask, width: int = 320, height: int = 240, supersample: int = 2) -> None:
        self.hand, self.task = hand, task
        self.width, self.height, self._supersample = width, height, supersample
        self._links = [(skin.link, mesh(skin.vertices, skin.faces)) for skin in link_meshes(hand)]
        self._look = {key: Material(_image(colour), roughness=0.5) for key, colour in _colours(task, hand).items()}
        self._parts = [(colour, merge(*(mesh(piece.vertices, piece.faces, crease_deg=25) for piece in found)))
                       for colour, found in _by_colour(task).items()]  # fmt: skip
        self._table = patch(np.array([-TABLE_M / 2, -TABLE_M / 2, 0]), np.array([TABLE_M, 0, 0]), np.array([0, TABLE_M, 0]))
        self._dots = [_dots(task.N_t)] if has_free_points(task) else []
        self._textures = Textures.of(self._look.values())

    def render(self, trace: GraspTrace, row: int) -> Rendered:
        """Render row `row` of a trace by the camera of `camera_of`: depth_m in metres, ids HAND, THING, GROUND, RING."""
        camera = camera_of(trace, self.hand, self.width, self.height)
        return render(self._instances(trace, row), camera, _light(trace, camera), self._textures, supersample=self._supersample)

    def episode(self, trace: GraspTrace) -> DrawableEpisode:
        """Drawable episode of a trace of this object; drawn rows are cached."""
        return DrawableEpisode(trace, self.task, cache(lambda row: self.render(trace, row).rgb))

    def _instances(self, trace: GraspTrace, row: int) -> list[Instance]:
        T, body = forward_kinematics(self.hand.joints, trace.q[row : row + 1])[0], pose_matrix(trace.body[row])
        circle = tube(goal_ring(trace.goal), np.full(RING_CORNERS + 1, RING_M), 6)
        return [*(Instance(shape, self._look["hand"], T[link], HAND) for link, shape in self._links),
                *(Instance(shape, self._look[colour], body, THING) for colour, shape in self._parts),
                *(Instance(dots, self._look[str(NEGATIVE)], body, THING) for dots in self._dots),
                Instance(self._table, self._look["table"], entity=GROUND, casts=False),
                Instance(circle, self._look["goal"], entity=RING, casts=False)]  # fmt: skip


def camera_of(trace: GraspTrace, hand: HandModel, width: int, height: int) -> Camera:
    """Camera for a whole trace, which looks into the hand in its first row."""
    fingers = Rotation.from_quat(trace.palm[0, 3:]).as_matrix() @ hand.R_palm_grip[:, 2]
    thumb = -1 if hand.side == "left" else 1
    yaw = np.arctan2(fingers[1], fingers[0]) - thumb * TURN_RAD
    out = np.array([np.cos(yaw), np.sin(yaw), UP])
    z = -out / np.linalg.norm(out)
    x = np.array([-z[1], z[0], 0]) / -np.hypot(z[0], z[1])
    T = np.eye(4)
    T[:3, :3], T[:3, 3] = np.stack([x, np.cross(z, x), z], axis=1), _middle(trace) - DISTANCE_M * z
    focal = height * DISTANCE_M / SEEN_M
    return Camera(np.array([[focal, 0, (width - 1) / 2], [0, focal, (height - 1) / 2], [0, 0, 1.0]]), T, width, height)


def hull_pieces(body: GraspObject) -> tuple[Piece, ...]:
    """Hulls of an object as triangles."""
    return tuple(Piece(int(part), *_hull(corners)) for part, corners in zip(body.hull_part, body.hulls(), strict=True))


def colour_of(task: GraspTask, part: int) -> Colour:
    """Colour of a part of the object."""
    name = task.body.parts[part]
    return NEGATIVE if name in task.negative else HELD if name == task.hold else OTHER


def has_free_points(task: GraspTask) -> bool:
    """Test whether the points N_t belong to no part."""
    return not task.negative and len(task.N_t) > 0


def pose_matrix(pose: np.ndarray) -> np.ndarray:
    """Pose (7,) as a (4, 4) matrix."""
    T = np.eye(4)
    T[:3, :3], T[:3, 3] = Rotation.from_quat(pose[3:]).as_matrix(), pose[:3]
    return T


def hand_colour(hand: HandModel) -> Colour:
    """Colour of the palm of a hand, darkened by HAND_SHADE."""
    r, g, b = (HAND_SHADE * hand.rgb[hand.palm]).astype(int).tolist()
    return r, g, b


def goal_ring(goal: np.ndarray) -> np.ndarray:
    """(k, 3) closed horizontal circle around the goal, with the radius of success."""
    angle = np.linspace(0, 2 * np.pi, RING_CORNERS + 1)
    return goal + GOAL_M * np.stack([np.cos(angle), np.sin(angle), 0 * angle], axis=1)


def _hull(corners: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    hull = ConvexHull(corners)
    faces = hull.simplices.astype(np.int64)
    a, b, c = corners[faces].swapaxes(0, 1)
    inwards = (np.cross(b - a, c - a) * hull.equations[:, :3]).sum(axis=1) < 0
    faces[inwards] = faces[inwards][:, ::-1]
    return corners, faces


def _dots(points: np.ndarray) -> Mesh:
    """Small box around each point (k, 3)."""
    dot = box((DOT_M, DOT_M, DOT_M), bevel=0.0)
    return merge(*(translate(dot, x, y, z - DOT_M / 2) for x, y, z in points.tolist()))


def _by_colour(task: GraspTask) -> dict[str, list[Piece]]:
    found: dict[str, list[Piece]] = {}
    for piece in hull_pieces(task.body):
        found.setdefault(str(colour_of(task, piece.part)), []).append(piece)
    return found


def _colours(task: GraspTask, hand: HandModel) -> dict[str, Colour]:
    parts = {str(colour): colour for colour in (NEGATIVE, HELD, OTHER)}
    return {"hand": hand_colour(hand), "table": TABLE, "goal": GOAL, **parts}


def _image(colour: Colour) -> np.ndarray:
    return np.full((1, 1, 3), colour, np.uint8)


def _middle(trace: GraspTrace) -> np.ndarray:
    """(3,) point that the camera looks at."""
    found: np.ndarray = trace.goal * (1, 1, MIDDLE)
    return found


def _light(trace: GraspTrace, camera: Camera) -> Light:
    """Lamp next to the camera."""
    right, near = camera.T_world_cam[:3, 0], -camera.T_world_cam[:3, 2] * (1, 1, 0)
    x, y, z = (-(FROM[0] * right + FROM[1] * near / np.linalg.norm(near)) - (0, 0, FROM[2])).tolist()
    a, b, c = _middle(trace).tolist()
    return replace(LAMP, direction=(x, y, z), centre=(a, b, c))


PERSON: Colour = (213, 94, 0)
CHAINS = tuple((0, *range(first, first + 4)) for first in (1, 5, 9, 13, 17))
"""keypoints from the wrist to each fingertip"""
BONE_M, BESIDE_M, MOTION_SEEN_M, MOTION_DISTANCE_M = 0.0035, 0.2, 0.4, 1.2
"""radius of a bone; offset of the person's hand to the right of the robot hand; height of the view; distance of the camera"""
MOTION_VIEW = np.array([-0.6, -0.75, 0.45])
"""direction from the motion to the camera"""


class MotionRenderer:
    """Renderer of retargeted motions of one robot hand."""

    def __init__(self, hand: HandModel, width: int = 320, height: int = 240) -> None:
        self.hand, self.width, self.height = hand, width, height
        self._links = [(skin.link, mesh(skin.vertices, skin.faces)) for skin in link_meshes(hand)]
        self._look = {name: Material(np.full((1, 1, 3), colour, np.uint8), roughness=0.5)
                      for name, colour in (("hand", hand_colour(hand)), ("person", PERSON))}  # fmt: skip
        self._textures = Textures.of(self._look.values())

    def draw(self, reference: HandReference, theirs: np.ndarray, row: int) -> np.ndarray:
        """(height, width, 3) uint8 of row `row`; `theirs` (t, 21, 3) are the person's keypoints in the world of the reference."""
        T = forward_kinematics(self.hand.joints, reference.q[row : row + 1])[0]
        camera = self._camera(reference.tips_m[row].mean(axis=0))
        person = theirs[row] + BESIDE_M * camera.T_world_cam[:3, 0]
        shown = [Instance(shape, self._look["hand"], T[link]) for link, shape in self._links]
        shown += [Instance(tube(person[list(chain)], BONE_M, 8), self._look["person"]) for chain in CHAINS]
        x, y, z = (-MOTION_VIEW + [0, 0, -0.6]).tolist()
        a, b, c = reference.tips_m[row].mean(axis=0).tolist()
        return render(shown, camera, replace(LAMP, direction=(x, y, z), centre=(a, b, c)), self._textures, supersample=1).rgb

    def _camera(self, tips: np.ndarray) -> Camera:
        """Camera that follows the fingertips (f, 3)."""
        z = -MOTION_VIEW / np.linalg.norm(MOTION_VIEW)
        x = np.array([-z[1], z[0], 0]) / -np.hypot(z[0], z[1])
        T = np.eye(4)
        T[:3, :3], T[:3, 3] = np.stack([x, np.cross(z, x), z], axis=1), tips + BESIDE_M / 2 * x - MOTION_DISTANCE_M * z
        focal = self.height * MOTION_DISTANCE_M / MOTION_SEEN_M
        middle = ((self.width - 1) / 2, (self.height - 1) / 2)
        return Camera(np.array([[focal, 0, middle[0]], [0, focal, middle[1]], [0, 0, 1.0]]), T, self.width, self.height)


def placed_keypoints(motion: HandMotion, reference: HandReference) -> np.ndarray:
    """(t, 21, 3) keypoints of the person for every row of a reference, in its world."""
    step = max(1, round(motion.rate_hz / reference.rate_hz))
    found = motion.keypoints_m[::step][: len(reference.q)]
    placed: np.ndarray = (found @ M if reference.mirrored else found) @ reference.T_world_source[:3, :3].T
    return placed + reference.T_world_source[:3, 3]
