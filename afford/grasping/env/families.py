"""Grasp families: where and from where a hand grasps a part, from the geometry of a body at rest and its task.

    handle   power grasp of a bar: of a lying one from above, of an upright one beside the body from outside
    body     power grasp around an upright body, from the side
    pinch    small or flat part between thumb and fingers, from above
    rim      wall of an open vessel, from above, one side in and one outside
    hook     fingers through a loop

A place has a fit of 0..1: the factor of its family, times how well the hand spans the part there, times how near the place is to
the centre of mass; less for a bar with the rest of the body close under it. Points within 2 cm of N_t are no places. The body lies
or stands on z = 0, z up.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from afford.grasping.env.measures import SAFE_M, nearest
from afford.surface.describe.lexicon import parse_task

FAMILIES = {"handle": 1.0, "body": 0.8, "pinch": 0.7, "rim": 0.5, "hook": 0.4}
"""family -> factor of its fit: how sure the hand holds on in that way"""
WANTED = {"pour": ("handle", "hook", "body"), "drink": ("handle", "hook", "body"), "hand over": ("pinch", "rim", "handle", "body")}
"""verb of a task -> families that serve it; others keep OTHERWISE of their fit"""
OTHERWISE = 0.7
THIN_M, WIDE_M = 0.006, 0.09
"""least and largest width that thumb and fingers hold"""
EASY_M = (0.015, 0.055)
"""widths that are held best"""
LEVER_M = 0.12
"""distance of a place from the centre of mass, along the table, at which the fit falls to 1 / e"""
SLICE_M, END_M = 0.025, 0.03
"""points within SLICE_M along a part are grasped together; places keep END_M from its ends"""
LONG = 1.6
"""a bar is longer than this many of its widths"""
TALL_M, SHORT_M = 0.06, 0.035
"""least height of an upright body, and of an upright bar beside it"""
FINGER_M, CLEAR_M = 0.010, 0.020
"""thickness of a finger; room that fingers need beside what they grasp, free of anything above"""
UNDER_M, OVER_BODY = 0.06, 0.3
"""a bar with the rest of the body within UNDER_M under it, as the handle of a mug on its side, keeps OVER_BODY of its fit"""
HOLE_M = 0.008
"""radius of the least hole for a finger"""
FLAT = 0.4
"""a loop is flatter than this share of its height"""
WALL_M = 0.02
"""thickest wall of a vessel"""
UP = np.array([0.0, 0.0, 1.0])
AROUND = 6
"""eighths of a circle in which an open vessel has a wall; twelfths in which a loop has one"""
LEAST = 8
"""fewest safe points of a part"""


@dataclass(frozen=True, eq=False)
class GraspPlace:
    """Place of a grasp on a body at rest, in the frame of the body."""

    family: str
    at_m: np.ndarray
    """(3,) middle of the gripped part"""
    along: np.ndarray
    """(3,) unit axis across which the fingers close"""
    approach: np.ndarray
    """(3,) unit direction in which the hand comes"""
    width_m: float
    """between thumb and fingers"""
    fit: float
    """0..1; within a rule, the share that it keeps"""


@dataclass(frozen=True, eq=False)
class PartShape:
    """Safe points of a part of a body, with their principal axes."""

    spots: np.ndarray
    """(n, 3)"""
    normals: np.ndarray
    """(n, 3) outwards"""
    whole: np.ndarray
    """(m, 3) all points of the body"""
    outwards: np.ndarray
    """(m, 3) their normals"""
    com: np.ndarray
    middle: np.ndarray
    axes: np.ndarray
    """(3, 3) rows, longest first"""
    size: np.ndarray
    """(3,) m, extents along the axes"""


def grasp_places(points: np.ndarray, normals: np.ndarray, on_part: np.ndarray, N_t: np.ndarray, com: np.ndarray,
                 task: str = "") -> list[GraspPlace]:  # fmt: skip
    """Find the places of all families, best first; empty where no family fits.

    `points` (m, 3) and `normals` (m, 3) of the body at rest, `on_part` (m,) bool, `N_t` (k, 3), `com` (3,), `task` in words.
    """
    part = _shape(points, normals, on_part, N_t, com)
    if part is None:
        return []
    wanted = WANTED.get(parse_task(task).verb, tuple(FAMILIES))
    found = [place for rule in RULES if (place := rule(part)) is not None]
    scored = [_scored(place, part, 1.0 if place.family in wanted else OTHERWISE) for place in found]
    return sorted((one for one in scored if one.fit > 0), key=lambda one: -one.fit)


def _shape(points: np.ndarray, normals: np.ndarray, on_part: np.ndarray, N_t: np.ndarray, com: np.ndarray) -> PartShape | None:
    spots, outwards = points[on_part].astype(np.float64), normals[on_part].astype(np.float64)
    if len(N_t):
        safe = nearest(spots[None], N_t[None])[0][0] > SAFE_M
        spots, outwards = spots[safe], outwards[safe]
    if len(spots) < LEAST:
        return None
    middle = spots.mean(0)
    axes = np.linalg.svd(spots - middle, full_matrices=False)[2]
    size = np.ptp(np.percentile((spots - middle) @ axes.T, [2, 98], axis=0), axis=0)
    return PartShape(spots, outwards, points.astype(np.float64), normals.astype(np.float64), np.asarray(com), middle, axes, size)


def _scored(place: GraspPlace, part: PartShape, served: float) -> GraspPlace:
    lever = float(np.linalg.norm((place.at_m - part.com)[:2]))
    fit = place.fit * FAMILIES[place.family] * served * _spanned(place.width_m) * np.exp(-lever / LEVER_M)
    return GraspPlace(place.family, place.at_m, place.along, place.approach, place.width_m, float(fit))


def _spanned(width_m: float) -> float:
    """Rate the span of a width by a hand: 1 for EASY_M, falling to 0 at THIN_M and WIDE_M."""
    return float(np.interp(width_m, [THIN_M, *EASY_M, WIDE_M], [0.0, 1.0, 1.0, 0.0]))


def _handle(part: PartShape) -> GraspPlace | None:
    """Lying bar: at the place nearest to the centre of mass."""
    axis = _flat(part.axes[0])
    if abs(part.axes[0][2]) > 0.5 or part.size[0] < LONG * part.size[1]:
        return None
    return _across("handle", part, axis, *_range(part, axis))


def _pinch(part: PartShape) -> GraspPlace | None:
    """Part that is short or flat: across its narrower side on the table."""
    if _hole(part) or (part.size[0] >= LONG * part.size[1] and part.size[0] > TALL_M):
        return None
    return _across("pinch", part, _narrowest(part.spots), 0.0, 0.0)


def _body(part: PartShape) -> GraspPlace | None:
    """Upright body: around it, at the height of the centre of mass, across the wider side; an upright bar beside it is a handle."""
    low, high = np.percentile(part.spots[:, 2], [2, 98])
    slab = part.spots[np.abs(part.spots[:, 2] - np.clip(part.com[2], low, high)) <= SLICE_M]
    lies = abs(part.axes[0][2]) < 0.5 and part.size[0] >= LONG * part.size[1]
    if high - low < SHORT_M or len(slab) < LEAST or lies or _hole(part):
        return None
    long, at = _narrowest(slab), slab.mean(0)
    across = np.cross(UP, long)
    width = float(np.ptp(slab @ across))
    if high - low < 0.9 * width or not _room(part, at, long, across, width, 2 * FINGER_M):
        return None
    towards = _flat(part.com - at)
    beside = float(np.linalg.norm((part.com - at)[:2])) > width and high - low > LONG * width
    if not beside and high - low < TALL_M:
        return None
    return GraspPlace("handle" if beside else "body", at, UP, towards if beside else -across, width, 1.0)


def _rim(part: PartShape) -> GraspPlace | None:
    """Open vessel: the top of its wall, at the safe spot near to the centre of mass and off what is above."""
    whole, top = part.whole, part.spots[:, 2].max()
    from_axis = (whole - part.com)[:, :2]
    inwards = (from_axis * part.outwards[:, :2]).sum(1) < -0.3 * np.linalg.norm(from_axis, axis=1)
    inner = whole[inwards & (np.abs(whole[:, 2] - top + 0.015) < 0.015)]
    edge = part.spots[part.spots[:, 2] > top - 0.015]
    above = whole[whole[:, 2] > top + FINGER_M]
    if len(inner) < LEAST or not _surrounds(inner, part.com):
        return None
    room = np.linalg.norm(edge[:, None, :2] - above[None, :, :2], axis=2).min(1) if len(above) else np.full(len(edge), np.inf)
    edge, room = edge[room > CLEAR_M], room[room > CLEAR_M].clip(max=WIDE_M)
    if not len(edge):
        return None
    at = edge[(np.linalg.norm((edge - part.com)[:, :2], axis=1) - room).argmin()]
    out = _flat(at - part.com)
    tangent = np.cross([0.0, 0.0, 1.0], out)
    offset = whole[np.abs(whole[:, 2] - top) < 0.015] - at
    wall = float(np.ptp(offset[(np.abs(offset @ tangent) < 0.01) & (np.abs(offset @ out) < WIDE_M / 2)] @ out))
    if wall > WALL_M:
        return None
    return GraspPlace("rim", at, tangent, np.array([0.0, 0.0, -1.0]), max(wall, 2 * THIN_M), 1.0)


def _surrounds(spots: np.ndarray, com: np.ndarray) -> bool:
    """Test whether points (n, 3) are on nearly all sides of the centre of mass."""
    side = np.arctan2(*(spots - com)[:, 1::-1].T)
    return len(np.unique(np.floor(side / (np.pi / 4)))) >= AROUND


def _hook(part: PartShape) -> GraspPlace | None:
    """Loop: fingers through its hole, against the outer bar. The opening of a vessel, in front of the centre of mass, is none."""
    if not _hole(part) or _opening(part):
        return None
    away = np.asarray(part.middle - part.whole.mean(0))
    outer = part.spots[(part.spots - part.middle) @ away > 0]
    width = float(np.ptp(np.percentile((outer - outer.mean(0)) @ part.axes[2], [2, 98]))) if len(outer) else 0.0
    return GraspPlace("hook", outer.mean(0), part.axes[0], part.axes[2], width, 1.0) if len(outer) else None


RULES: tuple[Callable[[PartShape], GraspPlace | None], ...] = (_handle, _pinch, _body, _rim, _hook)


def _hole(part: PartShape) -> bool:
    """Test whether the middle of a flat part is in a hole: in most directions, the nearest surface is off it and faces it."""
    toward = part.middle - part.spots
    x, y = part.axes[:2] @ -toward.T
    far, side = np.hypot(x, y), np.floor(np.arctan2(y, x) / (np.pi / 6))
    near = np.array([np.flatnonzero(side == one)[far[side == one].argmin()] for one in np.unique(side)])
    facing = (toward[near] * part.normals[near]).sum(1) > 0.3 * np.linalg.norm(toward[near], axis=1)
    return bool(far.min() > HOLE_M and part.size[2] < FLAT * part.size[1] and facing.sum() >= AROUND)


def _opening(part: PartShape) -> bool:
    """Test whether the axis of a hole passes the centre of mass within the hole."""
    offset = part.com - part.middle
    beside = float(np.linalg.norm(offset - (offset @ part.axes[2]) * part.axes[2]))
    return beside < float(np.linalg.norm(part.spots - part.middle, axis=1).min())


def _range(part: PartShape, axis: np.ndarray) -> tuple[float, float]:
    """Range along an axis, from the middle of the part, in which a hand is not too near to its ends."""
    reach = (part.spots - part.middle) @ axis
    return min(0.0, float(reach.min()) + END_M), max(0.0, float(reach.max()) - END_M)


def _across(family: str, part: PartShape, axis: np.ndarray, low: float, high: float) -> GraspPlace | None:
    """Grasp from above across a lying axis, between `low` and `high` from the middle."""
    chosen = float(np.clip((part.com - part.middle) @ axis, low, high))
    slab = part.spots[np.abs((part.spots - part.middle) @ axis - chosen) <= SLICE_M]
    if not len(slab):
        return None
    at = slab.mean(0)
    at = at + (chosen - (at - part.middle) @ axis) * axis
    across = np.cross(UP, axis)
    width = float(np.ptp(np.percentile(slab @ across, [2, 98])))
    if not _room(part, at, axis, across, width, np.inf):
        return None
    return GraspPlace(family, at, axis, -UP, width, OVER_BODY if _over_body(part, slab, at, axis, across, width) else 1.0)


def _over_body(part: PartShape, slab: np.ndarray, at: np.ndarray, axis: np.ndarray, across: np.ndarray, width_m: float) -> bool:
    """Test whether the rest of the body is under a bar, where fingers that close around the bar push it.

    The ends of a loop, which go down to the body and make it higher than wide, are not of the bar.
    """
    offset, here = part.whole - at, np.abs((slab - at) @ axis) < FINGER_M
    loop = float(np.ptp(slab[:, 2])) > LONG * width_m and here.any()
    bottom = float(slab[here if loop else slice(None), 2].min())
    under = (part.whole[:, 2] < bottom - THIN_M) & (part.whole[:, 2] > bottom - UNDER_M)
    return bool((under & (np.abs(offset @ axis) < FINGER_M) & (np.abs(offset @ across) < width_m / 2 + FINGER_M)).any())


def _room(part: PartShape, at: np.ndarray, axis: np.ndarray, across: np.ndarray, width_m: float, above_m: float) -> bool:
    """Test whether fingers have room on both sides of a place, at its height and up to `above_m` above it."""
    offset = part.whole - at
    beside = np.abs(offset @ across) - width_m / 2
    level = (np.abs(offset @ axis) <= FINGER_M) & (offset[:, 2] > -FINGER_M) & (offset[:, 2] < above_m)
    return not (level & (beside > THIN_M) & (beside < CLEAR_M)).any()


def _narrowest(spots: np.ndarray) -> np.ndarray:
    """Horizontal unit axis (3,) across which points (n, 3) are narrowest."""
    turn = np.arange(24) * np.pi / 24
    axes = np.stack([np.cos(turn), np.sin(turn), 0 * turn], axis=1)
    wide = np.ptp(np.percentile(spots @ np.cross(UP, axes).T, [2, 98], axis=0), axis=0)
    found: np.ndarray = axes[wide.argmin()]
    return found


def _flat(axis: np.ndarray) -> np.ndarray:
    """Unit vector along the table of an axis (3,)."""
    lying = axis * (1, 1, 0)
    found: np.ndarray = lying / max(float(np.linalg.norm(lying)), 1e-9)
    return found
