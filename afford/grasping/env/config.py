"""Configuration of the grasping environments."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

from afford.grasping.env import actions
from afford.grasping.env.actions import BASES
from afford.grasping.sim.engine import CONTROL_S
from afford.grasping.sim.scene import Physics


@dataclass(frozen=True)
class GraspEnvConfig:
    """Keyword arguments of the grasping environments. ValueError for an unknown or impossible value."""

    engine: str = "mujoco"
    """mujoco, bullet, or warp (afford/grasping/sim/warp_worlds.py; the extra gpu)"""
    physics: Physics = field(default_factory=Physics)
    """rate and accuracy of the physics"""
    action_mode: str = "rate"
    """rate: 20 actions per second; paper: wrenches, 60 per second, with base=none and the published steps=200 (actions.py)"""
    base: str = "none"
    """targets that actions are added to: none, script, or prior (actions.py)"""
    posture: tuple[float, ...] = ()
    """motor joints at the start, the wrist's relative to the aim, from a prior's facts; empty: the start of the script"""
    layout: str = "small"
    """layout of observations: small, paper or points (obs_blocks.py)"""
    role: str = "teacher"
    """role whose blocks are observed: prior, teacher or student (obs_blocks.py)"""
    reward: str = "afforddex"
    """set of reward terms (reward.py)"""
    weights: Mapping[str, float] = field(default_factory=dict)
    """weights of terms that replace those of the set"""
    steps: int = 40
    """control steps of an episode; the script takes 38 to lift by 20 cm, 34 by 15 cm"""
    lift_m: float = 0.20
    """height of the goal above the object's place at rest"""
    wait: int = 0
    """control steps for which the script stays above before it descends"""
    poses: str = "flat"
    """flat: the object lies as it was built; dropped: it is dropped and settles. Both anywhere within xy_m, at any yaw"""
    xy_m: float = 0.05
    """largest distance of the object from the origin, along x and along y"""
    start: str = "part"
    """where the hand begins and its base grasps: part, over the part to hold; anywhere, independent of parts"""
    start_m: float = 0.06
    """start=anywhere: largest distance of that place from the centre of mass, along the object"""
    randomise: bool = False
    """randomise physics and latency over worlds (afford/grasping/sim/scene.py, RANDOM)"""
    push_n: float = 0.0
    """force of pushes on the raised object; 0 for none"""
    seed: int = 0
    """seed of randomised physics, and of drops"""
    threads: int = 1
    """threads that compute worlds"""
    processes: int = 1
    """processes that compute worlds, each a share of them; for bullet, which does not profit from threads"""
    device: str = "cpu"
    """cpu; or cuda or cuda:N with the engine warp"""

    def __post_init__(self) -> None:
        for name, allowed in (("action_mode", ("rate", "paper")), ("base", BASES), ("poses", ("flat", "dropped")),
                              ("start", ("part", "anywhere"))):
            if getattr(self, name) not in allowed:
                raise ValueError(f"{name}: expected {' or '.join(allowed)}, got {getattr(self, name)!r}")
        if self.action_mode == "paper" and self.base != "none":
            raise ValueError(f"base: {self.base} does not fit action_mode=paper: a base gives targets of the wrist, "
                             "which takes forces in this mode; use action_mode=rate or base=none")
        if self.base == "prior" and not self.posture:
            raise ValueError("posture: base=prior needs the start posture of the prior; take it from the prior's facts")
        for name, low in (("steps", 1), ("lift_m", 0.0), ("xy_m", 0.0), ("start_m", 0.0), ("wait", 0), ("push_n", 0.0),
                          ("threads", 1), ("processes", 1)):  # fmt: skip
            if not getattr(self, name) >= low:
                raise ValueError(f"{name}: expected {low} or more, got {getattr(self, name)}")

    @property
    def control_s(self) -> float:
        """Duration of a control step, s."""
        return actions.WRENCH_CONTROL_S if self.action_mode == "paper" else CONTROL_S
