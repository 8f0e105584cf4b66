"""Find grasp candidates: score sampled poses, keep the best that differ, and pair those of two hands.

A score is the weighted geometric mean of eight terms in 0..1, so a term of 0 rules a pose out.
"""

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
"""thumb, index, middle, ring, little finger along the object, positive on the thumb's side; scripted Shadow Hand"""
SAFE_M, FREE_M = 0.02, 0.05
"""distance of fingertips to negative points that rules a pose out, and from which the term is 1 (AS of AffordDex: 2 cm)"""
CLEAR_M = 0.02
"""clearance of fingers from other objects at which the term is 1"""
SINK_M = 0.006
"""depth of fingertips below the support at which the term is 0"""
ROOM_M = 0.01
"""gap between a finger and the object before closing"""
CENTRED_M = 0.06
"""distance from the middle of the object at which the term is one half"""
EASY = 0.6
"""share of the span up to which the width term is 1"""


@dataclass(frozen=True, eq=False)
class ScoringContext:
    """Scene around the poses of one hand."""

    cloud: PointCloud
    region: np.ndarray
    """(n,) share of each point's pixels in the region of this hand"""
    body: np.ndarray
    """(n,) bool, the points of the object"""
    support: SupportPlane
    negative: np.ndarray
    """(k, 3) points that no hand may touch"""
    span_m: float
    """largest width that the hand spans"""
    shoulder: np.ndarray
    """(3,) origin of the arm, camera frame"""
    side: str


def fingertips(found: Sequence[GraspPose], side: str, room_m: float = 0.0) -> np.ndarray:
    """Return (n, 5, 3) fingertips, thumb first, `room_m` farther apart than the width of the grasp."""
    mirror = 1.0 if side == "right" else -1.0
    local = np.zeros((len(found), 5, 3))
    half = np.array([pose.width_m for pose in found])[:, None] / 2 + room_m
    local[:, :, 0], local[:, :, 2] = mirror * TIP_X_M, half * np.array([-1.0, 1.0, 1.0, 1.0, 1.0])
    R, place = np.array([pose.R for pose in found]), np.array([pose.place for pose in found])
    return np.einsum("nij,nkj->nki", R, local) + place[:, None]


def score_terms(found: Sequence[GraspPose], context: ScoringContext) -> np.ndarray:
    """Compute the terms of each pose, (n, 8)."""
    ends, open_ends = fingertips(found, context.side), fingertips(found, context.side, ROOM_M)
    columns = {
        "positive": _positive(found, context), "negative": _negative(ends, open_ends, context),
        "antipodal": np.array([0.5 * (1 + pose.square) for pose in found]), "centred": _centred(found, context),
        "clear": _clear(found, open_ends, context), "fit": _fit(found, context.span_m),
        "upright": _upright(found, context), "reach": _reach(found, context)}  # fmt: skip
    return np.stack([columns[name].clip(0.0, 1.0) for name in TERMS], axis=1)


def score(terms: np.ndarray, weights: Mapping[str, float] = WEIGHTS) -> np.ndarray:
    """Compute the (n,) weighted geometric mean of terms (n, 8)."""
    w = np.array([weights[name] for name in TERMS])
    found: np.ndarray = np.prod(terms ** (w / w.sum()), axis=1)
    return found


def _positive(found: Sequence[GraspPose], context: ScoringContext) -> np.ndarray:
    """Share of the material between thumb and fingers that is positive."""
    points, share = context.cloud.points[context.body], context.region[context.body]
    tree = cKDTree(points)
    mirror = 1.0 if context.side == "right" else -1.0
    low, high = np.sort(mirror * np.array([TIP_X_M.min(), TIP_X_M.max()]))
    reach = float(max(abs(low), high)) + context.span_m
    near = tree.query_ball_point(np.array([pose.place for pose in found]), reach)
    out = np.zeros(len(found))
    for n, (pose, k) in enumerate(zip(found, near, strict=True)):
        local = (points[k] - pose.place) @ pose.R
        held = (local[:, 0] >= low) & (local[:, 0] <= high) & (np.abs(local[:, 2]) <= pose.width_m / 2 + ROOM_M / 2)
        out[n] = share[k][held].mean() if held.any() else 0.0
    return out


def _negative(ends: np.ndarray, open_ends: np.ndarray, context: ScoringContext) -> np.ndarray:
    """Term of negative points: 0 within SAFE_M of one, open or closed, 1 from FREE_M on."""
    if not len(context.negative):
        return np.ones(len(ends))
    tree = cKDTree(context.negative)
    least = np.minimum(tree.query(ends)[0].min(1), tree.query(open_ends)[0].min(1))
    found: np.ndarray = np.where(least > SAFE_M, 0.25 + 0.75 * (least - SAFE_M) / (FREE_M - SAFE_M), 0.0)
    return found


def _centred(found: Sequence[GraspPose], context: ScoringContext) -> np.ndarray:
    """Closeness of the visible object's middle to the approach axis: an object held there does not rotate."""
    middle = context.cloud.points[context.body].mean(0)
    aside = [middle - pose.place - pose.R[:, 1] * (pose.R[:, 1] @ (middle - pose.place)) for pose in found]
    far = np.linalg.norm(np.array(aside), axis=1)
    closeness: np.ndarray = 1.0 / (1.0 + (far / CENTRED_M) ** 2)
    return closeness


