"""Readers of keypoints: three file formats, units, and one-sentence errors."""

from __future__ import annotations

import csv
import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from afford.common.errors import SourceError
from afford.grasping.motion.keypoints import COLUMNS
from afford.grasping.motion.retarget import mirror_motion
from afford.grasping.motion.targets import grip_axes
from schemas.hand import PHASES, HandMotion
from stages.grasping import motion_read
from tests.helpers.made_hands import shadow
from tests.helpers.made_motions import SHARED, own_motion, trajectory, tree


@pytest.fixture(scope="module")
def motion() -> HandMotion:
    return own_motion(shadow(), trajectory(shadow(), 12, seed=1))


def read(path: Path, backend: str = "keypoints") -> tuple[HandMotion, ...]:
    return motion_read.run(tree(path), motion_read.Params(backend))


def fields(motion: HandMotion, **changes: Any) -> dict[str, Any]:
    return {"keypoints": motion.keypoints_m * 1000, "fps": 60.0, "hand": "right", "unit": "mm"} | changes


def written(path: Path, record: dict[str, Any]) -> Path:
    """Write a record in the format of the file name."""
    if path.suffix == ".npz":
        np.savez(path, **record)
    elif path.suffix == ".json":
        path.write_text(json.dumps(record, default=np.ndarray.tolist))
    else:
        rest = {key: value for key, value in record.items() if key != "keypoints"}
        with path.open("w", newline="") as file:
            table = csv.writer(file)
            table.writerow([*COLUMNS, *rest])
            for number, row in enumerate(record["keypoints"].reshape(-1, 63)):
                table.writerow([*map(repr, row.tolist()), *(v[number] if isinstance(v, list) else v for v in rest.values())])
    return path


@pytest.mark.parametrize("ending", ["npz", "json", "csv"])
def test_file_formats_give_the_same_clip(motion: HandMotion, tmp_path: Path, ending: str) -> None:
    """Millimetres become metres to the last digits; phases and the object's name are kept."""
    words = ["reach"] * 6 + ["hold"] * 6
    (found,) = read(written(tmp_path / f"wave.{ending}", fields(motion, phase=words, object_name="cup")))
    np.testing.assert_allclose(found.keypoints_m, motion.keypoints_m, rtol=0, atol=1e-15)
    assert (found.name, found.side, found.rate_hz, found.object_name) == ("wave", "right", 60.0, "cup")
    assert [PHASES[k] for k in found.phase] == words


def test_units_of_poses(motion: HandMotion, tmp_path: Path) -> None:
    """Lengths of poses use the file's unit; quaternions are normalized."""
    palm, pose = np.tile(np.eye(4), (12, 1, 1)), np.tile([100.0, 0, 0, 0, 0, 0, 2], (12, 1))
    palm[:, 0, 3] = 250
    (found,) = read(written(tmp_path / "a.npz", fields(motion, object_pose=pose, palm=palm)))
    np.testing.assert_allclose(found.object_pose, np.tile([0.1, 0, 0, 0, 0, 0, 1], (12, 1)))
    np.testing.assert_allclose(found.T_world_palm[:, :, 3], np.tile([0.25, 0, 0, 1], (12, 1)))


BAD: dict[str, tuple[dict[str, Any], str]] = {
    "no unit": ({"unit": "inch"}, "unit: expected m or cm or mm, got 'inch'"),
    "wrong unit": ({"unit": "m"}, "expected metres"),
    "no side": ({"hand": "both"}, "hand: expected left or right, got 'both'"),
    "no rate": ({"fps": 0.0}, "fps: expected 1 to 1000"),
    "two rates": ({"fps": np.array([30.0, 60.0])}, "fps: expected one number, got 2"),
    "shape": ({"keypoints": np.zeros((12, 16, 3))}, r"expected numbers \(frames, 21, 3\)"),
    "empty": ({"keypoints": np.zeros((0, 21, 3))}, "one frame at least"),
    "gap": ({"keypoints": np.full((12, 21, 3), np.nan)}, "expected finite numbers, got another in frame 0"),
    "words": ({"keypoints": np.full((12, 21, 3), "x")}, "expected numbers"),
    "phase": ({"phase": ["grab"] * 12}, "phase: expected words of unknown"),
    "phases": ({"phase": ["hold"] * 3}, "phase: expected finite numbers"),
    "pose": ({"object_pose": np.zeros((12, 7))}, "expected quaternions x y z w, got zeros in frame 0"),
    "pose of one number": ({"object_pose": np.array(3.0)}, "object_pose: expected finite numbers"),
    "palm of few numbers": ({"palm": np.zeros((12, 2, 2))}, "palm: expected finite numbers"),
    "typo": ({"objectname": "cup"}, "got objectname"),
}


