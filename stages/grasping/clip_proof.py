"""clips, a hand, their objects -> the clips whose objects a hand that follows them lifts, and a verdict on every other.

Reads   HandModel; GraspObjects; the ReferenceSets of their clips, and the GraspTargets; further verdicts, which are passed on
Writes  ProvenClips: ReferenceSet of kept clips, whose report has every verdict; their objects and targets
Method  each clip is simulated from its exact start `proofs` times in each engine; the object must be held at the end every time
Fails   ValueError: a clip of an unknown object, no clip that lifts
Paper   AffordDex, HTI, does not mention filtering; users of its data report 323 of 583 clips that track
"""

from __future__ import annotations

from dataclasses import dataclass

from schemas.grasp import GraspObject
from schemas.hand import GraspTarget, HandModel, ProvenClips, ReferenceSet, RetargetReport

LIBRARIES = ("numpy", "scipy", "mujoco", "pybullet", "trimesh")
THREADS = 2
MEMORY_GIB = 1.5
TIMEOUT_S = 14400.0


@dataclass(frozen=True)
class Params:
    """Parameters of clip_proof."""

    proofs: int = 1
    """simulated episodes of each clip in each engine; 0 keeps all clips"""
    engines: tuple[str, ...] = ("mujoco", "bullet")
    """engines of the test"""
    steps: int = 40
    """control steps of an episode"""
    lift_m: float = 0.20
    """height to which clips lift"""
    worlds: int = 24
    """worlds simulated at once"""
    seed: int = 0
    """seed of the episodes"""


def run(hand: HandModel, bodies: tuple[tuple[GraspObject, ...], ...], targets: tuple[tuple[GraspTarget, ...], ...],
        references: tuple[ReferenceSet, ...], others: tuple[RetargetReport, ...], params: Params) -> ProvenClips:  # fmt: skip
    """Simulate all clips."""
    from afford.grasping.imitation.clip_filter import proven
    from afford.grasping.imitation.grasp_imitation_env import GraspImitationConfig

    if params.proofs < 0 or params.worlds < 1 or params.steps < 1 or not params.engines:
        raise ValueError(f"clip_proof: expected proofs of 0 or more, worlds and steps of 1 or more, and an engine, got "
                         f"{params.proofs}, {params.worlds}, {params.steps} and {len(params.engines)} engines")
    config = GraspImitationConfig(steps=params.steps, lift_m=params.lift_m, threads=THREADS)
    known, places = [one for some in bodies for one in some], [one for some in targets for one in some]
    return proven(hand, known, places, references, others, config, params.proofs, params.engines, params.worlds, params.seed)
