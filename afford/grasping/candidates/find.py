"""A look at a thing -> grasps of the hands that its task takes, best first, and of two hands those that go together."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np
from scipy.spatial import cKDTree
from scipy.spatial.transform import Rotation

from afford.grasping.candidates.point_cloud import LIFT_M, PointCloud, SupportPlane, object_points, point_cloud, support_plane
from afford.grasping.candidates.sample_poses import GraspPose, sample_poses, spread_places
from schemas.grasp import TERMS, GraspCandidates, GraspScene, HandCandidates
from schemas.video import SIDES, Hand

WEIGHTS: Mapping[str, float] = {"positive": 2.0, "negative": 1.0, "antipodal": 0.5, "centred": 1.0, "clear": 1.0, "fit": 0.5,
                                "upright": 1.0, "reach": 0.1}  # fmt: skip
TIP_X_M = np.array([0.01, 0.016, -0.006, -0.028, -0.052])
"""thumb, index, middle, ring and little finger along the thing, thumb's side positive: the Shadow Hand as the script closes it"""
SAFE_M, FREE_M = 0.02, 0.05
"""fingertips nearer to a negative point rule a pose out; from the other on, nothing is gained (AS of AffordDex: 2 cm)"""
CLEAR_M = 0.02
"""fingers that are so far from all else are clear of it"""
SINK_M = 0.006
"""fingertips so far below what the thing lies on are not possible"""
ROOM_M = 0.01
"""between the tip of a finger and what it closes on, before it closes"""
CENTRED_M = 0.06
"""so far from the middle of the thing a grasp is worth half"""
EASY = 0.6
"""share of the span up to which a width is held with ease"""


@dataclass(frozen=True, eq=False)
class ScoringContext:
    """What poses of one hand are judged against."""

    cloud: PointCloud
    region: np.ndarray
    """(n,) share of each point where this hand belongs"""
    body: np.ndarray
    """(n,) bool, the points of the thing"""
    support: SupportPlane
    negative: np.ndarray
    """(k, 3) points that no hand may touch"""
    span_m: float
    """the widest that the hand spans"""
    shoulder: np.ndarray
    """(3,) where the arm comes from, camera frame"""
    side: str


def fingertips(found: Sequence[GraspPose], side: str, room_m: float = 0.0) -> np.ndarray:
    """(n, 5, 3) where fingers end, thumb first; `room_m` farther apart than what they hold is wide."""
    mirror = 1.0 if side == "right" else -1.0
    local = np.zeros((len(found), 5, 3))
    half = np.array([pose.width_m for pose in found])[:, None] / 2 + room_m
    local[:, :, 0], local[:, :, 2] = mirror * TIP_X_M, half * np.array([-1.0, 1.0, 1.0, 1.0, 1.0])
    R, place = np.array([pose.R for pose in found]), np.array([pose.place for pose in found])
    return np.einsum("nij,nkj->nki", R, local) + place[:, None]


def score_terms(found: Sequence[GraspPose], sight: ScoringContext) -> np.ndarray:
    """(n, 8) the terms of each pose."""
    ends, open_ends = fingertips(found, sight.side), fingertips(found, sight.side, ROOM_M)
    columns = {
        "positive": _positive(found, sight), "negative": _negative(ends, open_ends, sight),
        "antipodal": np.array([0.5 * (1 + pose.square) for pose in found]), "centred": _centred(found, sight),
        "clear": _clear(found, open_ends, sight), "fit": _fit(found, sight.span_m),
        "upright": _upright(found, sight), "reach": _reach(found, sight)}  # fmt: skip
    return np.stack([columns[name].clip(0.0, 1.0) for name in TERMS], axis=1)


def score(terms: np.ndarray, weights: Mapping[str, float] = WEIGHTS) -> np.ndarray:
    """(n,) weighted geometric mean of terms (n, 8)."""
    w = np.array([weights[name] for name in TERMS])
    found: np.ndarray = np.prod(terms ** (w / w.sum()), axis=1)
    return found