@pytest.mark.parametrize("case", BAD)
def test_errors_of_invalid_clips(motion: HandMotion, tmp_path: Path, case: str) -> None:
    changes, message = BAD[case]
    with pytest.raises(SourceError, match=message) as caught:
        read(written(tmp_path / "bad.npz", fields(motion, **changes)))
    assert str(caught.value).startswith("bad.npz") and "\n" not in str(caught.value)


@pytest.mark.parametrize(("changes", "message"), [
    ({"phase": [["hold"], ["hold", "reach"]]}, "phase: expected words of unknown"),
    ({"object_pose": [[10**400] * 7] * 12}, "object_pose: expected numbers in rows of one length"),
])  # fmt: skip
def test_malformed_json_is_rejected(motion: HandMotion, tmp_path: Path, changes: dict[str, Any], message: str) -> None:
    """Rows differ in length, or numbers exceed any float."""
    with pytest.raises(SourceError, match=message):
        read(written(tmp_path / "bad.json", fields(motion, **changes)))


def test_malformed_files_are_rejected(motion: HandMotion, tmp_path: Path) -> None:
    """Pickled objects, broken files, missing columns, and two clips of one name are rejected."""
    np.savez(tmp_path / "a.npz", keypoints=np.array([{"a": 1}], object), allow_pickle=True)
    with pytest.raises(SourceError, match=r"a.npz: expected an .npz of plain arrays"):
        read(tmp_path / "a.npz")
    (tmp_path / "b.npz").write_bytes(b"PK nothing")
    with pytest.raises(SourceError, match=r"b.npz: expected an .npz of plain arrays"):
        read(tmp_path / "b.npz")
    (tmp_path / "c.csv").write_text("wrist_x\n0\n")
    with pytest.raises(SourceError, match="expected a column wrist_y"):
        read(tmp_path / "c.csv")
    (tmp_path / "d.txt").write_text("")
    with pytest.raises(SourceError, match="expected a file of keypoints"):
        read(tmp_path / "d.txt")
    both = [written(tmp_path / name, fields(motion)) for name in ("e.npz", "e.json")]
    with pytest.raises(SourceError, match="clip 'e': expected one file of that name, got two"):
        motion_read.run(tree(*both), motion_read.Params())


def test_mirror_motion(motion: HandMotion) -> None:
    """Two reflections are the identity; the palm axes of the mirrored hand are reflected."""
    left = mirror_motion(motion)
    assert left.side == "left"
    np.testing.assert_array_equal(mirror_motion(left).keypoints_m, motion.keypoints_m)
    right, M = grip_axes(motion.keypoints_m, "right"), np.diag([-1.0, 1, 1])
    np.testing.assert_allclose(grip_axes(left.keypoints_m, "left"), M @ right @ M, atol=1e-12)


@pytest.mark.skipif(not SHARED.is_dir(), reason="needs ../shared/data/motion")
def test_shared_recordings() -> None:
    """A webcam clip, and 376 grasps of 20 objects with constant bones and the thumb first."""
    (clip,) = read(SHARED / "human_hand_keypoints_right.npz")
    assert clip.keypoints_m.shape == (621, 21, 3) and clip.rate_hz == 30.0
    grasps = read(SHARED / "dexycb_train_grasps.npz", "dexycb")
    assert len(grasps) == 376 and len({grasp.object_name for grasp in grasps}) == 20
    points = np.concatenate([grasp.keypoints_m for grasp in grasps])
    bones = np.linalg.norm(np.diff(points[:, 1:].reshape(-1, 5, 4, 3), axis=2), axis=-1)
    assert bones.std(axis=0).max() < 1e-4
    base = np.linalg.norm(points[:, 1::4] - points[:, :1], axis=-1).mean(axis=0)
    assert base.argmin() == 0 and base.argmax() == 2


def test_malformed_dexycb_files_are_rejected(tmp_path: Path) -> None:
    for name, arrays, message in (("a", {"x": np.zeros(1)}, "expected arrays <object id>/final_ee_rel"),
                                  ("b", {"99/final_ee_rel": np.zeros((1, 63))}, "expected object ids 1 to 21"),
                                  ("c", {"1/final_ee_rel": np.zeros((1, 60))}, r"expected numbers \(grasps, 63\)")):  # fmt: skip
        np.savez(tmp_path / f"{name}.npz", **arrays)
        with pytest.raises(SourceError, match=message):
            read(tmp_path / f"{name}.npz", "dexycb")
