"""Recordings of a source: unusable ones are reported with one sentence each, and the others are read."""

from __future__ import annotations

import shutil
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from afford.common.errors import SourceError
from afford.grasping.motion.retarget import mirror_motion
from commands.errors import UsageError
from commands.origin import origin
from commands.weights import resolve_weights
from maps import grasping
from maps.settings import Origin, Settings
from maps.settings.grasping import FITTED
from pipeline import build
from runner import Graph
from runner.canonical import file_digest
from schemas.hand import HandMotion, MotionsRead
from stages.grasping import hand_retarget, human_motion, recordings_read
from tests.helpers.made_hands import shadow
from tests.helpers.made_motions import own_motion, recorded, trajectory, tree


def motion() -> HandMotion:
    return own_motion(shadow(), trajectory(shadow(), 12, seed=1))


def write(path: Path, **changes: Any) -> Path:
    fields = {"keypoints": motion().keypoints_m, "fps": 60.0, "hand": "right", "unit": "m"} | changes
    np.savez(path, **fields)
    return path


def read(*paths: Path, format: str = "keypoints") -> MotionsRead:
    return recordings_read.run(tree(*paths), recordings_read.Params(format))


def test_bad_recordings_are_reported_and_the_others_are_read(tmp_path: Path) -> None:
    """A gap, values that are not finite, frames out of order, a broken file: one sentence each, which names the file."""
    hole, late, early = motion().keypoints_m.copy(), np.arange(12) / 60, np.arange(12) / 60
    hole[4, 7] = np.nan
    late[6:] += 0.2
    early[[5, 6]] = early[[6, 5]]
    good, timed = write(tmp_path / "good.npz"), write(tmp_path / "timed.npz", time=np.arange(12) / 60)
    bad = {write(tmp_path / "hole.npz", keypoints=hole): "got another in frame 4; cut the clip there, or fill the gap",
           write(tmp_path / "late.npz", time=late): "got a gap of 0.217 s after frame 5; cut the clip there",
           write(tmp_path / "early.npz", time=early): "rising seconds, got 0.0833333 after 0.1 in frame 6; sort the frames",
           write(tmp_path / "short.npz", time=np.arange(3)): "expected finite seconds (12,)",
           write(tmp_path / "both.npz", hand="both"): "expected left or right"}  # fmt: skip
    (tmp_path / "broken.npz").write_bytes(b"PK nothing")
    found = read(good, timed, *bad, tmp_path / "broken.npz")
    assert [one.name for one in found.motions] == ["good", "timed"]
    verdicts = {one.name: one for one in found.report.verdicts}
    assert verdicts.keys() == {*(path.name for path in bad), "broken.npz"}
    assert all(not one.kept and one.reason == "unreadable" and "\n" not in one.detail for one in verdicts.values())
    for path, words in bad.items():
        assert verdicts[path.name].detail.startswith(path.name) and words in verdicts[path.name].detail
    assert found.report.dropped == ("unreadable: 6",)


def test_rows_and_sequences_are_recordings_of_their_own(tmp_path: Path) -> None:
    """A bad row of DexYCB's grasps and a sequence of OakInk2 out of order do not affect the others; so does a name twice."""
    sources = recorded(tmp_path)
    with np.load(sources["dexycb"].files[0].path) as found:
        rows = {name: found[name].copy() for name in found.files}
    rows["14/final_ee_rel"][0, 3] = np.inf
    np.savez(tmp_path / "rows.npz", **rows)
    made = read(tmp_path / "rows.npz", format="dexycb")
    assert [one.name for one in made.motions] == ["14_mug_001"] and made.report.verdicts[0].name == "14_mug_000"
    twice = read(sources["dexycb"].files[0].path, tmp_path / "rows.npz", format="dexycb")
    assert [one.name for one in twice.motions] == ["14_mug_000", "14_mug_001"]
    assert twice.report.dropped == ("name twice: 1", "unreadable: 1")
    folder = sources["oakink2"].files[0].path.parent
    sequence = next(path for path in folder.glob("scene*.npz"))
    with np.load(sequence) as found:
        arrays = {name: found[name].copy() for name in found.files}
    arrays["frames"][[3, 4]] = arrays["frames"][[4, 3]]
    np.savez(folder / "mixed.npz", **arrays)
    shutil.copy(sequence.with_suffix(".json"), folder / "mixed.json")
    mixed = recordings_read.run(tree(*folder.iterdir()), recordings_read.Params("oakink2"))
    assert len(mixed.motions) == 3 and "expected rising frame numbers, got 3 after 4" in mixed.report.verdicts[0].detail


def test_sources_without_a_usable_recording_are_refused(tmp_path: Path) -> None:
    """A source without the format, one without a usable recording, an unknown format."""
    (tmp_path / "a.txt").write_text("")
    with pytest.raises(SourceError, match="expected a file of keypoints"):
        read(tmp_path / "a.txt")
    with pytest.raises(SourceError, match=r"expected a recording that can be used, got none of 1; bad\.npz, hand"):
        read(write(tmp_path / "bad.npz", hand="both"))
    with pytest.raises(ValueError, match="recordings_read, format: expected keypoints, dexycb, oakink2, got 'bvh'"):
        read(tmp_path / "bad.npz", format="bvh")