def _positive(found: Sequence[GraspPose], sight: ScoringContext) -> np.ndarray:
    """Share of what is between thumb and fingers that is positive."""
    points, share, tree = sight.cloud.points[sight.body], sight.region[sight.body], cKDTree(sight.cloud.points[sight.body])
    mirror = 1.0 if sight.side == "right" else -1.0
    low, high = np.sort(mirror * np.array([TIP_X_M.min(), TIP_X_M.max()]))
    reach = float(max(abs(low), high)) + sight.span_m
    near = tree.query_ball_point(np.array([pose.place for pose in found]), reach)
    out = np.zeros(len(found))
    for n, (pose, k) in enumerate(zip(found, near, strict=True)):
        local = (points[k] - pose.place) @ pose.R
        held = (local[:, 0] >= low) & (local[:, 0] <= high) & (np.abs(local[:, 2]) <= pose.width_m / 2 + ROOM_M / 2)
        out[n] = share[k][held].mean() if held.any() else 0.0
    return out


def _negative(ends: np.ndarray, open_ends: np.ndarray, sight: ScoringContext) -> np.ndarray:
    """0 within SAFE_M of a negative point, open or closed, 1 from FREE_M on."""
    if not len(sight.negative):
        return np.ones(len(ends))
    tree = cKDTree(sight.negative)
    least = np.minimum(tree.query(ends)[0].min(1), tree.query(open_ends)[0].min(1))
    found: np.ndarray = np.where(least > SAFE_M, 0.25 + 0.75 * (least - SAFE_M) / (FREE_M - SAFE_M), 0.0)
    return found


def _centred(found: Sequence[GraspPose], sight: ScoringContext) -> np.ndarray:
    """How near the middle of all that is seen of the thing is, beside the approach: a thing held there does not turn."""
    middle = sight.cloud.points[sight.body].mean(0)
    aside = [middle - pose.place - pose.R[:, 1] * (pose.R[:, 1] @ (middle - pose.place)) for pose in found]
    far = np.linalg.norm(np.array(aside), axis=1)
    found_: np.ndarray = 1.0 / (1.0 + (far / CENTRED_M) ** 2)
    return found_


def _clear(found: Sequence[GraspPose], open_ends: np.ndarray, sight: ScoringContext) -> np.ndarray:
    """How far open fingers stay from other things, and above what all lies on."""
    height = sight.support.height(open_ends).min(1)
    above = ((height + SINK_M) / SINK_M).clip(0.0, 1.0)
    other = sight.cloud.points[~sight.body & (sight.support.height(sight.cloud.points) > LIFT_M)]
    if not len(other):
        return above
    back = np.array([pose.R[:, 1] for pose in found])[:, None]
    fingers = np.concatenate([open_ends, open_ends + 0.03 * back, open_ends + 0.06 * back], axis=1)
    near: np.ndarray = cKDTree(other).query(fingers)[0].min(1)
    return np.minimum(above, (near / CLEAR_M).clip(0.0, 1.0))


def _fit(found: Sequence[GraspPose], span_m: float) -> np.ndarray:
    """1 for what is held with ease, 0 for what the hand does not span."""
    width = np.array([pose.width_m for pose in found])
    return (span_m - width) / ((1 - EASY) * span_m)


def _upright(found: Sequence[GraspPose], sight: ScoringContext) -> np.ndarray:
    """How straight the hand comes to what the thing lies on; without that, to the side that the camera sees."""
    up = sight.support.up if sight.support.known else -sight.cloud.points[sight.body].mean(0)
    straight = np.array([pose.R[:, 1] @ up for pose in found]) / np.linalg.norm(up)
    return straight.clip(0.0, 1.0) ** 2


def _reach(found: Sequence[GraspPose], sight: ScoringContext) -> np.ndarray:
    """Whether fingers point away from the shoulder that the arm comes from, beside the approach."""
    out = np.zeros(len(found))
    for n, pose in enumerate(found):
        arm = pose.place - sight.shoulder
        arm = arm - pose.R[:, 1] * (pose.R[:, 1] @ arm)
        out[n] = 0.5 + 0.5 * float(pose.R[:, 2] @ arm) / max(float(np.linalg.norm(arm)), 1e-9)
    return 0.05 + 0.95 * out


