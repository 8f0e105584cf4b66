"""A look at a thing -> grasps of the hands that its task takes, best first, and of two hands those that go together."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np
from scipy.spatial.transform import Rotation

from afford.grasping.candidates.cloud import Cloud, cloud
from afford.grasping.candidates.judge import Sight, judge, score, tips
from afford.grasping.candidates.propose import Pose, places, poses
from afford.grasping.candidates.support import Support, support, thing
from schemas.grasp import TERMS, GraspCandidates, GraspScene, HandCandidates
from schemas.video import SIDES, Hand

ALIKE_M, ALIKE_RAD = 0.015, np.radians(30)
"""a grasp nearer than both to a better one is left out"""
APART_M = 0.09
"""two hands whose grasps are nearer would touch each other; from twice that on they are free"""


@dataclass(frozen=True)
class Wish:
    """What is asked of the grasps."""

    count: int = 10
    """grasps of each hand"""
    places: int = 64
    """that are tried in each region"""
    cell_m: float = 0.004
    """of the cloud"""
    around_m: float = 0.2
    """how far around the regions it is looked at"""
    span_m: float = 0.09
    """the widest that a hand spans"""
    lean_deg: float = 60.0
    """how far from upright a hand may come to a thing that lies on something"""
    shoulder_m: tuple[float, float, float] = field(default=(0.2, 0.25, 0.0))
    """where the right arm comes from, camera frame; the left one mirrored in x"""


def candidates(scene: GraspScene, wish: Wish) -> GraspCandidates:
    """All grasps of a look. ValueError when a hand that is taken has no region with depth."""
    found = cloud(scene, wish.cell_m, wish.around_m)
    on = support(found)
    hands = tuple(_hand(scene, found, on, side, n, wish) if scene.hands[n] else _none(side) for n, side in enumerate(SIDES))
    pair, pair_score = paired(hands[0], hands[1]) if scene.hands.all() else (np.zeros((0, 2), np.int32), np.zeros(0))
    return GraspCandidates(scene.name, hands, pair, pair_score, on.up)


def paired(left: HandCandidates, right: HandCandidates) -> tuple[np.ndarray, np.ndarray]:
    """(p, 2) int32 indices of grasps that go together and (p,) scores, best first: both good, and apart."""
    far = np.linalg.norm(left.T_cam_grasp[:, None, :3, 3] - right.T_cam_grasp[None, :, :3, 3], axis=2)
    both = np.sqrt(left.score[:, None] * right.score[None]) * ((far - APART_M) / APART_M).clip(0.0, 1.0)
    order = np.argsort(-both, axis=None, kind="stable")[: max(both.shape, default=0)]
    rows = np.stack(np.unravel_index(order, both.shape), axis=1).astype(np.int32)
    good = both.reshape(-1)[order] > 0
    return rows[good], both.reshape(-1)[order][good]


def _hand(scene: GraspScene, found: Cloud, on: Support, side: Hand, row: int, wish: Wish) -> HandCandidates:
    share = found.region[row]
    if not (share >= 0.5).any():
        raise ValueError(f"{scene.name}: expected a region with depth for the {side} hand, got none; leave that hand out")
    body = thing(found, share >= 0.5, on)
    spots = places((share >= 0.5) & body, found, wish.places)
    tried = [pose for pose in poses(found, body, spots, on, wish.lean_deg, wish.cell_m) if pose.width_m <= wish.span_m]
    if not tried:
        return _none(side)
    mirror = np.array([1.0 if side == "right" else -1.0, 1.0, 1.0])
    bad = np.concatenate([found.points[found.negative >= 0.5], scene.N_t])
    sight = Sight(found, share, body, on, bad, wish.span_m, mirror * wish.shoulder_m, side)
    terms = judge(tried, sight)
    return _best(tried, terms, score(terms), side, wish.count)


def _best(tried: Sequence[Pose], terms: np.ndarray, value: np.ndarray, side: Hand, count: int) -> HandCandidates:
    """The best that differ from each other, none with a score of 0."""
    kept: list[int] = []
    for k in np.argsort(-value, kind="stable"):
        if len(kept) == count or value[k] <= 0:
            break
        if not any(_alike(tried[k], tried[other]) for other in kept):
            kept.append(int(k))
    return _rows([tried[k] for k in kept], terms[kept], value[kept], side)


def _alike(a: Pose, b: Pose) -> bool:
    if np.linalg.norm(a.place - b.place) > ALIKE_M:
        return False
    return bool(Rotation.from_matrix(a.R.T @ b.R).magnitude() < ALIKE_RAD)


def _rows(found: Sequence[Pose], terms: np.ndarray, value: np.ndarray, side: Hand) -> HandCandidates:
    T = np.tile(np.eye(4), (len(found), 1, 1))
    for row, pose in zip(T, found, strict=True):
        row[:3, :3], row[:3, 3] = pose.R, pose.place
    ends = tips(found, side) if found else np.zeros((0, 5, 3))
    return HandCandidates(side, T, -T[:, :3, 1], np.array([pose.width_m for pose in found]), ends, value, terms)


def _none(side: Hand) -> HandCandidates:
    return _rows([], np.zeros((0, len(TERMS))), np.zeros(0), side)
