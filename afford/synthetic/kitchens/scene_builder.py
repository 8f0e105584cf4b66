"""Scene builder: choice of objects, their poses on the table, and the grip by which each hand takes them.

World frame: z up, table top at z = 0, the person at -y facing +y. Scripts are written for a right-handed person;
`SceneBuilder.lead` is the leading hand, and positions are mirrored when it is the left one.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import product

import numpy as np

from afford.render.mesh import transform
from afford.render.motion import Pose, Track, axis_angle, pose
from afford.synthetic.assets.library import build
from afford.synthetic.assets.object_model import Grip, ObjectModel
from afford.synthetic.kitchens.animation import Animation, ArmMotion, SceneObject
from schemas.video import OTHER

CENTRE = np.array([0.0, 0.30])
"""Middle of the work area on the table, world x, y in metres."""
ELBOW = {"left": np.array([-0.34, -0.25, 0.10]), "right": np.array([0.34, -0.25, 0.10])}
YAWS = np.radians(np.arange(0, 360, 10))
MIN_HAND_GAP_M = 0.10
"""Minimum distance between the palms of two hands on one object, metres, so that the hands do not collide."""
RIGHT_HANDED_TOOLS = ("knife", "hammer", "saw")
"""Tools made for the right hand; a left-handed person gets the mirrored tool."""
COMFORT_SLACK = 0.12
"""Grips and yaw angles whose comfort is within this of the best are equally natural; the seed chooses among them."""


@dataclass(frozen=True)
class GripRequest:
    """Requested grip: the hand's side, and the allowed grip names or kinds (all when empty)."""

    side: str
    words: tuple[str, ...] = ()


class SceneBuilder:
    """Scene under construction: random generator, animation, and objects posed for the hands that take them."""

    def __init__(self, rng: np.random.Generator, animation: Animation, setting: str, key_gap: float) -> None:
        self.rng, self.animation, self.setting, self.key_gap = rng, animation, setting, key_gap
        self.lead = "right" if rng.random() < 0.5 else "left"

    @property
    def support(self) -> str:
        """The hand that does not lead."""
        return OTHER[self.lead]

    @property
    def mirror(self) -> float:
        """1 when the right hand leads, -1 when the left hand leads."""
        return 1.0 if self.lead == "right" else -1.0

    def arm(self, side: str) -> ArmMotion:
        """Return the arm of a side."""
        return self.animation.arms[side]

    def time_near(self, at: float) -> float:
        """Return a time jittered by up to 2 units."""
        return float(at + self.rng.uniform(-2.0, 2.0))

    def position(self, x: float, y: float, jitter_m: float = 0.02) -> np.ndarray:
        """Return a jittered position (3,) on the table, metres.

        `x` points to the side of the leading hand and `y` away from the person, both from the middle of the work area.
        """
        side, away = np.array([x, y]) + self.rng.uniform(-jitter_m, jitter_m, 2)
        return np.array([self.mirror * side + CENTRE[0], away + CENTRE[1], 0.0])

    def choose(self, kinds: Sequence[str]) -> str:
        """Choose one of several kinds at random."""
        return str(kinds[int(self.rng.integers(len(kinds)))])

    def add_object(self, kind: str, place: np.ndarray, *requests: GripRequest) -> tuple[SceneObject, list[Grip]]:
        """Add an object at `place` (3,), turned so that the requested hands reach it comfortably; return it and its grips."""
        model = build(kind, self.rng)
        if kind in RIGHT_HANDED_TOOLS and self.lead == "left":
            model = mirror_object(model)
        grips, yaw = self._choose_grips(model, place, requests)
        return self.add_model(model, pose(place, axis_angle((0, 0, 1), yaw))), grips

    def add_model(self, model: ObjectModel, at: Pose) -> SceneObject:
        """Add a given object model to the animation at a pose."""
        obj = SceneObject(plain_name(model.noun), model, Track(at, []))
        self.animation.objects.append(obj)
        return obj

    def add_jar(self, at: np.ndarray) -> tuple[SceneObject, SceneObject, list[Grip]]:
        """Add a closed jar as two objects, jar and lid, with grips for the supporting hand (jar) and the leading hand (lid)."""
        model = build("jar", self.rng)
        body, lid = split_moving(model)
        (hold,), yaw = self._choose_grips(body, at, [GripRequest(self.support)])
        (twist,), _ = self._choose_grips(lid, at, [GripRequest(self.lead)])
        stand = pose(at, axis_angle((0, 0, 1), yaw))
        turns = [pose((0, 0, 0), axis_angle((0, 0, 1), angle)) for angle in YAWS]
        best = max(turns, key=lambda turn: comfort(stand @ turn @ twist.T_obj_palm, self.lead))
        twist = replace(twist, T_obj_palm=best @ twist.T_obj_palm)
        return self.add_model(body, stand), self.add_model(lid, stand), [hold, twist]

    def add_hinged(self, kind: str, at: np.ndarray) -> tuple[SceneObject, list[Grip]]:
        """Add a hinged object, with grips for the supporting hand (fixed part) and the leading hand (moving part)."""
        model = build(kind, self.rng)
        still = replace(model, grips=tuple(g for g in model.grips if not g.moving))
        moving = [g for g in model.grips_of(self.lead) if g.moving]
        (hold,), yaw = self._choose_grips(still, at, [GripRequest(self.support)])
        lift = moving[self.rng.integers(len(moving))]
        return self.add_model(model, pose(at, axis_angle((0, 0, 1), yaw))), [hold, lift]

    def follow_gaze(self, obj: SceneObject, take: float, drop: float) -> None:
        """Let the gaze move to an object, follow it, and return to the middle of the table."""
        head = self.animation.head
        rest = np.array([*CENTRE, 0.04])
        head.look(0, 1, rest + self.rng.uniform(-0.05, 0.05, 3) * (1, 1, 0))
        for time in np.arange(take - 14, drop, 16.0):
            ahead = obj.at(time + 14)[:3, 3]
            head.look(time, time + 18, rest + 0.55 * (ahead - rest) + self.rng.uniform(-0.03, 0.03, 3) * (1, 1, 0))
        head.look(drop - 4, drop + 20, rest + self.rng.uniform(-0.05, 0.05, 3) * (1, 1, 0))

    def _choose_grips(self, model: ObjectModel, place: np.ndarray, requests: Sequence[GripRequest]) -> tuple[list[Grip], float]:
        if not requests:
            return [], float(self.rng.uniform(-0.6, 0.6))
        ways: list[tuple[float, list[Grip], float]] = []
        for grips in product(*(self._matching_grips(model, request) for request in requests)):
            if len(grips) > 1 and _palm_distance(grips) < MIN_HAND_GAP_M:
                continue
            scores = [
                min(comfort(pose(place, axis_angle((0, 0, 1), yaw)) @ grip.T_obj_palm, grip.side) for grip in grips) for yaw in YAWS
            ]
            best = float(np.max(scores))
            ways += [(s, list(grips), float(yaw)) for s, yaw in zip(scores, YAWS, strict=True) if s > best - COMFORT_SLACK / 3]
        if not ways:
            raise LookupError(f"{model.kind}: no two grips of {[request.side for request in requests]} keep the hands apart")
        limit = max(way[0] for way in ways) - COMFORT_SLACK
        names = sorted({tuple(g.name for g in way[1]) for way in ways if way[0] > limit})
        chosen = names[self.rng.integers(len(names))]
        fitting = [way for way in ways if tuple(g.name for g in way[1]) == chosen and way[0] > limit]
        _, held, turn = fitting[int(self.rng.integers(len(fitting)))]
        return held, turn

    def _matching_grips(self, model: ObjectModel, request: GripRequest) -> list[Grip]:
        found = [g for g in model.grips_of(request.side) if not request.words or g.name in request.words or g.kind in request.words]
        if not found:
            raise LookupError(
                f"{model.kind}: expected a {request.side} grip of {request.words}, got {[g.name for g in model.grips]}"
            )
        return found