ALIKE_M, ALIKE_RAD = 0.015, np.radians(30)
"""a grasp nearer than both to a better one is left out"""
APART_M = 0.09
"""two hands whose grasps are nearer would touch each other; from twice that on they are free"""


@dataclass(frozen=True)
class SearchParams:
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


def find_candidates(scene: GraspScene, wish: SearchParams) -> GraspCandidates:
    """All grasps of a look. ValueError when a hand that is taken has no region with depth."""
    found = point_cloud(scene, wish.cell_m, wish.around_m)
    on = support_plane(found)
    hands = tuple(_hand(scene, found, on, side, n, wish) if scene.hands[n] else _none(side) for n, side in enumerate(SIDES))
    pair, pair_score = pair_hands(hands[0], hands[1]) if scene.hands.all() else (np.zeros((0, 2), np.int32), np.zeros(0))
    return GraspCandidates(scene.name, hands, pair, pair_score, on.up)


def pair_hands(left: HandCandidates, right: HandCandidates) -> tuple[np.ndarray, np.ndarray]:
    """(p, 2) int32 indices of grasps that go together and (p,) scores, best first: both good, and apart."""
    far = np.linalg.norm(left.T_cam_grasp[:, None, :3, 3] - right.T_cam_grasp[None, :, :3, 3], axis=2)
    both = np.sqrt(left.score[:, None] * right.score[None]) * ((far - APART_M) / APART_M).clip(0.0, 1.0)
    order = np.argsort(-both, axis=None, kind="stable")[: max(both.shape, default=0)]
    rows = np.stack(np.unravel_index(order, both.shape), axis=1).astype(np.int32)
    good = both.reshape(-1)[order] > 0
    return rows[good], both.reshape(-1)[order][good]


def _hand(scene: GraspScene, found: PointCloud, on: SupportPlane, side: Hand, row: int, wish: SearchParams) -> HandCandidates:
    share = found.region[row]
    if not (share >= 0.5).any():
        raise ValueError(f"{scene.name}: expected a region with depth for the {side} hand, got none; leave that hand out")
    body = object_points(found, share >= 0.5, on)
    spots = spread_places((share >= 0.5) & body, found, wish.places)
    tried = [pose for pose in sample_poses(found, body, spots, on, wish.lean_deg, wish.cell_m) if pose.width_m <= wish.span_m]
    if not tried:
        return _none(side)
    mirror = np.array([1.0 if side == "right" else -1.0, 1.0, 1.0])
    bad = np.concatenate([found.points[found.negative >= 0.5], scene.N_t])
    sight = ScoringContext(found, share, body, on, bad, wish.span_m, mirror * wish.shoulder_m, side)
    terms = score_terms(tried, sight)
    return _best(tried, terms, score(terms), side, wish.count)


def _best(tried: Sequence[GraspPose], terms: np.ndarray, value: np.ndarray, side: Hand, count: int) -> HandCandidates:
    """The best that differ from each other, none with a score of 0."""
    kept: list[int] = []
    for k in np.argsort(-value, kind="stable"):
        if len(kept) == count or value[k] <= 0:
            break
        if not any(_alike(tried[k], tried[other]) for other in kept):
            kept.append(int(k))
    return _rows([tried[k] for k in kept], terms[kept], value[kept], side)


def _alike(a: GraspPose, b: GraspPose) -> bool:
    if np.linalg.norm(a.place - b.place) > ALIKE_M:
        return False
    return bool(Rotation.from_matrix(a.R.T @ b.R).magnitude() < ALIKE_RAD)


def _rows(found: Sequence[GraspPose], terms: np.ndarray, value: np.ndarray, side: Hand) -> HandCandidates:
    T = np.tile(np.eye(4), (len(found), 1, 1))
    for row, pose in zip(T, found, strict=True):
        row[:3, :3], row[:3, 3] = pose.R, pose.place
    ends = fingertips(found, side) if found else np.zeros((0, 5, 3))
    return HandCandidates(side, T, -T[:, :3, 1], np.array([pose.width_m for pose in found]), ends, value, terms)


def _none(side: Hand) -> HandCandidates:
    return _rows([], np.zeros((0, len(TERMS))), np.zeros(0), side)
