"""Clips of recorded grasps: on their scans, on tools, and the reasons of recordings that become none."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from afford.grasping.imitation.recorded_clips import EVALUATION_SCANS, grasp_frame, is_evaluation_scan
from afford.grasping.motion.bend import bend_fingers
from afford.grasping.motion.retarget import mirror_motion
from maps.settings.grasping import FITTED, MOTION
from schemas.grasp import GraspObject
from schemas.hand import PHASES, GraspClips, HandMotion
from stages.grasping import clip_proof, hand_imitation, hand_retarget, human_motion, motion_report, motion_synthesise
from tests.helpers.made_hands import shadow
from tests.helpers.made_priors import targets
from tests.helpers.made_samples import Scratch
from tests.helpers.made_scenes import tool

HOLD = PHASES.index("hold")


def scan(name: str = "042_spatula") -> GraspObject:
    """A built-in tool as a scan: it has one part."""
    body = tool("spatula")
    return replace(body, name=name, parts=("unnamed",), hull_part=0 * body.hull_part, point_part=0 * body.point_part)


def grasp(**changes: Any) -> HandMotion:
    """A person's grasp of the spatula, a single frame: that of a synthetic clip before it presses."""
    clip = motion_synthesise.run(targets()[2], replace(MOTION, press=0.0, beyond_m=(0.0, 0.0, 0.0)))[0]
    at = slice(first := int((clip.phase == HOLD).argmax()), first + 1)
    found = replace(clip, name="person", source="dexycb", keypoints_m=clip.keypoints_m[at], phase=clip.phase[at],
                    object_name="spatula", object_pose=clip.object_pose[at], T_world_palm=np.zeros((0, 4, 4)))  # fmt: skip
    return replace(found, **changes)


def clips(*motions: HandMotion, **params: Any) -> GraspClips:
    return human_motion.run(motions, (scan(),), targets(), shadow(), human_motion.Params(**params))


def reasons(found: GraspClips) -> dict[str, str]:
    return {verdict.name: verdict.reason for verdict in found.report.verdicts}


def relative(points: np.ndarray, pose: np.ndarray) -> np.ndarray:
    moved: np.ndarray = Rotation.from_quat(pose[3:]).inv().apply(points - pose[:3])
    return moved


def test_bent_fingers_keep_their_bones() -> None:
    """Amount 0 changes nothing; opening moves the fingertips from the thumb, closing moves them to the palm."""
    points = np.tile(grasp().keypoints_m, (3, 1, 1))
    out = bend_fingers(points, "right", np.array([0.0, -0.3, 0.3]))
    bones = np.linalg.norm(np.diff(out[:, 1:].reshape(3, 5, 4, 3), axis=2), axis=-1)
    assert bones[1:] == pytest.approx(np.tile(bones[:1], (2, 1, 1)))
    assert out[0] == pytest.approx(points[0])
    opened, closed = (np.linalg.norm(row[[8, 12]].mean(axis=0) - row[4]) for row in out[1:])
    assert opened > np.linalg.norm(points[0, [8, 12]].mean(axis=0) - points[0, 4]) + 0.01
    assert np.linalg.norm(out[2, [8, 12, 16, 20]] - out[2, 0], axis=1).mean() < np.linalg.norm(
        points[0, [8, 12, 16, 20]] - points[0, 0], axis=1).mean()
    assert closed != pytest.approx(opened)


def test_recorded_grasp_becomes_reach_close_and_lift() -> None:
    """The hand is where it was recorded relative to the object, begins 12 cm away, and lifts by 20 cm."""
    one = grasp()
    found = clips(one)
    (clip,), (target,) = found.motions, found.targets
    assert clip.name == f"{target.name}_000" and clip.object_name == target.object_name == "042_spatula"
    contact = int((clip.phase == PHASES.index("reach")).sum()) - 1
    fingers = [0, 1, 5, 9, 13, 17]
    theirs = relative(one.keypoints_m[0, fingers], one.object_pose[0])
    ours = relative(clip.keypoints_m[contact, fingers], clip.object_pose[contact])
    assert ours == pytest.approx(theirs, abs=1.5e-3)  # the scan comes to rest a little lower
    assert np.linalg.norm(clip.keypoints_m[0, 0] - clip.keypoints_m[contact, 0]) == pytest.approx(0.12, abs=1e-6)
    assert clip.object_pose[-1, 2] - clip.object_pose[0, 2] == pytest.approx(0.2, abs=1e-6)
    assert clip.keypoints_m[contact, fingers, 1].mean() > 0
    assert len(clip.keypoints_m) / clip.rate_hz <= 2.0


def test_recorded_reach_is_kept() -> None:
    """Frames before the grasp are resampled; the clip begins where the recording does."""
    away = np.linspace(0.2, 0.0, 31)[:, None, None] * np.array([0.0, 0.0, 1.0])
    one = grasp()
    many = replace(one, keypoints_m=one.keypoints_m + away, rate_hz=60.0, object_pose=np.repeat(one.object_pose, 31, axis=0),
                   phase=np.array([PHASES.index("reach")] * 30 + [HOLD], np.uint8))  # fmt: skip
    assert grasp_frame(many) == 30
    made = clips(many).motions[0]
    contact = int((made.phase == PHASES.index("reach")).sum()) - 1
    assert contact == 10 and made.rate_hz == 20.0
    assert made.keypoints_m[:11, 0, 2] - made.keypoints_m[10, 0, 2] == pytest.approx(np.linspace(0.2, 0.0, 11), abs=1e-6)


