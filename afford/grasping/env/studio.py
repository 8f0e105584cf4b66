"""Pictures of a grasp out of its trace alone: hand, object, table and goal, from three quarters above, without an engine.

What must not be touched is red, what is to be held ochre, the rest of the object slate; where N_t is no part, its points are red.
The hand has its own colour. The goal is a ring around the place where the centre of mass is to be, as wide as success is.
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
from afford.grasping.env.reward import GOAL_M
from afford.grasping.hand.kinematics import forward_kinematics
from afford.grasping.hand.link_meshes import link_meshes
from afford.render.draw import render
from afford.render.mesh import Mesh, merge, mesh, moved
from afford.render.scene import Camera, Instance, Light, Material, Rendered, Textures
from afford.render.solids import box, patch, tube
from schemas.episodes import GraspTrace
from schemas.grasp import GraspObject, GraspTask
from schemas.hand import HandModel

NEGATIVE: Colour = (205, 45, 40)
HELD: Colour = (214, 158, 74)
OTHER: Colour = (104, 122, 138)
TABLE: Colour = (146, 140, 132)
GOAL: Colour = (30, 150, 90)
HAND_SHADE = 0.62
"""of the hand's own colour, so that a white hand shows its form"""
HAND, THING, GROUND, RING = 0, 1, 2, 3
"""entities of the id map"""
DOT_M = 0.006
"""side of the box that stands for a point of N_t"""
RING_M, RING_CORNERS = 0.0011, 48
"""thickness and corners of the goal's ring"""
TABLE_M = 3.0
"""side of the table"""
TURN_RAD, UP = 0.5, 0.6
"""where the camera stands, seen from what it looks at: level in the direction of the fingers, turned from it about the vertical
away from the thumb, and how far up for each metre along the table"""
DISTANCE_M, SEEN_M, MIDDLE = 1.1, 0.44, 0.68
"""of the camera; height of what it sees there; height of the middle of the picture, as a share of the goal's"""
FROM = (-0.55, 0.25, 0.9)
"""the lamp, seen from there: to the right, towards the camera, up"""
LAMP = Light(colour=(1.0, 0.96, 0.88), ceiling=(0.3, 0.31, 0.33), sky=(0.3, 0.31, 0.33), ground=(0.2, 0.19, 0.18), softness=0.07,
             radius_m=0.5, vignette=0.06)  # fmt: skip


class Piece(NamedTuple):
    """A convex piece of an object."""

    part: int
    vertices: np.ndarray
    """(v, 3) float64 m, object frame"""
    faces: np.ndarray
    """(f, 3) int64, counter-clockwise seen from outside"""


class Episode(NamedTuple):
    """An episode to be shown, and how to draw a row of it: (h, w, 3) uint8."""

    trace: GraspTrace
    task: GraspTask
    draw: Callable[[int], np.ndarray]


class Studio:
    """One hand and one object, ready to be drawn at any moment of their traces."""

    def __init__(self, hand: HandModel, task: GraspTask, width: int = 320, height: int = 240, supersample: int = 2) -> None:
        self.hand, self.task = hand, task
        self.width, self.height, self._supersample = width, height, supersample
        self._links = [(skin.link, mesh(skin.vertices, skin.faces)) for skin in link_meshes(hand)]
        self._look = {key: Material(_image(colour), roughness=0.5) for key, colour in _colours(task, hand).items()}
        self._parts = [(colour, merge(*(mesh(piece.vertices, piece.faces, crease_deg=25) for piece in found)))
                       for colour, found in _by_colour(task).items()]  # fmt: skip
        self._table = patch(np.array([-TABLE_M / 2, -TABLE_M / 2, 0]), np.array([TABLE_M, 0, 0]), np.array([0, TABLE_M, 0]))
        self._dots = [_dots(task.N_t)] if loose(task) else []
        self._textures = Textures.of(self._look.values())

    def shoot(self, trace: GraspTrace, row: int) -> Rendered:
        """Row `row` of a trace, from where `view` stands: depth_m in metres, ids HAND, THING, GROUND, RING."""
        camera = view(trace, self.hand, self.width, self.height)
        return render(self._instances(trace, row), camera, _light(trace, camera), self._textures, supersample=self._supersample)

    def episode(self, trace: GraspTrace) -> Episode:
        """A trace of this object; a row is drawn once, however often it is asked for."""
        return Episode(trace, self.task, cache(lambda row: self.shoot(trace, row).rgb))

    def _instances(self, trace: GraspTrace, row: int) -> list[Instance]:
        T, body = forward_kinematics(self.hand.joints, trace.q[row : row + 1])[0], matrix(trace.body[row])
        circle = tube(ring(trace.goal), np.full(RING_CORNERS + 1, RING_M), 6)
        return [*(Instance(shape, self._look["hand"], T[link], HAND) for link, shape in self._links),
                *(Instance(shape, self._look[colour], body, THING) for colour, shape in self._parts),
                *(Instance(dots, self._look[str(NEGATIVE)], body, THING) for dots in self._dots),
                Instance(self._table, self._look["table"], entity=GROUND, casts=False),
                Instance(circle, self._look["goal"], entity=RING, casts=False)]  # fmt: skip


