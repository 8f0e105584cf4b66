"""OakInk2 files written here: malicious pickles are never run, and MANO joints follow the formulas."""

from __future__ import annotations

import io
import json
import os
import pickle
import subprocess
import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import torch
from scipy.spatial.transform import Rotation

from afford.common.apart import PROJECT
from afford.common.errors import SourceError
from afford.common.unpickle import RefusedError, load_plain
from afford.grasping.motion import oakink2
from afford.grasping.motion.oakink2_import import convert, convert_all
from stages.grasping import motion_read
from tests.helpers.made_motions import oakink2_root, pretend_mano, tree


class Evil:
    """Object that runs a command when it is unpickled normally."""

    def __init__(self, marker: Path) -> None:
        self.marker = marker

    def __reduce__(self) -> tuple[Any, ...]:
        return os.system, (f"touch {self.marker}",)


class Hidden(Evil):
    """The same command inside a tensor's storage."""

    def __reduce__(self) -> tuple[Any, ...]:
        inner = io.BytesIO()
        torch.save({"x": Evil(self.marker)}, inner)
        return torch.storage._load_from_bytes, (inner.getvalue(),)


class Codec:
    """Codec by name, which would be code."""

    def __reduce__(self) -> tuple[Any, ...]:
        import _codecs

        return _codecs.encode, ("x", "rot13")


def dumped(path: Path, value: object, protocol: int = 4) -> Path:
    path.write_bytes(pickle.dumps(value, protocol=protocol))
    return path


@pytest.mark.parametrize("evil", [Evil, Hidden])
def test_a_malicious_pickle_is_rejected_and_never_run(tmp_path: Path, evil: type[Evil]) -> None:
    """The test also shows that a normal unpickler would have run the command."""
    marker = tmp_path / "marker"
    path = dumped(tmp_path / "bad.pkl", {"mocap_frame_id_list": [0], "raw_mano": evil(marker)})
    with pytest.raises(SourceError, match=r"bad.pkl: expected an annotation of OakInk2 made of numbers") as caught:
        convert(path, tmp_path / "out.npz")
    assert not marker.exists() and not (tmp_path / "out.npz").exists() and "\n" not in str(caught.value)
    act, arguments = Evil(marker).__reduce__()  # what an unpickler would have called
    act(*arguments)
    assert marker.exists()


@pytest.mark.parametrize("value", [{1, 2}, Codec(), np.array([{}], object), Path("x"), b"bytes"])
def test_other_pickled_values_are_rejected(tmp_path: Path, value: object) -> None:
    with pytest.raises(RefusedError):
        load_plain(dumped(tmp_path / "a.pkl", {"x": value}))


@pytest.mark.parametrize("protocol", [2, 4, 5])
def test_plain_values_are_read(tmp_path: Path, protocol: int) -> None:
    """Numbers, text, lists, tuples, arrays, scalars; tensors become arrays."""
    value = {"a": [1, 2.5, "x", None, True], ("t", 1): np.arange(6.0).reshape(2, 3), "s": np.float64(3.5),
             "t": torch.arange(4.0).reshape(2, 2)}  # fmt: skip
    found = load_plain(dumped(tmp_path / "a.pkl", value, protocol))
    assert found["a"] == [1, 2.5, "x", None, True] and found["s"] == 3.5
    np.testing.assert_array_equal(found["t", 1], value["t", 1])
    np.testing.assert_array_equal(found["t"], [[0, 1], [2, 3]])


def test_sequences_become_clips(tmp_path: Path) -> None:
    """Each hand of each primitive is one clip; the wrist is at tsl, the object at its matrix."""
    root, out = oakink2_root(tmp_path / "root"), tmp_path / "out"
    assert convert_all(root, out) == ["scene_01++seq_a"]
    for side in ("left", "right"):
        np.savez(out / f"mano_{side}.npz", **pretend_mano(seed=3))
    left, right, only = motion_read.run(tree(*out.iterdir()), motion_read.Params("oakink2"))
    assert (left.name, left.side, len(left.phase)) == ("scene_01++seq_a_lh_00002_hold", "left", 8)
    assert (right.name, right.side, len(right.phase)) == ("scene_01++seq_a_rh_00000_pour", "right", 10)
    assert (only.name, only.object_name, only.rate_hz) == ("scene_01++seq_a_rh_00010_place", "cup", 120.0)
    np.testing.assert_allclose(right.keypoints_m[:, 0], np.linspace([0, 0, 1], [1, 0, 1], 30)[:10])
    np.testing.assert_allclose(only.object_pose[0], [0.1, 0.2, 0.3, 0, 0, np.sqrt(0.5), np.sqrt(0.5)], atol=1e-12)
    wrist = Rotation.from_rotvec([0.3, 0.2, 0.1])
    model = oakink2.read_mano(tree(out / "mano_right.npz").files[0], "right")
    flat = oakink2.keypoints(model, np.tile([0.0, 0, 0, 1], (1, 16, 1)), np.zeros((1, 10)))
    np.testing.assert_allclose(right.keypoints_m[0] - right.keypoints_m[0, 0], wrist.apply(flat[0]), atol=1e-9)


def test_mano_kinematics(tmp_path: Path) -> None:
    """A bent index knuckle rotates the joints below it about itself, and no others; shape blends move joints."""
    np.savez(tmp_path / "mano_right.npz", **pretend_mano(seed=1))
    model = oakink2.read_mano(tree(tmp_path / "mano_right.npz").files[0], "right")
    flat, bent = (np.tile([0.0, 0, 0, 1], (1, 16, 1)) for _ in range(2))
    turn = Rotation.from_rotvec([0.5, 0, 0])
    bent[0, 1] = turn.as_quat()
    before, after = (oakink2.keypoints(model, q, np.zeros((1, 10)))[0] for q in (flat, bent))
    np.testing.assert_allclose(after[6:8] - after[5], turn.apply(before[6:8] - before[5]), atol=1e-12)
    others = [k for k in range(21) if k not in (6, 7, 8)]
    np.testing.assert_allclose(after[others], before[others], atol=1e-12)
    assert np.abs(oakink2.keypoints(model, flat, np.ones((1, 10)))[0] - before).max() > 1e-3


def test_errors_of_invalid_files(tmp_path: Path) -> None:
    with pytest.raises(SourceError, match="expected anno_preview"):
        convert_all(tmp_path, tmp_path / "out")
    root = oakink2_root(tmp_path / "root")
    with pytest.raises(SourceError, match="no 'mocap_frame_id_list' where the description has it"):
        convert(dumped(tmp_path / "empty.pkl", {}), tmp_path / "out.npz")
    (root / "program" / "program_info" / "scene_01++seq_a.json").unlink()
    done = subprocess.run([sys.executable, "-m", "afford.grasping.motion.oakink2_import", str(root), str(tmp_path / "out")],
                          cwd=PROJECT, capture_output=True, text=True)
    assert done.returncode == 1 and done.stderr.startswith("scene_01++seq_a.pkl: expected program/program_info/")
    (tmp_path / "only.json").write_text(json.dumps({}))
    with pytest.raises(SourceError, match=r"expected a file mano_left.npz"):
        motion_read.run(tree(tmp_path / "only.json"), motion_read.Params("oakink2"))
    np.savez(tmp_path / "mano_left.npz", **pretend_mano(seed=1) | {"weights": np.zeros((2, 2))})
    with pytest.raises(SourceError, match=r"mano_left.npz, weights: expected numbers \(778, 16\), got \(2, 2\)"):
        motion_read.run(tree(tmp_path / "mano_left.npz"), motion_read.Params("oakink2"))