def _palm_distance(grips: tuple[Grip, ...]) -> float:
    """Return the distance between the palms of two grips, metres."""
    return float(np.linalg.norm(grips[0].T_obj_palm[:3, 3] - grips[1].T_obj_palm[:3, 3]))


def split_moving(model: ObjectModel) -> tuple[ObjectModel, ObjectModel]:
    """Split an object model into its fixed and its moving parts, in the same frame (a jar and its lid)."""
    body = replace(
        model, parts=tuple(p for p in model.parts if not p.moving), joint=None, grips=tuple(g for g in model.grips if not g.moving)
    )
    parts = tuple(replace(p, moving=False) for p in model.parts if p.moving)
    grips = tuple(replace(g, moving=False) for g in model.grips if g.moving)
    lid = replace(model, kind="lid", noun="lid", parts=parts, joint=None, grips=grips, opening=None)
    return body, lid


def mirror_object(model: ObjectModel) -> ObjectModel:
    """Mirror an object model in its plane x = 0, and swap the sides of its grips."""
    flip = np.diag([-1.0, 1.0, 1.0, 1.0])
    parts = tuple(replace(p, mesh=transform(p.mesh, flip)) for p in model.parts)
    other = np.diag([1.0, -1.0, 1.0, 1.0])
    grips = tuple(replace(g, side=OTHER[g.side], T_obj_palm=flip @ g.T_obj_palm @ other) for g in model.grips)
    tip = None if model.tip is None else (-model.tip[0], model.tip[1], model.tip[2])
    return replace(model, parts=parts, grips=grips, tip=tip)


def lowest_z(model: ObjectModel) -> float:
    """Return the height of the lowest point of an object in its own frame, metres."""
    return float(model.points[:, 2].min())


def comfort(T_world_palm: Pose, side: str) -> float:
    """Score the comfort of a palm pose for an arm, about -2..1.

    The score is high when the forearm points to the elbow, the wrist stays above the table and the palm does not face up.
    """
    back = -T_world_palm[:3, 0]
    to_elbow = ELBOW[side] - T_world_palm[:3, 3]
    to_elbow /= np.linalg.norm(to_elbow)
    wrist_height = T_world_palm[2, 3] + 0.09 * back[2]
    palm_up = max(0.0, T_world_palm[2, 2])
    return float(back @ to_elbow) - 12 * max(0.0, 0.02 - wrist_height) - 0.5 * palm_up


def plain_name(noun: str) -> str:
    """Convert an EPIC noun to plain words: 'board:chopping' becomes 'chopping board'."""
    return " ".join(reversed(noun.split(":")))