def view(trace: GraspTrace, hand: HandModel, width: int, height: int) -> Camera:
    """One for the whole trace, that looks into the hand as it begins."""
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


def pieces(body: GraspObject) -> tuple[Piece, ...]:
    """The hulls of an object as triangles."""
    return tuple(Piece(int(part), *_hull(corners)) for part, corners in zip(body.hull_part, body.hulls(), strict=True))


def colour_of(task: GraspTask, part: int) -> Colour:
    """Of a part of the object."""
    name = task.body.parts[part]
    return NEGATIVE if name in task.negative else HELD if name == task.hold else OTHER


def loose(task: GraspTask) -> bool:
    """Whether N_t are points of no part."""
    return not task.negative and len(task.N_t) > 0


def matrix(pose: np.ndarray) -> np.ndarray:
    """(7,) a pose -> (4, 4)."""
    T = np.eye(4)
    T[:3, :3], T[:3, 3] = Rotation.from_quat(pose[3:]).as_matrix(), pose[:3]
    return T


def hand_colour(hand: HandModel) -> Colour:
    """That of its palm, darker."""
    r, g, b = (HAND_SHADE * hand.rgb[hand.palm]).astype(int).tolist()
    return r, g, b


def ring(goal: np.ndarray) -> np.ndarray:
    """(k, 3) a level circle around the goal, its first point again at the end, as wide as success."""
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
    """A small box around each point (k, 3)."""
    dot = box((DOT_M, DOT_M, DOT_M), bevel=0.0)
    return merge(*(moved(dot, x, y, z - DOT_M / 2) for x, y, z in points.tolist()))


def _by_colour(task: GraspTask) -> dict[str, list[Piece]]:
    found: dict[str, list[Piece]] = {}
    for piece in pieces(task.body):
        found.setdefault(str(colour_of(task, piece.part)), []).append(piece)
    return found


def _colours(task: GraspTask, hand: HandModel) -> dict[str, Colour]:
    parts = {str(colour): colour for colour in (NEGATIVE, HELD, OTHER)}
    return {"hand": hand_colour(hand), "table": TABLE, "goal": GOAL, **parts}


def _image(colour: Colour) -> np.ndarray:
    return np.full((1, 1, 3), colour, np.uint8)


def _middle(trace: GraspTrace) -> np.ndarray:
    """(3,) what the camera looks at."""
    found: np.ndarray = trace.goal * (1, 1, MIDDLE)
    return found


def _light(trace: GraspTrace, camera: Camera) -> Light:
    """A lamp that stands beside the camera, wherever that is."""
    right, near = camera.T_world_cam[:3, 0], -camera.T_world_cam[:3, 2] * (1, 1, 0)
    x, y, z = (-(FROM[0] * right + FROM[1] * near / np.linalg.norm(near)) - (0, 0, FROM[2])).tolist()
    a, b, c = _middle(trace).tolist()
    return replace(LAMP, direction=(x, y, z), centre=(a, b, c))
