"""Initial grasp of a hand on an object: which hand, which grip, and an object yaw within comfortable reach."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from afford.render.mesh import merge
from afford.render.motion import Pose, axis_angle, pose
from afford.synthetic.assets.object_model import Grip, ObjectModel, palm_frame
from afford.synthetic.human_hand.skeleton import Distance, close_on, distance_to, opening_posture, posture, tips
from afford.synthetic.kitchens.scene_builder import CENTRE, COMFORT_SLACK, RIGHT_HANDED_TOOLS, comfort, mirror_object

TURNS = np.radians(np.arange(0, 360, 15))
POINTS, STEPS = 1500, 14
"""Surface points and steps for closing fingers on an object, enough for a hand a few dozen pixels wide."""
TALL_M = 0.075
"""Object height above which it is pushed with the flat palm, metres; lower ones are pushed with the fingertips."""
TABLE_JITTER_M = 0.03


@dataclass(frozen=True, eq=False)
class InitialGrasp:
    """Object on the table with a hand on it.

    T_world_obj at the start, T_obj_palm, and the finger joint angles (20,) before and during contact.
    """

    model: ObjectModel
    side: str
    T_world_obj: Pose
    T_obj_palm: Pose
    opened: np.ndarray
    closed: np.ndarray

    @property
    def palm(self) -> Pose:
        """T_world_palm at the moment of contact."""
        return self.T_world_obj @ self.T_obj_palm


def grip_hold(model: ObjectModel, names: tuple[str, ...], rng: np.random.Generator) -> InitialGrasp:
    """Close a hand on the object by one of the grips. Raises LookupError when the object has none of them."""
    side = _side(rng)
    model = mirror_object(model) if side == "left" and model.kind in RIGHT_HANDED_TOOLS else model
    ways = [(g, turn) for g in model.grips_of(side) if not names or g.name in names for turn in TURNS]
    if not ways:
        raise LookupError(f"{model.kind}: expected a {side} grip of {names}, got {[g.name for g in model.grips]}")
    place = _place(rng)
    ease = np.array([comfort(pose(place, axis_angle((0, 0, 1), turn)) @ g.T_obj_palm, side) for g, turn in ways])
    good = np.flatnonzero(ease > ease.max() - COMFORT_SLACK)
    chosen, turn = ways[int(good[rng.integers(len(good))])]
    angles = close_on(chosen.kind, _surface_distance(model, chosen), STEPS)
    return InitialGrasp(model, side, pose(place, axis_angle((0, 0, 1), turn + rng.uniform(-0.1, 0.1))), chosen.T_obj_palm,
                opening_posture(chosen.kind), angles)  # fmt: skip


def push_hold(model: ObjectModel, rng: np.random.Generator) -> tuple[InitialGrasp, np.ndarray]:
    """Place a flat hand at the side of the object; return it and the pushing direction (3,), sideways or sideways and away."""
    side = _side(rng)
    turn = rng.uniform(-0.35, 0.75)
    ahead = np.array([-np.cos(turn), np.sin(turn), 0.0]) * (1 if side == "right" else -1, 1, 1)
    stand = pose(_place(rng), axis_angle((0, 0, 1), rng.uniform(-np.pi, np.pi)))
    points = model.points @ stand[:3, :3].T + stand[:3, 3]
    height = float(points[:, 2].max())
    fingers = np.cross((0, 0, -1.0 if side == "right" else 1.0), ahead)
    if height < TALL_M:
        fingers = 0.5 * fingers + (0, 0, -0.85)
    palm = palm_frame((0, 0, 0), ahead, fingers)
    reach = 0.095 if height < TALL_M else 0.04
    level = 0.012 + 0.09 * 0.86 if height < TALL_M else max(0.052, 0.5 * height)
    middle = points.mean(axis=0)
    back = float(((points - middle) @ ahead).min()) - 0.009
    palm[:3, 3] = middle + ahead * back - reach * palm[:3, 0] * (1, 1, 0)
    palm[2, 3] = level
    flat = posture("flat")
    return InitialGrasp(model, side, stand, np.linalg.inv(stand) @ palm, flat, flat), ahead


def tap_hold(model: ObjectModel, rng: np.random.Generator) -> InitialGrasp:
    """Place an index finger above the middle of a flat object; the palm pose is that of the fingertip in contact."""
    side = _side(rng)
    stand = pose(_place(rng), axis_angle((0, 0, 1), rng.uniform(-0.35, 0.35)))
    flip = 1.0 if side == "right" else -1.0
    palm = palm_frame((0, 0, 0), (0, 0.42, -0.9), (-0.30 * flip, 0.85, -0.40))
    angles = posture("point")
    index = tips(angles)[1] * (1, flip, 1)
    palm[:3, 3] = stand[:3, 3] + (0, 0, float(model.points[:, 2].max()) + 0.007) - palm[:3, :3] @ index
    return InitialGrasp(model, side, stand, np.linalg.inv(stand) @ palm, angles, angles)


def table_axes(hold: InitialGrasp) -> np.ndarray:
    """Return directions (3, 2) on the table: along the object's y axis, and from there to the side of the other hand."""
    ahead = hold.T_world_obj[:3, 1]
    return np.stack([ahead, np.cross((0, 0, 1.0 if hold.side == "right" else -1.0), ahead)], axis=1)


def _surface_distance(model: ObjectModel, chosen: Grip) -> Distance:
    shape = merge(*(part.mesh for part in model.parts))
    return distance_to(shape, np.linalg.inv(chosen.T_obj_palm), chosen.side, samples=POINTS)


def _side(rng: np.random.Generator) -> str:
    return "right" if rng.random() < 0.75 else "left"


def _place(rng: np.random.Generator) -> np.ndarray:
    """Sample a position (3,) on the table, metres."""
    return np.array([*(CENTRE + rng.uniform(-TABLE_JITTER_M, TABLE_JITTER_M, 2)), 0.0])
