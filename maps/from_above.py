"""Clips of people who grasp what lies on a table: the defaults of the two stages that make them."""

from __future__ import annotations

from stages.grasping import hand_retarget, motion_synthesise

MOTION = motion_synthesise.Params(
    clips=1, rate_hz=20.0, reach_s=(0.45, 0.55), close_s=(0.2, 0.25), hold_s=0.25, lift_s=0.7, lift_m=0.2,
    distance_m=(0.115, 0.125), approach=(0.0, -0.741, -0.672), start=(0.0, 0.0, 20.0), wander=0.3, beyond_m=(0.0, -0.009, -0.0242),
    spread_deg=4.0, turn_deg=5.0, hooking=(-0.41, -0.21), press=0.99, noise_m=0.0)  # fmt: skip
"""fast enough for an episode; how they were found: docs/grasping/imitation.md"""
FITTED = hand_retarget.Params(centre=False, frame_steps=20, clip_steps=5)
"""the world of a clip stays that of its object, and so short a clip needs few steps of the solver"""
RECORDED = hand_retarget.Params()
"""of hand_retarget, for recorded motion of anything"""
