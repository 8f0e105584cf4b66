"""How the hand takes a thing: which hand, which grip, how the thing is turned so that the arm reaches it in comfort."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from afford.render.mesh import merge
from afford.render.motion import Pose, about, pose
from afford.synthetic.assets.object_model import Grip, ObjectModel, palm_frame
from afford.synthetic.human_hand.skeleton import Distance, close_on, distance_to, opening_posture, posture, tips
from afford.synthetic.kitchens.scene_builder import CENTRE, HANDED, SLACK, comfort, mirrored

TURNS = np.radians(np.arange(0, 360, 15))
POINTS, STEPS = 1500, 14
"""Points on a thing that fingers close on, and in how many steps: enough for a hand that is a few dozen pixels wide."""
TALL_M = 0.075
"""Higher things are pushed with the flat palm, lower ones with the fingertips."""
TABLE_JITTER_M = 0.03


@dataclass(frozen=True, eq=False)
class Hold:
    """A thing on the table and the hand on it: T_world_obj at first, T_obj_palm, and the fingers (20,) before and on it."""

    model: ObjectModel
    side: str
    stand: Pose
    T_obj_palm: Pose
    opened: np.ndarray
    closed: np.ndarray

    @property
    def palm(self) -> Pose:
        """T_world_palm when the hand has just come to the thing."""
        return self.stand @ self.T_obj_palm


def grip_hold(model: ObjectModel, names: tuple[str, ...], rng: np.random.Generator) -> Hold:
    """A hand closed on the thing by one of the grips; LookupError when it has none of them."""
    side = _side(rng)
    model = mirrored(model) if side == "left" and model.kind in HANDED else model
    ways = [(g, turn) for g in model.grips_of(side) if not names or g.name in names for turn in TURNS]
    if not ways:
        raise LookupError(f"{model.kind}: expected a {side} grip of {names}, got {[g.name for g in model.grips]}")
    place = _place(rng)
    ease = np.array([comfort(pose(place, about((0, 0, 1), turn)) @ g.T_obj_palm, side) for g, turn in ways])
    good = np.flatnonzero(ease > ease.max() - SLACK)
    chosen, turn = ways[int(good[rng.integers(len(good))])]
    angles = close_on(chosen.kind, _surface_distance(model, chosen), STEPS)
    return Hold(model, side, pose(place, about((0, 0, 1), turn + rng.uniform(-0.1, 0.1))), chosen.T_obj_palm,
                opening_posture(chosen.kind), angles)  # fmt: skip


def push_hold(model: ObjectModel, rng: np.random.Generator) -> tuple[Hold, np.ndarray]:
    """A flat hand at the side of the thing, and the direction (3,) in which it will push: across, or across and away."""
    side = _side(rng)
    turn = rng.uniform(-0.35, 0.75)
    ahead = np.array([-np.cos(turn), np.sin(turn), 0.0]) * (1 if side == "right" else -1, 1, 1)
    stand = pose(_place(rng), about((0, 0, 1), rng.uniform(-np.pi, np.pi)))
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
    return Hold(model, side, stand, np.linalg.inv(stand) @ palm, flat, flat), ahead


def tap_hold(model: ObjectModel, rng: np.random.Generator) -> Hold:
    """A forefinger above the middle of a thing that lies flat before the person; the palm is that of the fingertip on it."""
    side = _side(rng)
    stand = pose(_place(rng), about((0, 0, 1), rng.uniform(-0.35, 0.35)))
    flip = 1.0 if side == "right" else -1.0
    palm = palm_frame((0, 0, 0), (0, 0.42, -0.9), (-0.30 * flip, 0.85, -0.40))
    angles = posture("point")
    index = tips(angles)[1] * (1, flip, 1)
    palm[:3, 3] = stand[:3, 3] + (0, 0, float(model.points[:, 2].max()) + 0.007) - palm[:3, :3] @ index
    return Hold(model, side, stand, np.linalg.inv(stand) @ palm, angles, angles)


def ahead_inside(hold: Hold) -> np.ndarray:
    """(3, 2) directions on the table: along the thing (its y), and from there to the side of the other hand."""
    ahead = hold.stand[:3, 1]
    return np.stack([ahead, np.cross((0, 0, 1.0 if hold.side == "right" else -1.0), ahead)], axis=1)


def _surface_distance(model: ObjectModel, chosen: Grip) -> Distance:
    shape = merge(*(part.mesh for part in model.parts))
    return distance_to(shape, np.linalg.inv(chosen.T_obj_palm), chosen.side, samples=POINTS)


def _side(rng: np.random.Generator) -> str:
    return "right" if rng.random() < 0.75 else "left"


def _place(rng: np.random.Generator) -> np.ndarray:
    """A place (3,) on the table, metres."""
    return np.array([*(CENTRE + rng.uniform(-TABLE_JITTER_M, TABLE_JITTER_M, 2)), 0.0])