def _clear(found: Sequence[GraspPose], open_ends: np.ndarray, context: ScoringContext) -> np.ndarray:
    """Clearance of open fingers from other objects and from the support."""
    height = context.support.height(open_ends).min(1)
    above = ((height + SINK_M) / SINK_M).clip(0.0, 1.0)
    other = context.cloud.points[~context.body & (context.support.height(context.cloud.points) > LIFT_M)]
    if not len(other):
        return above
    back = np.array([pose.R[:, 1] for pose in found])[:, None]
    fingers = np.concatenate([open_ends, open_ends + 0.03 * back, open_ends + 0.06 * back], axis=1)
    near: np.ndarray = cKDTree(other).query(fingers)[0].min(1)
    return np.minimum(above, (near / CLEAR_M).clip(0.0, 1.0))


def _fit(found: Sequence[GraspPose], span_m: float) -> np.ndarray:
    """Width term: 1 for widths well within the span, 0 for widths beyond it."""
    width = np.array([pose.width_m for pose in found])
    return (span_m - width) / ((1 - EASY) * span_m)


def _upright(found: Sequence[GraspPose], context: ScoringContext) -> np.ndarray:
    """Alignment of the approach with the support normal; without a support, with the direction to the camera."""
    up = context.support.up if context.support.known else -context.cloud.points[context.body].mean(0)
    straight = np.array([pose.R[:, 1] @ up for pose in found]) / np.linalg.norm(up)
    return straight.clip(0.0, 1.0) ** 2


def _reach(found: Sequence[GraspPose], context: ScoringContext) -> np.ndarray:
    """Alignment of the fingers with the direction away from the shoulder, orthogonal to the approach."""
    out = np.zeros(len(found))
    for n, pose in enumerate(found):
        arm = pose.place - context.shoulder
        arm = arm - pose.R[:, 1] * (pose.R[:, 1] @ arm)
        out[n] = 0.5 + 0.5 * float(pose.R[:, 2] @ arm) / max(float(np.linalg.norm(arm)), 1e-9)
    return 0.05 + 0.95 * out


ALIKE_M, ALIKE_RAD = 0.015, np.radians(30)
"""non-maximum suppression: a pose nearer than both to a better one is dropped"""
APART_M = 0.09
"""two hands nearer than this would collide; from twice this distance on, the term is 1"""


@dataclass(frozen=True)
class SearchParams:
    """Parameters of the search, as in stages/grasping/grasp_candidates.py."""

    count: int = 10
    """grasps of each hand"""
    places: int = 64
    """places sampled in each region"""
    cell_m: float = 0.004
    """voxel size of the cloud"""
    around_m: float = 0.2
    """radius around the regions that the cloud covers"""
    span_m: float = 0.09
    """largest width that a hand spans"""
    lean_deg: float = 60.0
    """largest angle of the approach to the support normal"""
    shoulder_m: tuple[float, float, float] = field(default=(0.2, 0.25, 0.0))
    """origin of the right arm, camera frame; mirrored in x for the left arm"""


def find_candidates(scene: GraspScene, params: SearchParams) -> GraspCandidates:
    """Find the grasps of all hands in use; ValueError when a hand in use has no region with depth."""
    found = point_cloud(scene, params.cell_m, params.around_m)
    on = support_plane(found)
    hands = tuple(_hand(scene, found, on, side, n, params) if scene.hands[n] else _none(side) for n, side in enumerate(SIDES))
    pair, pair_score = pair_hands(hands[0], hands[1]) if scene.hands.all() else (np.zeros((0, 2), np.int32), np.zeros(0))
    return GraspCandidates(scene.name, hands, pair, pair_score, on.up)


def pair_hands(left: HandCandidates, right: HandCandidates) -> tuple[np.ndarray, np.ndarray]:
    """Pair grasps of both hands: (p, 2) int32 indices and (p,) scores, best first; both good and far enough apart."""
    far = np.linalg.norm(left.T_cam_grasp[:, None, :3, 3] - right.T_cam_grasp[None, :, :3, 3], axis=2)
    both = np.sqrt(left.score[:, None] * right.score[None]) * ((far - APART_M) / APART_M).clip(0.0, 1.0)
    order = np.argsort(-both, axis=None, kind="stable")[: max(both.shape, default=0)]
    rows = np.stack(np.unravel_index(order, both.shape), axis=1).astype(np.int32)
    good = both.reshape(-1)[order] > 0
    return rows[good], both.reshape(-1)[order][good]


def _hand(scene: GraspScene, found: PointCloud, on: SupportPlane, side: Hand, row: int, params: SearchParams) -> HandCandidates:
    share = found.region[row]
    if not (share >= 0.5).any():
        raise ValueError(f"{scene.name}: the region of the {side} hand has no depth; leave that hand out")
    body = object_points(found, share >= 0.5, on)
    spots = spread_places((share >= 0.5) & body, found, params.places)
    tried = [pose for pose in sample_poses(found, body, spots, on, params.lean_deg, params.cell_m) if pose.width_m <= params.span_m]
    if not tried:
        return _none(side)
    mirror = np.array([1.0 if side == "right" else -1.0, 1.0, 1.0])
    bad = np.concatenate([found.points[found.negative >= 0.5], scene.N_t])
    context = ScoringContext(found, share, body, on, bad, params.span_m, mirror * params.shoulder_m, side)
    terms = score_terms(tried, context)
    return _suppress(tried, terms, score(terms), side, params.count)


def _suppress(tried: Sequence[GraspPose], terms: np.ndarray, value: np.ndarray, side: Hand, count: int) -> HandCandidates:
    """Keep the best poses that differ from each other (non-maximum suppression), without scores of 0."""
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
