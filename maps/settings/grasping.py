"""Default parameters of the grasping stages."""

from __future__ import annotations

from dataclasses import dataclass

from stages.grasping import (
    body_adapt,
    body_choose,
    body_evaluate,
    body_refinement,
    body_report,
    body_tasks,
    clip_proof,
    grasp_evaluate,
    grasp_judge,
    grasp_report,
    grasp_student,
    grasp_targets,
    grasp_tasks,
    grasp_two_tasks,
    hand_imitation,
    hand_model,
    hand_motion,
    hand_retarget,
    household_shown,
    household_tasks,
    human_motion,
    imitation_evaluate,
    motion_read,
    motion_report,
    motion_synthesise,
    object_solids,
    recordings_read,
    rl_grasp_refinement,
)
from stages.grasping.hand_retarget import Params as Retarget
from stages.recording import grasp_record, policy_record

MOTION = motion_synthesise.Params(
    clips=1, rate_hz=20.0, reach_s=(0.45, 0.55), close_s=(0.2, 0.25), hold_s=0.25, lift_s=0.7, lift_m=0.2,
    distance_m=(0.115, 0.125), approach=(0.0, -0.741, -0.672), start=(0.0, 0.0, 20.0), wander=0.3, beyond_m=(0.0, -0.009, -0.0242),
    spread_deg=4.0, turn_deg=5.0, hooking=(-0.41, -0.21), press=0.99, noise_m=0.0)  # fmt: skip
"""clips that fit into an episode; docs/grasping/imitation.md describes the search for these values"""
FITTED = hand_retarget.Params(centre=False, frame_steps=20, clip_steps=5)
"""the world of a clip stays that of its object; short clips need few solver steps"""
RECORDED = hand_retarget.Params()
"""parameters of hand_retarget for recorded motion"""


@dataclass(frozen=True)
class Grasping:
    """Parameters of every stage of the system, by stage."""

    hand_model: hand_model.Params = hand_model.Params()
    object_solids: object_solids.Params = object_solids.Params()
    grasp_tasks: grasp_tasks.Params = grasp_tasks.Params()
    grasp_targets: grasp_targets.Params = grasp_targets.Params()
    motion_synthesise: motion_synthesise.Params = MOTION
    hand_retarget: hand_retarget.Params = FITTED
    motion_read: motion_read.Params = motion_read.Params()
    hand_motion: hand_motion.Params = hand_motion.Params()
    motion_retarget: Retarget = RECORDED
    recordings_read: recordings_read.Params = recordings_read.Params()
    human_motion: human_motion.Params = human_motion.Params()
    clip_proof: clip_proof.Params = clip_proof.Params()
    motion_report: motion_report.Params = motion_report.Params()
    hand_imitation: hand_imitation.Params = hand_imitation.Params()
    rl_grasp_refinement: rl_grasp_refinement.Params = rl_grasp_refinement.Params()
    grasp_student: grasp_student.Params = grasp_student.Params()
    grasp_evaluate: grasp_evaluate.Params = grasp_evaluate.Params()
    grasp_two_tasks: grasp_two_tasks.Params = grasp_two_tasks.Params()
    imitation_evaluate: imitation_evaluate.Params = imitation_evaluate.Params()
    grasp_judge: grasp_judge.Params = grasp_judge.Params()
    body_tasks: body_tasks.Params = body_tasks.Params()
    body_choose: body_choose.Params = body_choose.Params()
    body_adapt: body_adapt.Params = body_adapt.Params()
    body_refinement: body_refinement.Params = body_refinement.Params()
    body_evaluate: body_evaluate.Params = body_evaluate.Params()
    body_report: body_report.Params = body_report.Params()
    household_tasks: household_tasks.Params = household_tasks.Params()
    household_shown: household_shown.Params = household_shown.Params()
    grasp_record: grasp_record.Params = grasp_record.Params()
    policy_record: policy_record.Params = policy_record.Params()
    grasp_report: grasp_report.Params = grasp_report.Params()
