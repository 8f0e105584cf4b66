"""Synthesize clips of a person who reaches for a handle, shapes the hand on the way, closes it and lifts.

Reach and lift are straight minimum-jerk paths, with the bell-shaped speed of people (Flash and Hogan 1985). The fingers open to a
peak at 60 to 70 % of the reach and then close (Jeannerod 1984); the peak grows by 0.82 of the object's size (Smeets and Brenner
1999). Postures are synergies (skeleton.py). The clip has 21 keypoints, as if it had been tracked.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.ndimage import gaussian_filter1d
from scipy.spatial.transform import Rotation

from afford.grasping.motion.skeleton import aperture, closings, opposing, pose_hand
from schemas.hand import PHASES, GraspTarget, HandMotion


def minimum_jerk(share: np.ndarray) -> np.ndarray:
    """Map a share of the time, 0..1, to a share of the way: the minimum-jerk profile, at rest at both ends, clipped outside.

    Its peak speed is 15/8 of the mean (Flash and Hogan 1985).
    """
    s = np.clip(share, 0.0, 1.0)
    found: np.ndarray = s**3 * (10 - 15 * s + 6 * s**2)
    return found


def minimum_jerk_through(times: np.ndarray, knots: np.ndarray, values: np.ndarray) -> np.ndarray:
    """Interpolate values (k,) at rising knots (k,) with minimum-jerk segments, at rest at each knot, at times (t,)."""
    part = np.clip(np.searchsorted(knots, times, side="right") - 1, 0, len(knots) - 2)
    share = minimum_jerk((times - knots[part]) / (knots[part + 1] - knots[part]))
    found: np.ndarray = values[part] + share * (values[part + 1] - values[part])
    return found


PEAK_SLOPE = 0.82
"""slope of the peak aperture over the object's size"""
TREMBLE_FRAMES = 3.0


@dataclass(frozen=True)
class ReachParameters:
    """Parameters from which each clip is drawn; pairs are the ends of a uniform range."""

    rate_hz: float
    reach_s: tuple[float, float]
    close_s: tuple[float, float]
    hold_s: float
    lift_s: float
    lift_m: float
    distance_m: tuple[float, float]
    """distance from the start of the hand to the grasp"""
    approach: tuple[float, float, float]
    """mean direction from which the hand approaches the handle"""
    start: tuple[float, float, float]
    """added, with noise, to the direction back along the approach, in which the hand starts"""
    wander: float
    """standard deviation of that noise"""
    beyond_m: tuple[float, float, float]
    """offset of the hand from the position at which thumb and fingertips would pinch the handle"""
    peak_share: tuple[float, float]
    """time of the peak aperture, as a share of the reach"""
    peak_m: float
    """peak aperture for an object of size 0"""
    spread_rad: float
    """range of rotation of the approach about the handle, both ways"""
    turn_rad: float
    """largest rotation of the hand at the start"""
    hooking: tuple[float, float]
    """second synergy"""
    rest_closing: float
    """first synergy at the start"""
    press: float
    """first synergy that a holding hand adds beyond contact"""
    noise_m: float
    """standard deviation of the tremor of every point"""


def synthesise(target: GraspTarget, params: ReachParameters, seed: int, name: str) -> HandMotion:
    """Synthesize one clip of a right hand; ValueError when the hand cannot span the handle."""
    rng = np.random.default_rng(seed)
    hooking = rng.uniform(*params.hooking)
    grip = grasp_handle(target, hooking, rng.uniform(-params.spread_rad, params.spread_rad), np.array(params.approach))
    times = _Times(params, rng)
    local = pose_hand(_closing(grip, hooking, times, params), np.full(len(times.at), hooking))
    palm = _palm(grip, times, params, rng)
    points = np.einsum("tij,tkj->tki", palm[:, :3, :3], local) + palm[:, None, :3, 3]
    if params.noise_m > 0:
        points = points + params.noise_m * _tremble(points.shape, rng)
    rise = _rise(times, params)
    pose = np.tile(target.object_pose, (len(times.at), 1))
    pose[:, 2] += rise
    return HandMotion(name, "synthetic", "right", params.rate_hz, points, times.phases(), target.object_name, pose, palm)


class _Times:
    """End of each phase in seconds, and the times of the frames."""

    def __init__(self, params: ReachParameters, rng: np.random.Generator) -> None:
        self.reach, close = rng.uniform(*params.reach_s), rng.uniform(*params.close_s)
        self.peak = self.reach * rng.uniform(*params.peak_share)
        self.contact = self.reach + close
        self.lift = self.contact + params.hold_s
        self.end = self.lift + params.lift_s
        self.at = np.arange(int(self.end * params.rate_hz) + 1) / params.rate_hz

    def phases(self) -> np.ndarray:
        """(t,) index into PHASES."""
        ends = np.array([self.reach, self.contact, self.lift])
        names = np.array([PHASES.index(word) for word in ("reach", "close", "hold", "lift")], np.uint8)
        found: np.ndarray = names[np.searchsorted(ends, self.at, side="right")]
        return found


def _closing(grip: HandleGrasp, hooking: float, times: _Times, params: ReachParameters) -> np.ndarray:
    """Return the (t,) first synergy: the aperture goes from rest to its peak, from there to contact, and stays."""
    wide, amount = closings(hooking)
    rest = float(aperture(pose_hand(np.array([params.rest_closing]), np.array([hooking])))[0])
    peak = float(np.clip(params.peak_m + PEAK_SLOPE * grip.size_m, grip.size_m, wide[-1]))
    apertures = np.array([rest, max(peak, rest), grip.size_m])
    opening = minimum_jerk_through(times.at, np.array([0.0, times.peak, times.contact]), apertures)
    pressed = params.press * minimum_jerk((times.at - times.reach) / (times.lift - times.reach))
    found: np.ndarray = (np.interp(opening, wide, amount) + pressed).clip(max=1.0)
    return found


