"""What an environment of grasping can be told."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

from afford.grasping.env import wrench
from afford.grasping.env.base import BASES
from afford.grasping.sim.engine import CONTROL_S
from afford.grasping.sim.scene import Physics


@dataclass(frozen=True)
class Config:
    """Keywords of the environments. ValueError for what they cannot mean."""

    engine: str = "mujoco"
    """mujoco, bullet, or warp (afford/grasping/sim/warp_worlds.py; the extra gpu)"""
    physics: Physics = field(default_factory=Physics)
    """how carefully worlds are computed"""
    action_mode: str = "rate"
    """rate: act.py, 20 a second; paper: wrench.py, 60 a second, base=none; give it steps=200, as the paper does"""
    base: str = "none"
    """what actions are added to: none, script, or prior (base.py)"""
    posture: tuple[float, ...] = ()
    """joints of the motors at the beginning, those of the wrist from the aim: as a prior's facts have it. None: as the script"""
    layout: str = "small"
    """small, paper or points (observe.py)"""
    role: str = "teacher"
    """who sees: prior, teacher or student (observe.py)"""
    reward: str = "afforddex"
    """set of rewards (reward.py)"""
    weights: Mapping[str, float] = field(default_factory=dict)
    """other weights for some of its terms"""
    steps: int = 40
    """control steps of an episode; the script takes 38 to lift by 20 cm, 34 by 15 cm"""
    lift_m: float = 0.20
    """how far above its place at rest the object is to be brought"""
    wait: int = 0
    """control steps for which the script stays above before it goes down"""
    poses: str = "flat"
    """flat: as it was built; dropped: as it falls. Both anywhere within xy_m, at any yaw"""
    xy_m: float = 0.05
    """how far from the origin, along x and y"""
    start: str = "part"
    """where the hand begins, and its base grasps: part, over the part to hold; anywhere, blind to parts"""
    start_m: float = 0.06
    """anywhere: how far from the centre of mass that place is at most, along the object"""
    randomise: bool = False
    """whether physics and latency differ between worlds (afford/grasping/sim/scene.py, RANDOM)"""
    push_n: float = 0.0
    """force of pushes on the raised object; 0 for none"""
    seed: int = 0
    """of what differs between worlds, and of drops"""
    threads: int = 1
    """that compute worlds"""
    processes: int = 1
    """that compute worlds, each with a share of them: for bullet, which has no use for threads"""
    device: str = "cpu"
    """cpu, or cuda with the engine warp"""

    def __post_init__(self) -> None:
        for name, allowed in (("action_mode", ("rate", "paper")), ("base", BASES), ("poses", ("flat", "dropped")),
                              ("start", ("part", "anywhere"))):
            if getattr(self, name) not in allowed:
                raise ValueError(f"{name}: expected {' or '.join(allowed)}, got {getattr(self, name)!r}")
        if self.action_mode == "paper" and self.base != "none":
            raise ValueError(f"base: expected none with action_mode=paper, got {self.base}: bases give targets of the wrist, "
                             "which is given forces there; use action_mode=rate, or base=none")
        if self.base == "prior" and not self.posture:
            raise ValueError("posture: expected the posture that a prior begins in, as its facts have it, got none")
        for name, low in (("steps", 1), ("lift_m", 0.0), ("xy_m", 0.0), ("start_m", 0.0), ("wait", 0), ("push_n", 0.0),
                          ("threads", 1), ("processes", 1)):  # fmt: skip
            if not getattr(self, name) >= low:
                raise ValueError(f"{name}: expected {low} or more, got {getattr(self, name)}")

    @property
    def control_s(self) -> float:
        """A control step."""
        return wrench.CONTROL_S if self.action_mode == "paper" else CONTROL_S