def test_posture_without_an_object_is_placed_on_a_tool() -> None:
    """The middle of the fingertips comes to the handle; a left hand is mirrored; a hand that is too far open has no tool."""
    unknown = grasp(object_name="", object_pose=np.zeros((0, 7)), source="keypoints")
    left = replace(mirror_motion(unknown), name="left")
    wide = replace(unknown, name="wide", keypoints_m=bend_fingers(unknown.keypoints_m, "right", np.array([-0.6])))
    found = clips(unknown, left, wide)
    assert reasons(found) == {"wide": "no tool"}
    assert [motion.side for motion in found.motions] == ["right", "right"]
    assert found.motions[0].keypoints_m == pytest.approx(found.motions[1].keypoints_m, abs=1e-6)
    clip, target = found.motions[0], found.targets[0]
    contact = clip.keypoints_m[int((clip.phase == PHASES.index("reach")).sum()) - 1]
    handle = np.eye(4)
    handle[:3, :3], handle[:3, 3] = Rotation.from_quat(target.object_pose[3:]).as_matrix(), target.object_pose[:3]
    place = (handle @ target.T_object_handle)[:3, 3]
    assert target.object_name in {one.object_name for one in targets()}
    assert np.linalg.norm((contact[4] + contact[[8, 12]].mean(axis=0)) / 2 - place) < 0.03


def test_every_left_out_motion_has_a_reason() -> None:
    """Others become clips; without any, an error with the reasons."""
    one = grasp()
    tilted = one.object_pose.copy()
    tilted[:, 3:] = (Rotation.from_euler("x", 80, degrees=True) * Rotation.from_quat(tilted[0, 3:])).as_quat()
    bad = [replace(one, name="drill", object_name="035_power_drill"), replace(one, name="cup", object_name="cup"),
           replace(one, name="left", side="left"), replace(one, name="free", phase=np.zeros(1, np.uint8)),
           replace(one, name="tilted", object_pose=tilted)]  # fmt: skip
    wanted = {"drill": "evaluation scan", "cup": "no scan", "left": "other hand", "free": "no grasp", "tilted": "tips over"}
    found = clips(one, *bad, tilt_deg=3.0)
    assert reasons(found) == wanted and [clip.name for clip in found.motions] == ["person_000"]
    assert all(verdict.detail and "\n" not in verdict.detail for verdict in found.report.verdicts)
    with pytest.raises(ValueError, match=r"no motion of 1 becomes a clip of a grasp; evaluation scan: 1"):
        clips(bad[0])
    with pytest.raises(ValueError, match="human_motion, lift_m"):
        clips(one, lift_m=0.0)


@pytest.mark.parametrize("name", ["019_pitcher_base", "021_bleach_cleanser", "025_mug", "035_power_drill", "037_scissors"])
def test_scans_for_evaluation_are_never_in_a_prior(name: str, tmp_path: Any) -> None:
    """Such scans are left out by name, and a prior refuses their recorded clips."""
    assert is_evaluation_scan(name) and len(EVALUATION_SCANS) == 5
    assert not any(map(is_evaluation_scan, ("006_mustard_bottle", "010_potted_meat_can", "011_banana", "024_bowl")))
    with pytest.raises(ValueError, match="evaluation scan: 1"):
        human_motion.run((grasp(object_name=name),), (scan(name),), (), shadow(), human_motion.Params())
    found = clips(grasp())
    clip = hand_retarget.run(found.motions[0], shadow(), FITTED)
    clip = replace(clip, references=(replace(clip.references[0], object_name=name),))
    shown = motion_report.run((clip,), motion_report.Params())
    with pytest.raises(ValueError, match=f"{name}: expected no recorded clip of a scan"):
        hand_imitation.run(shadow(), (scan(name),), found.targets, shown, hand_imitation.Params(proofs=0), Scratch(tmp_path))


def test_prior_learns_from_a_recorded_clip(tmp_path: Any) -> None:
    """A clip that lifts is kept with its scan and target; one that does not is reported; the prior begins where the clip begins."""
    low = replace(grasp(), name="weak")
    strong, weak = clips(grasp()), clips(low, press=0.0, nearer_m=0.0, opened=0.0)
    made = [hand_retarget.run(one.motions[0], shadow(), FITTED) for one in (strong, weak)]
    sets = motion_report.run(tuple(made), motion_report.Params())
    proof = clip_proof.Params(engines=("mujoco",))
    proven = clip_proof.run(shadow(), ((scan(), tool("flashlight")),), (strong.targets, weak.targets), (sets,),
                            (strong.report,), proof)  # fmt: skip
    verdicts = {one.name: (one.kept, one.reason) for one in proven.references.report.verdicts}
    assert verdicts == {"person_000": (True, ""), "weak_000": (False, "does not lift")}
    assert [one.name for one in proven.bodies] == ["042_spatula"] and [one.name for one in proven.targets] == ["person"]
    few = hand_imitation.Params(cloning=2, alone=1, memory=1, passes=1, batch=64, worlds=1, hidden=(16,), proofs=0, steps=12)
    trained = hand_imitation.run(shadow(), proven.bodies, proven.targets, proven.references, few, Scratch(tmp_path))
    assert trained.files.find("policy.safetensors") is not None