def _palm(grip: HandleGrasp, times: _Times, params: ReachParameters, rng: np.random.Generator) -> np.ndarray:
    """Return the (t, 4, 4) pose of the wrist in the world."""
    back = -grip.approach + params.start + params.wander * rng.normal(size=3)
    start = rng.uniform(*params.distance_m) * back / np.linalg.norm(back)
    turn = Rotation.from_rotvec(_direction(rng) * rng.uniform(0, params.turn_rad)).as_rotvec()
    left = 1 - minimum_jerk(times.at / times.reach)
    palm = np.tile(grip.T_world_wrist, (len(times.at), 1, 1))
    palm[:, :3, :3] = Rotation.from_rotvec(left[:, None] * turn).as_matrix() @ palm[:, :3, :3]
    palm[:, :3, 3] += left[:, None] * start + params.beyond_m
    palm[:, 2, 3] += _rise(times, params)
    return palm


def _rise(times: _Times, params: ReachParameters) -> np.ndarray:
    found: np.ndarray = params.lift_m * minimum_jerk((times.at - times.lift) / params.lift_s)
    return found


def _direction(rng: np.random.Generator) -> np.ndarray:
    found = rng.normal(size=3)
    unit: np.ndarray = found / np.linalg.norm(found)
    return unit


def _tremble(shape: tuple[int, ...], rng: np.random.Generator) -> np.ndarray:
    """Draw smooth noise of standard deviation 1."""
    smooth: np.ndarray = gaussian_filter1d(rng.normal(size=shape), TREMBLE_FRAMES, axis=0, mode="reflect")
    return smooth * np.sqrt(2 * TREMBLE_FRAMES * np.sqrt(np.pi))


PAD_M = 0.006
"""distance from a tracked fingertip to the skin in contact"""
FROM_FRONT_AND_ABOVE = np.array([0.0, 1.0, -1.0]) / np.sqrt(2)
"""the person sits at -y"""


@dataclass(frozen=True, eq=False)
class HandleGrasp:
    """Grasp of a handle: across it, the thumb opposite to the fingers."""

    T_world_wrist: np.ndarray
    """(4, 4)"""
    approach: np.ndarray
    """(3,) unit direction in which the hand moves, across the handle"""
    size_m: float
    """aperture at which thumb and fingers touch both sides"""


def grasp_handle(target: GraspTarget, hooking: float, turn_rad: float, come: np.ndarray = FROM_FRONT_AND_ABOVE) -> HandleGrasp:
    """Compute the grasp of a handle.

    The approach is the component of `come` (3,) across the handle, rotated about the handle by `turn_rad`. Of the two grasps of
    that approach, the one with the back of the hand up is returned. ValueError when the hand cannot span the handle.
    """
    size = target.diameter_m + 2 * PAD_M
    wide, amount = closings(hooking)
    if not wide[0] <= size <= wide[-1]:
        low, high = (1000 * (end - 2 * PAD_M) for end in (wide[0], wide[-1]))
        raise ValueError(f"{target.name}, diameter_m: expected {max(low, 0):.0f} to {high:.0f} mm, which a hand can span, got "
                         f"{1000 * target.diameter_m:.0f} mm")
    points = pose_hand(np.array([np.interp(size, wide, amount)]), np.array([hooking]))
    return place_grasp(target, points[0], size, turn_rad, come)


def place_grasp(target: GraspTarget, points: np.ndarray, size_m: float, turn_rad: float = 0.0,
                come: np.ndarray = FROM_FRONT_AND_ABOVE) -> HandleGrasp:  # fmt: skip
    """Place a grasping right hand, points (21, 3) in the frame of its wrist (skeleton.py), on a handle, as `grasp_handle` does."""
    thumb, fingers = points[4], opposing(points[None])[0]
    centre = (thumb + fingers) / 2
    handle = _world(target)
    axis, approach = handle[:3, 2], _approach(handle[:3, 2], turn_rad, come)
    across = _off(np.array([1.0, 0.0, 0.0]), _unit(fingers - thumb))
    local = np.stack([across, forward := _off(centre, across), np.cross(across, forward)], axis=1)
    turns = [np.stack([sign * axis, approach, np.cross(sign * axis, approach)], axis=1) @ local.T for sign in (1.0, -1.0)]
    T = np.eye(4)
    T[:3, :3] = max(turns, key=lambda R: float(R[2, 1]))
    T[:3, 3] = handle[:3, 3] - T[:3, :3] @ centre
    return HandleGrasp(T, approach, size_m)


def _world(target: GraspTarget) -> np.ndarray:
    """Return the (4, 4) pose of the handle in the world."""
    T = np.eye(4)
    T[:3, :3] = Rotation.from_quat(target.object_pose[3:]).as_matrix()
    T[:3, 3] = target.object_pose[:3]
    found: np.ndarray = T @ target.T_object_handle
    return found


def _approach(axis: np.ndarray, turn_rad: float, come: np.ndarray) -> np.ndarray:
    come = _unit(come)
    across = come - (come @ axis) * axis
    if np.linalg.norm(across) < 0.1:
        across = np.array([1.0, 0.0, 0.0])
    found: np.ndarray = Rotation.from_rotvec(axis * turn_rad).apply(_unit(across))
    return found


def _off(vector: np.ndarray, axis: np.ndarray) -> np.ndarray:
    """Return the unit component of a vector orthogonal to a unit axis."""
    return _unit(vector - (vector @ axis) * axis)


def _unit(vector: np.ndarray) -> np.ndarray:
    unit: np.ndarray = vector / np.linalg.norm(vector)
    return unit