def test_left_hands_are_mirrored_or_dropped_with_a_sentence() -> None:
    """`hand_retarget` mirrors a left hand; with mirror=False it is dropped."""
    left = replace(mirror_motion(motion()), name="left")
    loose = replace(FITTED, min_s=0.05, max_error_m=9.0, max_joint_rad_s=1e9, max_palm_m_s=1e9, max_point_m_s=1e9, frame_steps=5)
    assert hand_retarget.run(left, shadow(), loose).verdict.mirrored
    refused = hand_retarget.run(left, shadow(), replace(loose, mirror=False)).verdict
    assert (refused.kept, refused.reason, refused.detail) == (False, "other hand", "a left hand; the robot's is the right one")


def test_poses_of_objects_give_the_world_of_dexycb(tmp_path: Path) -> None:
    """obj_pose_reset moves keypoints into the world with z up; the hand stays where it was relative to the object."""
    with np.load(recorded(tmp_path)["dexycb"].files[0].path) as found:
        rows = found["14/final_ee_rel"]
    half = np.sqrt(0.5)
    pose = np.tile([1.0, 2.0, 3.0, half, half, 0.0, 0.0], (2, 1))  # w x y z: a quarter turn about x
    np.savez(tmp_path / "posed.npz", **{"14/final_ee_rel": rows, "14/obj_pose_reset": pose})
    plain, posed = read(tmp_path / "dexycb.npz", format="dexycb"), read(tmp_path / "posed.npz", format="dexycb")
    before, after = plain.motions[0], posed.motions[0]
    assert after.object_pose[0] == pytest.approx([1, 2, 3, half, 0, 0, half])
    x, y, z = before.keypoints_m[0].T
    assert after.keypoints_m[0] == pytest.approx(np.stack([x + 1, 2 - z, 3 + y], axis=1))
    np.savez(tmp_path / "short.npz", **{"14/final_ee_rel": rows, "14/obj_pose_reset": pose[:1]})
    with pytest.raises(SourceError, match=r"obj_pose_reset: expected numbers \(grasps, 7\)"):
        read(tmp_path / "short.npz", format="dexycb")


# -- the target --------------------------------------------------------------------------------------------------------


def source(folder: Path) -> Path:
    """A folder with a recording and the meshes of two objects, one for evaluation."""
    write(folder / "clip.npz")
    for name in ("006_mustard_bottle", "025_mug"):
        (folder / "some_meshes" / name).mkdir(parents=True)
        (folder / "some_meshes" / name / "mesh.obj").write_text("v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n")
    return folder


def given(folder: Path | None, **stages: Any) -> Origin:
    return origin("grasp-prior", folder, Settings.of(**stages), file_digest)[0]


def test_origin_of_a_prior_has_recordings_and_scans_apart(tmp_path: Path) -> None:
    """Meshes for evaluation are left out; files of meshes are no recordings; an unknown choice of data is refused."""
    (tmp_path / "mine").mkdir()
    found = given(source(tmp_path / "mine"))
    assert [one.name for one in found.meshes] == ["006_mustard_bottle"]
    assert found.motions is not None and [file.name for file in found.motions.files] == ["clip.npz"] and found.name == "mine"
    with pytest.raises(UsageError, match=r"human_motion\.data: expected synthetic, recorded or both, got 'all'"):
        given(tmp_path / "mine", human_motion=human_motion.Params(data="all"))


def test_data_chooses_the_clips_of_a_prior() -> None:
    """Synthetic clips alone read no recording; recorded ones alone need the places of tools, for hands without an object."""
    graphs = {data: build("grasp-prior", Origin("x"), Settings.of(human_motion=human_motion.Params(data=data)))
              for data in ("synthetic", "recorded", "both")}  # fmt: skip
    needed = {data: {node.name for node in graph.upstream([graph.node_of(one) for one in graph.targets["grasp-prior"]])}
              for data, graph in graphs.items()}  # fmt: skip
    assert "recordings_read" not in needed["synthetic"] and "hand_retarget" in needed["synthetic"]
    assert "recorded_retarget" in needed["recorded"] and "motion_report" not in needed["recorded"]
    assert {"recorded_retarget", "motion_report"} <= needed["both"]


def test_given_prior_replaces_its_training(tmp_path: Path) -> None:
    """`human_motion.prior` names a folder; `grasp` then trains no prior, and is otherwise unchanged."""
    for name in ("policy.json", "policy.safetensors"):
        (tmp_path / name).write_text(name)
    chosen = resolve_weights(Settings.of(human_motion=human_motion.Params(prior=str(tmp_path))), file_digest, "grasp")
    with_prior, usual = Graph(), Graph()
    grasping.grasp(with_prior, Origin("x"), chosen)
    grasping.grasp(usual, Origin("x"), Settings())
    names = [{node.name for node in graph.stages()} for graph in (with_prior, usual)]
    assert names[1] - names[0] == {"hand_imitation", "record_hand_imitation"} and names[0] <= names[1]
    assert chosen.grasping.human_motion.prior == tmp_path.name
    with pytest.raises(UsageError, match=r"human_motion\.prior: model"):
        resolve_weights(Settings.of(human_motion=human_motion.Params(prior="nowhere")), file_digest, "grasp")
