"""UMD and IIT-AFF: classes become ours, the middle is cut out, and what is wrong is said."""

from __future__ import annotations

import numpy as np
import pytest
import scipy.io

from afford.readers.errors import SourceError
from schemas.interaction import AFFORDANCES, BACKGROUND
from stages import static_read
from tests.made_interactions import folder, iit_aff, umd

GRASP, CUT, HAMMER = (AFFORDANCES.index(name) for name in ("grasp", "cut", "hammer"))


def test_umd_classes(tmp_path) -> None:
    """Background, grasp, cut, scoop, contain, pound, support, wrap-grasp, in this order; depth in metres; split by tool."""
    samples = static_read.run(umd(tmp_path), static_read.Params("umd", crop_px=0))
    assert [s.name for s in samples] == ["knife_01_00000001", "knife_01_00000002"]
    first = samples[0]
    assert (first.source, first.split, first.object_type, first.K.shape) == ("umd", "train", "knife", (0, 3, 3))
    assert first.label[10, 4:28:3].tolist() == [BACKGROUND, GRASP, CUT, BACKGROUND, BACKGROUND, HAMMER, BACKGROUND, GRASP]
    assert first.depth_m.shape == (1, 24, 32) and first.depth_m[0, 0, 0] == np.float32(0.9)


def test_the_middle_is_cut_out(tmp_path) -> None:
    """Picture, depth and label alike."""
    (whole,) = static_read.run(umd(tmp_path), static_read.Params("umd", crop_px=0, every=2))
    (cut,) = static_read.run(folder(tmp_path, "umd"), static_read.Params("umd", crop_px=10, every=2))
    assert np.array_equal(cut.label, whole.label[7:17, 11:21])
    assert cut.rgb.shape == (10, 10, 3) and cut.depth_m.shape == (1, 10, 10)
    with pytest.raises(SourceError, match="300 px each way at least"):
        static_read.run(folder(tmp_path, "umd"), static_read.Params("umd"))


def test_iit_aff_classes(tmp_path) -> None:
    """Background and nine classes; the largest box names the thing; without depth there is none; val wins over train_and_val."""
    a, b = static_read.run(iit_aff(tmp_path), static_read.Params("iit-aff", crop_px=0))
    expected = [BACKGROUND, BACKGROUND, CUT, BACKGROUND, BACKGROUND, GRASP, HAMMER, HAMMER, BACKGROUND, GRASP]
    assert a.label[3, ::2].tolist() == expected
    assert (a.split, b.split, a.object_type, b.object_type) == ("train", "val", "bottle", "")
    assert a.depth_m[0, 0, 0] == 1.5 and b.depth_m.shape == (0, 20, 20)


def test_faults_of_umd(tmp_path) -> None:
    """A label that is no MATLAB file, has no gt_label, or has a class too many."""
    umd(tmp_path)
    file = tmp_path / "tools" / "knife_01" / "knife_01_00000001_label.mat"
    faults = (
        (lambda: file.write_bytes(b"x" * 200), "a MATLAB 5 file"),
        (lambda: scipy.io.savemat(file, {"other": np.zeros((2, 2), np.uint8)}), "gt_label: expected an image"),
        (lambda: scipy.io.savemat(file, {"gt_label": np.full((24, 32), 9, np.uint8)}), "labels 0 to 7, got 9 to 9"),
        (lambda: scipy.io.savemat(file, {"gt_label": np.zeros((2, 2), np.uint8)}), "32 x 24 px like the picture"),
    )
    for spoil, said in faults:
        spoil()
        with pytest.raises(SourceError, match=said):
            static_read.run(folder(tmp_path, "umd"), static_read.Params("umd", crop_px=0))
    (tmp_path / "category_split.txt").write_text("3 knife_01\n")
    with pytest.raises(SourceError, match="line 1: expected 1 or 2, then a tool"):
        static_read.run(folder(tmp_path, "umd"), static_read.Params("umd", crop_px=0))


def test_faults_of_iit_aff(tmp_path) -> None:
    """Rows of several lengths, a class too many, nothing at all."""
    iit_aff(tmp_path)
    file = tmp_path / "affordances_labels" / "a.txt"
    for text, said in (("1 2\n3\n", "rows of numbers of one length"), ("12 1\n1 1\n", "labels 0 to 9, got 1 to 12")):
        file.write_text(text)
        with pytest.raises(SourceError, match=said):
            static_read.run(folder(tmp_path, "iit"), static_read.Params("iit-aff", crop_px=0))
    (tmp_path / "empty").mkdir()
    with pytest.raises(SourceError, match=r"affordances_labels/<picture>\.txt"):
        static_read.run(folder(tmp_path / "empty", "iit"), static_read.Params("iit-aff"))
