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

from afford.grasping.motion.grip import Grip, grip_at
from afford.grasping.motion.minimum_jerk import minimum_jerk, through
from afford.grasping.motion.skeleton import aperture, closings, posed
from schemas.hand import PHASES, GraspTarget, HandMotion

PEAK_SLOPE = 0.82
"""peak aperture over size of the object"""
TREMBLE_FRAMES = 3.0


@dataclass(frozen=True)
class Habits:
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


def synthesise(target: GraspTarget, habits: Habits, seed: int, name: str) -> HandMotion:
    """One clip of a right hand; ValueError when the handle is thicker than the hand opens, or thinner than it closes."""
    rng = np.random.default_rng(seed)
    hooking = rng.uniform(*habits.hooking)
    grip = grip_at(target, hooking, rng.uniform(-habits.spread_rad, habits.spread_rad), np.array(habits.approach))
    times = _Times(habits, rng)
    local = posed(_closing(grip, hooking, times, habits), np.full(len(times.at), hooking))
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

    def __init__(self, habits: Habits, rng: np.random.Generator) -> None:
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


def _closing(grip: Grip, hooking: float, times: _Times, habits: Habits) -> np.ndarray:
    """(t,) first synergy: the aperture goes from rest to its peak, from there to the contact, and stays."""
    wide, amount = closings(hooking)
    rest = float(aperture(posed(np.array([habits.rest_closing]), np.array([hooking])))[0])
    peak = float(np.clip(habits.peak_m + PEAK_SLOPE * grip.size_m, grip.size_m, wide[-1]))
    opening = through(times.at, np.array([0.0, times.peak, times.contact]), np.array([rest, max(peak, rest), grip.size_m]))
    pressed = habits.press * minimum_jerk((times.at - times.reach) / (times.lift - times.reach))
    found: np.ndarray = (np.interp(opening, wide, amount) + pressed).clip(max=1.0)
    return found


def _palm(grip: Grip, times: _Times, habits: Habits, rng: np.random.Generator) -> np.ndarray:
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


def _rise(times: _Times, habits: Habits) -> np.ndarray:
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
