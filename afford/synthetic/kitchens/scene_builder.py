"""Casting: which object plays, where it stands, how it is turned, and by which grip each hand takes it.

World: z up, table top at z = 0, the person at -y looking along +y. Scripts write for a right-handed act; `Cast.lead` says which
hand leads, and mirrored positions follow from it.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import product

import numpy as np

from afford.render.mesh import transform
from afford.render.motion import Pose, Track, about, pose
from afford.synthetic.assets.library import build
from afford.synthetic.assets.object_model import Grip, ObjectModel
from afford.synthetic.kitchens.animation import Arm, Play, Thing
from schemas.video import OTHER

CENTRE = np.array([0.0, 0.30])
"""Middle of the work area on the table, world x, y in metres."""
ELBOW = {"left": np.array([-0.34, -0.25, 0.10]), "right": np.array([0.34, -0.25, 0.10])}
YAWS = np.radians(np.arange(0, 360, 10))
BOTH_APART_M = 0.10
"""Palms of two hands on one thing are at least so far apart, or the hands would run into each other."""
HANDED = ("knife", "hammer", "saw")
"""Tools that are made for the right hand: a left-handed person has the mirrored one."""
SLACK = 0.12
"""Grips and turns whose comfort is within this of the best one are all natural; the seed chooses among them."""


@dataclass(frozen=True)
class Want:
    """How a hand shall hold: its side, and the names or kinds of grips that will do (all when empty)."""

    side: str
    words: tuple[str, ...] = ()


class Cast:
    """What a script works with: a random generator, the play, and objects that suit the hands."""

    def __init__(self, rng: np.random.Generator, play: Play, setting: str, key_gap: float) -> None:
        self.rng, self.play, self.setting, self.key_gap = rng, play, setting, key_gap
        self.lead = "right" if rng.random() < 0.5 else "left"

    @property
    def support(self) -> str:
        """The hand that does not lead."""
        return OTHER[self.lead]

    @property
    def mirror(self) -> float:
        """1 when the right hand leads, -1 when the left does."""
        return 1.0 if self.lead == "right" else -1.0

    def arm(self, side: str) -> Arm:
        """The arm of a side."""
        return self.play.arms[side]

    def beat(self, at: float) -> float:
        """A moment of the play, a little early or late by seed."""
        return float(at + self.rng.uniform(-2.0, 2.0))

    def spot(self, x: float, y: float, jitter_m: float = 0.02) -> np.ndarray:
        """A place (3,) on the table: x to the side of the leading hand, y away from the person, from the middle, metres."""
        side, away = np.array([x, y]) + self.rng.uniform(-jitter_m, jitter_m, 2)
        return np.array([self.mirror * side + CENTRE[0], away + CENTRE[1], 0.0])

    def pick(self, kinds: Sequence[str]) -> str:
        """One of several kinds."""
        return str(kinds[int(self.rng.integers(len(kinds)))])

    def thing(self, kind: str, place: np.ndarray, *wants: Want) -> tuple[Thing, list[Grip]]:
        """A new object at `place` (3,), turned so that the wanted hands can take it in comfort, and the grips they will use."""
        model = build(kind, self.rng)
        if kind in HANDED and self.lead == "left":
            model = mirrored(model)
        grips, yaw = self._cast(model, place, wants)
        return self.place(model, pose(place, about((0, 0, 1), yaw))), grips

    def place(self, model: ObjectModel, at: Pose) -> Thing:
        """An object that takes part."""
        thing = Thing(plain_name(model.noun), model, Track(at, []))
        self.play.things.append(thing)
        return thing

    def jar(self, at: np.ndarray) -> tuple[Thing, Thing, list[Grip]]:
        """A closed jar as two things, jar and lid, with the grips of the supporting hand (jar) and the leading one (lid)."""
        model = build("jar", self.rng)
        body, lid = split(model)
        (hold,), yaw = self._cast(body, at, [Want(self.support)])
        (twist,), _ = self._cast(lid, at, [Want(self.lead)])
        stand = pose(at, about((0, 0, 1), yaw))
        turn = max(YAWS, key=lambda angle: comfort(stand @ pose((0, 0, 0), about((0, 0, 1), angle)) @ twist.T_obj_palm, self.lead))
        twist = replace(twist, T_obj_palm=pose((0, 0, 0), about((0, 0, 1), turn)) @ twist.T_obj_palm)
        return self.place(body, stand), self.place(lid, stand), [hold, twist]

    def hinged(self, kind: str, at: np.ndarray) -> tuple[Thing, list[Grip]]:
        """An object with a hinge, and the grips of the supporting hand (still part) and the leading one (moving part)."""
        model = build(kind, self.rng)
        still = replace(model, grips=tuple(g for g in model.grips if not g.moving))
        moving = [g for g in model.grips_of(self.lead) if g.moving]
        (hold,), yaw = self._cast(still, at, [Want(self.support)])
        lift = moving[self.rng.integers(len(moving))]
        return self.place(model, pose(at, about((0, 0, 1), yaw))), [hold, lift]

    def watch(self, thing: Thing, take: float, drop: float) -> None:
        """Let the gaze go to a thing, follow it, and come back to the middle of the table."""
        head = self.play.head
        rest = np.array([*CENTRE, 0.04])
        head.look(0, 1, rest + self.rng.uniform(-0.05, 0.05, 3) * (1, 1, 0))
        for time in np.arange(take - 14, drop, 16.0):
            ahead = thing.at(time + 14)[:3, 3]
            head.look(time, time + 18, rest + 0.55 * (ahead - rest) + self.rng.uniform(-0.03, 0.03, 3) * (1, 1, 0))
        head.look(drop - 4, drop + 20, rest + self.rng.uniform(-0.05, 0.05, 3) * (1, 1, 0))

    def _cast(self, model: ObjectModel, place: np.ndarray, wants: Sequence[Want]) -> tuple[list[Grip], float]:
        if not wants:
            return [], float(self.rng.uniform(-0.6, 0.6))
        ways: list[tuple[float, list[Grip], float]] = []
        for grips in product(*(self._suitable(model, want) for want in wants)):
            if len(grips) > 1 and _apart(grips) < BOTH_APART_M:
                continue
            scores = [min(comfort(pose(place, about((0, 0, 1), yaw)) @ grip.T_obj_palm, grip.side) for grip in grips)
                      for yaw in YAWS]
            best = float(np.max(scores))
            ways += [(s, list(grips), float(yaw)) for s, yaw in zip(scores, YAWS, strict=True) if s > best - SLACK / 3]
        if not ways:
            raise LookupError(f"{model.kind}: no two grips of {[want.side for want in wants]} keep the hands apart")
        limit = max(way[0] for way in ways) - SLACK
        names = sorted({tuple(g.name for g in way[1]) for way in ways if way[0] > limit})
        chosen = names[self.rng.integers(len(names))]
        fitting = [way for way in ways if tuple(g.name for g in way[1]) == chosen and way[0] > limit]
        _, held, turn = fitting[int(self.rng.integers(len(fitting)))]
        return held, turn

    def _suitable(self, model: ObjectModel, want: Want) -> list[Grip]:
        found = [g for g in model.grips_of(want.side) if not want.words or g.name in want.words or g.kind in want.words]
        if not found:
            raise LookupError(f"{model.kind}: expected a {want.side} grip of {want.words}, got {[g.name for g in model.grips]}")
        return found


def _apart(grips: tuple[Grip, ...]) -> float:
    """Distance of the palms of two grips, metres."""
    return float(np.linalg.norm(grips[0].T_obj_palm[:3, 3] - grips[1].T_obj_palm[:3, 3]))


def split(model: ObjectModel) -> tuple[ObjectModel, ObjectModel]:
    """The still and the moving parts as two objects in the same frame: a jar and its lid."""
    body = replace(model, parts=tuple(p for p in model.parts if not p.moving), joint=None,
                   grips=tuple(g for g in model.grips if not g.moving))
    parts = tuple(replace(p, moving=False) for p in model.parts if p.moving)
    grips = tuple(replace(g, moving=False) for g in model.grips if g.moving)
    lid = replace(model, kind="lid", noun="lid", parts=parts, joint=None, grips=grips, opening=None)
    return body, lid


def mirrored(model: ObjectModel) -> ObjectModel:
    """The object for the other hand: everything mirrored in its plane x = 0, sides of grips swapped."""
    flip = np.diag([-1.0, 1.0, 1.0, 1.0])
    parts = tuple(replace(p, mesh=transform(p.mesh, flip)) for p in model.parts)
    other = np.diag([1.0, -1.0, 1.0, 1.0])
    grips = tuple(replace(g, side=OTHER[g.side], T_obj_palm=flip @ g.T_obj_palm @ other) for g in model.grips)
    tip = None if model.tip is None else (-model.tip[0], model.tip[1], model.tip[2])
    return replace(model, parts=parts, grips=grips, tip=tip)


def floor_of(model: ObjectModel) -> float:
    """Height of the lowest point of an object in its own frame, metres."""
    return float(model.points[:, 2].min())


def comfort(T_world_palm: Pose, side: str) -> float:
    """How naturally an arm reaches a palm pose, about -2..1: the forearm points to its elbow and stays above the table."""
    back = -T_world_palm[:3, 0]
    to_elbow = ELBOW[side] - T_world_palm[:3, 3]
    to_elbow /= np.linalg.norm(to_elbow)
    wrist_height = T_world_palm[2, 3] + 0.09 * back[2]
    palm_up = max(0.0, T_world_palm[2, 2])
    return float(back @ to_elbow) - 12 * max(0.0, 0.02 - wrist_height) - 0.5 * palm_up


def plain_name(noun: str) -> str:
    """How an annotator would write an EPIC noun: 'board:chopping' is a chopping board."""
    return " ".join(reversed(noun.split(":")))
