"""A made-up clip of a person who reaches for a handle, shapes the hand on the way, closes it and lifts.

Reach and lift are straight lines at minimum jerk, with the bell-shaped speed of people (Flash and Hogan 1985). The fingers open
to a peak at 60 to 70 % of the reach and then close (Jeannerod 1984); the peak grows by 0.82 of the object's size (Smeets and
Brenner 1999). Postures are synergies (skeleton.py). The clip is 21 keypoints, as if it had been tracked.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.ndimage import gaussian_filter1d
from scipy.spatial.transform import Rotation

from afford.grasping.motion.skeleton import aperture, closings, opposing, pose_hand
from schemas.hand import PHASES, GraspTarget, HandMotion


def minimum_jerk(share: np.ndarray) -> np.ndarray:
    """Share of the time 0..1 -> share of the way 0..1, at rest at both ends; cut outside. Its peak speed is 15/8 of the mean."""
    s = np.clip(share, 0.0, 1.0)
    found: np.ndarray = s**3 * (10 - 15 * s + 6 * s**2)
    return found


def minimum_jerk_through(times: np.ndarray, knots: np.ndarray, values: np.ndarray) -> np.ndarray:
    """At times (t,) the values (k,) of knots (k,) in rising order, from one to the next at minimum jerk, at rest at each."""
    part = np.clip(np.searchsorted(knots, times, side="right") - 1, 0, len(knots) - 2)
    share = minimum_jerk((times - knots[part]) / (knots[part + 1] - knots[part]))
    found: np.ndarray = values[part] + share * (values[part + 1] - values[part])
    return found


PEAK_SLOPE = 0.82
"""peak aperture over size of the object"""
TREMBLE_FRAMES = 3.0


@dataclass(frozen=True)
class ReachParameters:
    """What people do, from which each clip draws; pairs are the ends of a range."""

    rate_hz: float
    reach_s: tuple[float, float]
    close_s: tuple[float, float]
    hold_s: float
    lift_s: float
    lift_m: float
    distance_m: tuple[float, float]
    """from where the hand starts to where it grasps"""
    approach: tuple[float, float, float]
    """direction in which the hand comes to the handle, from which `spread_rad` turns it"""
    start: tuple[float, float, float]
    """where the hand starts is the way back from there, plus this, plus noise"""
    wander: float
    """standard deviation of that noise"""
    beyond_m: tuple[float, float, float]
    """how far the hand is beyond where thumb and fingertips would pinch the handle"""
    peak_share: tuple[float, float]
    """when the hand is open widest, as a share of the reach"""
    peak_m: float
    """aperture at the peak for an object of no size"""
    spread_rad: float
    """how far the approach turns about the handle, both ways"""
    turn_rad: float
    """how far the hand is turned when it starts"""
    hooking: tuple[float, float]
    """second synergy"""
    rest_closing: float
    """first synergy when the hand starts"""
    press: float
    """first synergy: what a hand that holds adds, were nothing in its way"""
    noise_m: float
    """tremble of every point"""


def synthesise(target: GraspTarget, habits: ReachParameters, seed: int, name: str) -> HandMotion:
    """One clip of a right hand; ValueError when the handle is thicker than the hand opens, or thinner than it closes."""
    rng = np.random.default_rng(seed)
    hooking = rng.uniform(*habits.hooking)
    grip = grasp_handle(target, hooking, rng.uniform(-habits.spread_rad, habits.spread_rad), np.array(habits.approach))
    times = _Times(habits, rng)
    local = pose_hand(_closing(grip, hooking, times, habits), np.full(len(times.at), hooking))
    palm = _palm(grip, times, habits, rng)
    points = np.einsum("tij,tkj->tki", palm[:, :3, :3], local) + palm[:, None, :3, 3]
    if habits.noise_m > 0:
        points = points + habits.noise_m * _tremble(points.shape, rng)
    rise = _rise(times, habits)
    pose = np.tile(target.object_pose, (len(times.at), 1))
    pose[:, 2] += rise
    return HandMotion(name, "synthetic", "right", habits.rate_hz, points, times.phases(), target.object_name, pose, palm)


class _Times:
    """When each phase ends, in seconds, and the times of the frames."""

    def __init__(self, habits: ReachParameters, rng: np.random.Generator) -> None:
        self.reach, close = rng.uniform(*habits.reach_s), rng.uniform(*habits.close_s)
        self.peak = self.reach * rng.uniform(*habits.peak_share)
        self.contact = self.reach + close
        self.lift = self.contact + habits.hold_s
        self.end = self.lift + habits.lift_s
        self.at = np.arange(int(self.end * habits.rate_hz) + 1) / habits.rate_hz

    def phases(self) -> np.ndarray:
        """(t,) index into PHASES."""
        ends = np.array([self.reach, self.contact, self.lift])
        names = np.array([PHASES.index(word) for word in ("reach", "close", "hold", "lift")], np.uint8)
        found: np.ndarray = names[np.searchsorted(ends, self.at, side="right")]
        return found


def _closing(grip: HandleGrasp, hooking: float, times: _Times, habits: ReachParameters) -> np.ndarray:
    """(t,) first synergy: the aperture goes from rest to its peak, from there to the contact, and stays."""
    wide, amount = closings(hooking)
    rest = float(aperture(pose_hand(np.array([habits.rest_closing]), np.array([hooking])))[0])
    peak = float(np.clip(habits.peak_m + PEAK_SLOPE * grip.size_m, grip.size_m, wide[-1]))
    apertures = np.array([rest, max(peak, rest), grip.size_m])
    opening = minimum_jerk_through(times.at, np.array([0.0, times.peak, times.contact]), apertures)
    pressed = habits.press * minimum_jerk((times.at - times.reach) / (times.lift - times.reach))
    found: np.ndarray = (np.interp(opening, wide, amount) + pressed).clip(max=1.0)
    return found


def _palm(grip: HandleGrasp, times: _Times, habits: ReachParameters, rng: np.random.Generator) -> np.ndarray:
    """(t, 4, 4) pose of the wrist in the world."""
    back = -grip.approach + habits.start + habits.wander * rng.normal(size=3)
    start = rng.uniform(*habits.distance_m) * back / np.linalg.norm(back)
    turn = Rotation.from_rotvec(_direction(rng) * rng.uniform(0, habits.turn_rad)).as_rotvec()
    left = 1 - minimum_jerk(times.at / times.reach)
    palm = np.tile(grip.T_world_wrist, (len(times.at), 1, 1))
    palm[:, :3, :3] = Rotation.from_rotvec(left[:, None] * turn).as_matrix() @ palm[:, :3, :3]
    palm[:, :3, 3] += left[:, None] * start + habits.beyond_m
    palm[:, 2, 3] += _rise(times, habits)
    return palm


def _rise(times: _Times, habits: ReachParameters) -> np.ndarray:
    found: np.ndarray = habits.lift_m * minimum_jerk((times.at - times.lift) / habits.lift_s)
    return found


def _direction(rng: np.random.Generator) -> np.ndarray:
    found = rng.normal(size=3)
    unit: np.ndarray = found / np.linalg.norm(found)
    return unit


def _tremble(shape: tuple[int, ...], rng: np.random.Generator) -> np.ndarray:
    """Smooth noise of standard deviation 1."""
    smooth: np.ndarray = gaussian_filter1d(rng.normal(size=shape), TREMBLE_FRAMES, axis=0, mode="reflect")
    return smooth * np.sqrt(2 * TREMBLE_FRAMES * np.sqrt(np.pi))


PAD_M = 0.006
"""from a tracked fingertip to the skin that touches"""
FROM_FRONT_AND_ABOVE = np.array([0.0, 1.0, -1.0]) / np.sqrt(2)
"""the person sits at -y"""


@dataclass(frozen=True, eq=False)
class HandleGrasp:
    """A grasp of a handle."""

    T_world_wrist: np.ndarray
    """(4, 4)"""
    approach: np.ndarray
    """(3,) unit direction in which the hand comes, across the handle"""
    size_m: float
    """aperture that touches both sides"""


def grasp_handle(target: GraspTarget, hooking: float, turn_rad: float, come: np.ndarray = FROM_FRONT_AND_ABOVE) -> HandleGrasp:
    """The grasp whose approach is turned about the handle by `turn_rad` from the direction `come` (3,), of which what lies along
    the handle is left out. Of the two grasps of that approach it is the one with the back of the hand up. ValueError when the
    hand does not fit.
    """
    size = target.diameter_m + 2 * PAD_M
    wide, amount = closings(hooking)
    if not wide[0] <= size <= wide[-1]:
        low, high = (1000 * (end - 2 * PAD_M) for end in (wide[0], wide[-1]))
        raise ValueError(f"{target.name}, diameter_m: expected {max(low, 0):.0f} to {high:.0f} mm, which a hand can span, got "
                         f"{1000 * target.diameter_m:.0f} mm")
    points = pose_hand(np.array([np.interp(size, wide, amount)]), np.array([hooking]))
    thumb, fingers = points[0, 4], opposing(points)[0]
    centre = (thumb + fingers) / 2
    handle = _world(target)
    axis, approach = handle[:3, 2], _approach(handle[:3, 2], turn_rad, come)
    across = _off(np.array([1.0, 0.0, 0.0]), _unit(fingers - thumb))
    local = np.stack([across, forward := _off(centre, across), np.cross(across, forward)], axis=1)
    turns = [np.stack([sign * axis, approach, np.cross(sign * axis, approach)], axis=1) @ local.T for sign in (1.0, -1.0)]
    T = np.eye(4)
    T[:3, :3] = max(turns, key=lambda R: float(R[2, 1]))
    T[:3, 3] = handle[:3, 3] - T[:3, :3] @ centre
    return HandleGrasp(T, approach, size)


def _world(target: GraspTarget) -> np.ndarray:
    """(4, 4) pose of the handle in the world."""
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
    """The unit part of a vector that is square to a unit axis."""
    return _unit(vector - (vector @ axis) * axis)


def _unit(vector: np.ndarray) -> np.ndarray:
    unit: np.ndarray = vector / np.linalg.norm(vector)
    return unit
