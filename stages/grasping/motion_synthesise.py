"""an object with a handle -> synthetic clips of a person who reaches for it, grasps it and lifts it.

Reads   GraspTarget: pose of the object, its handle, thickness of the handle
Writes  HandMotion of each clip: 21 keypoints, phases, the track of the object
Method  minimum-jerk reach and lift, aperture that peaks at 60 to 70 % of the reach and grows with the object, two posture
        synergies; approach, durations, start and tremor are drawn from the seed
Fails   ValueError: a handle that no hand spans, a parameter out of range
Paper   AffordDex, HTI, takes clips of OakInk2; these replace them where they are not available
"""

from __future__ import annotations

from dataclasses import dataclass

from schemas.hand import GraspTarget, HandMotion

LIBRARIES = ("numpy", "scipy")
THREADS = 1
MEMORY_GIB = 0.2


@dataclass(frozen=True)
class Params:
    """Parameters of motion_synthesise."""

    clips: int = 8
    """number of clips"""
    seed: int = 20266
    """seed of all clips; each draws its own from it"""
    rate_hz: float = 60.0
    """frames a second"""
    reach_s: tuple[float, float] = (0.8, 1.2)
    """duration of the reach"""
    close_s: tuple[float, float] = (0.15, 0.3)
    """duration of closing after the reach"""
    hold_s: float = 0.15
    """pause before the lift"""
    lift_s: float = 0.8
    """duration of the lift"""
    lift_m: float = 0.2
    """height of the lift"""
    distance_m: tuple[float, float] = (0.25, 0.45)
    """distance of the start from the grasp"""
    approach: tuple[float, float, float] = (0.0, 1.0, -1.0)
    """direction of the approach across the handle; by default half from the front, where the person sits, and half from above"""
    start: tuple[float, float, float] = (0.0, -1.0, 0.0)
    """direction to the start, added to the reversed approach, both of length 1, and to `wander`"""
    wander: float = 0.5
    """standard deviation of the direction to the start"""
    beyond_m: tuple[float, float, float] = (0.0, 0.0, 0.0)
    """offset of the hand from a pinch by thumb and fingertips: 0 pinches, 3 cm down holds the handle in the fingers"""
    peak_share: tuple[float, float] = (0.6, 0.7)
    """time of the widest opening, as a share of the reach"""
    peak_m: float = 0.05
    """widest opening for an object of size 0; 0.82 of the size is added"""
    spread_deg: float = 35.0
    """largest rotation of the approach about the handle, both ways"""
    turn_deg: float = 35.0
    """largest rotation of the hand at the start"""
    hooking: tuple[float, float] = (-0.5, 0.5)
    """second synergy, -1 to 1: from straight knuckles with bent middle joints to the reverse"""
    rest_closing: float = 0.3
    """first synergy at the start, 0 open, 1 closed"""
    press: float = 0.0
    """first synergy: additional closing of a hand that holds, as if nothing were in its way; 0 for a hand that only touches"""
    noise_m: float = 0.0003
    """tremor of every point"""


def run(target: GraspTarget, params: Params) -> tuple[HandMotion, ...]:
    """Synthesise all clips for one target."""
    import numpy as np

    from afford.grasping.motion.synthetic import ReachParameters, synthesise

    _check(params)
    reach = ReachParameters(
        params.rate_hz, params.reach_s, params.close_s, params.hold_s, params.lift_s, params.lift_m, params.distance_m,
        params.approach, params.start, params.wander, params.beyond_m, params.peak_share, params.peak_m,
        float(np.deg2rad(params.spread_deg)), float(np.deg2rad(params.turn_deg)), params.hooking, params.rest_closing,
        params.press, params.noise_m)  # fmt: skip
    seeds = np.random.SeedSequence(params.seed).generate_state(params.clips, np.uint64)
    return tuple(synthesise(target, reach, int(seed), f"{target.name}_{k:03d}") for k, seed in enumerate(seeds))


def _check(params: Params) -> None:
    for name in ("clips", "rate_hz", "lift_s"):
        if getattr(params, name) <= 0:
            raise ValueError(f"motion_synthesise, {name}: expected a number above zero, got {getattr(params, name)}")
    if not any(params.approach):
        raise ValueError(f"motion_synthesise, approach: expected a direction, got {params.approach}")
    if params.wander < 0:
        raise ValueError(f"motion_synthesise, wander: expected 0 or more, got {params.wander}")
    for name, low, high in (("reach_s", 0.05, 60.0), ("close_s", 0.01, 60.0), ("distance_m", 0.0, 2.0), ("peak_share", 0.05, 0.95),
                            ("hooking", -1.0, 1.0)):  # fmt: skip
        a, b = getattr(params, name)
        if not low <= a <= b <= high:
            raise ValueError(f"motion_synthesise, {name}: expected two rising numbers of {low:g} to {high:g}, got {a} and {b}")
