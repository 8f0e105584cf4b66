"""Readers of UMD and IIT-AFF: classes are mapped to ours, the middle is cropped, errors name the file."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import cv2
import numpy as np
import pytest
import scipy.io
import scipy.sparse

from afford.common.errors import SourceError
from afford.rgbd.readers import static_set
from afford.rgbd.readers.mat5 import read_matrix
from schemas.interaction import AFFORDANCES, BACKGROUND
from stages.rgbd import static_read
from tests.helpers.made_interactions import folder, iit_aff, umd

GRASP, CUT, HAMMER = (AFFORDANCES.index(name) for name in ("grasp", "cut", "hammer"))


def test_umd_classes(tmp_path) -> None:
    """Background, grasp, cut, scoop, contain, pound, support, wrap-grasp, in this order; depth in metres; split by tool."""
    samples = static_read.run(umd(tmp_path), static_read.Params("umd", crop_px=0)).samples
    assert [s.name for s in samples] == ["knife_01_00000001", "knife_01_00000002"]
    first = samples[0]
    assert (first.source, first.split, first.object_type, first.K.shape) == ("umd", "train", "knife", (0, 3, 3))
    assert first.label[10, 4:28:3].tolist() == [BACKGROUND, GRASP, CUT, BACKGROUND, BACKGROUND, HAMMER, BACKGROUND, GRASP]
    assert first.depth_m.shape == (1, 24, 32) and first.depth_m[0, 0, 0] == np.float32(0.9)


def test_the_middle_is_cut_out(tmp_path) -> None:
    """Picture, depth and label alike."""
    (whole,) = static_read.run(umd(tmp_path), static_read.Params("umd", crop_px=0, every=2)).samples
    (cut,) = static_read.run(folder(tmp_path, "umd"), static_read.Params("umd", crop_px=10, every=2)).samples
    assert np.array_equal(cut.label, whole.label[7:17, 11:21])
    assert cut.rgb.shape == (10, 10, 3) and cut.depth_m.shape == (1, 10, 10)
    assert sum(getattr(cut, name).nbytes for name in ("rgb", "depth_m", "label")) == 8 * 10 * 10


def test_iit_aff_classes(tmp_path) -> None:
    """Background and nine classes; the largest box names the thing; without depth there is none; val wins over train_and_val."""
    a, b = static_read.run(iit_aff(tmp_path), static_read.Params("iit-aff", crop_px=0)).samples
    expected = [BACKGROUND, BACKGROUND, CUT, BACKGROUND, BACKGROUND, GRASP, HAMMER, HAMMER, BACKGROUND, GRASP]
    assert a.label[3, ::2].tolist() == expected
    assert (a.split, b.split, a.object_type, b.object_type) == ("train", "val", "bottle", "")
    assert a.depth_m[0, 0, 0] == 1.5 and b.depth_m.shape == (0, 20, 20)


def test_small_pictures_give_their_largest_square(tmp_path) -> None:
    """The square is not enlarged; a large picture is cropped as usual."""
    iit_aff(tmp_path)
    wide = cv2.imread(str(tmp_path / "rgb" / "b.jpg"))[:9]
    cv2.imwrite(str(tmp_path / "rgb" / "b.jpg"), wide)
    rows = (tmp_path / "affordances_labels" / "b.txt").read_text().splitlines()[:9]
    (tmp_path / "affordances_labels" / "b.txt").write_text("\n".join(rows))
    found = static_read.run(folder(tmp_path, "iit"), static_read.Params("iit-aff", crop_px=12))
    a, b = found.samples
    assert (a.rgb.shape, b.rgb.shape, b.label.shape, found.refused) == ((12, 12, 3), (9, 9, 3), (9, 9), ())
    assert np.array_equal(b.label[0], a.label[0, 1:10])


def test_pictures_of_other_splits_are_not_decoded(tmp_path, monkeypatch) -> None:
    """IIT-AFF with a (train) and b (val): one of them; an unknown split lists the known ones."""
    made, opened = iit_aff(tmp_path), []
    decode = static_set.decode_picture
    reader = "afford.rgbd.readers.iit_aff.decode_picture"
    monkeypatch.setattr(reader, lambda file, *how: opened.append(file.name) or decode(file, *how))
    found = static_read.run(made, static_read.Params("iit-aff", crop_px=0, split="val"))
    assert [one.name for one in found.samples] == ["b"] and opened == ["rgb/b.jpg"]
    with pytest.raises(SourceError, match=r"iit, static_read.split: expected a split that the root has \(train, val\), got 'test'"):
        static_read.run(made, static_read.Params("iit-aff", split="test"))


@pytest.mark.parametrize("source", ["umd", "iit-aff"])
def test_one_bad_picture_stops_no_other(source: str, tmp_path) -> None:
    """The error is reported; the others are unchanged. A set without any readable picture is an error."""
    files, params = (umd if source == "umd" else iit_aff)(tmp_path), static_read.Params(source, crop_px=0)
    whole = static_read.run(files, params)
    first, second = sorted(tmp_path.rglob("*.jpg"))
    first.write_bytes(first.read_bytes()[:20])
    found = static_read.run(folder(tmp_path, files.name), params)
    (said,) = found.refused
    assert said.startswith(f"{first.relative_to(tmp_path)}: expected a picture, got 20 bytes") and "\n" not in said
    (left,) = found.samples
    assert left.name == whole.samples[1].name and np.array_equal(left.label, whole.samples[1].label)
    second.write_bytes(b"")
    with pytest.raises(SourceError, match=r"one picture at least that can be read, got 2 unreadable ones; the first: .*20 bytes"):
        static_read.run(folder(tmp_path, files.name), params)


@pytest.mark.parametrize("packed", [False, True])
def test_a_label_that_was_cut_short_is_a_fault_of_that_picture(packed: bool, tmp_path) -> None:
    """Wherever it was cut."""
    files = umd(tmp_path)
    file = tmp_path / "tools" / "knife_01" / "knife_01_00000001_label.mat"
    scipy.io.savemat(file, {"gt_label": np.zeros((24, 32), np.uint8)}, do_compression=packed)
    data = file.read_bytes()
    for length in range(0, len(data) - 1, 41):
        file.write_bytes(data[:length])
        found = static_read.run(files, static_read.Params("umd", crop_px=0))
        assert [one.name for one in found.samples] == ["knife_01_00000002"] and "label.mat" in found.refused[0], length


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
        assert said in static_read.run(folder(tmp_path, "umd"), static_read.Params("umd", crop_px=0)).refused[0]
    (tmp_path / "category_split.txt").write_text("3 knife_01\n")
    with pytest.raises(SourceError, match="line 1: expected 1 or 2, then a tool"):
        static_read.run(folder(tmp_path, "umd"), static_read.Params("umd", crop_px=0))


@pytest.mark.parametrize("packed", [False, True])
@pytest.mark.parametrize("dtype", ["u1", "i1", "u2", "i2", "i4", "u4", "f4", "f8"])
def test_a_matrix_is_read_as_scipy_reads_it(dtype: str, packed: bool, tmp_path) -> None:
    """Among other variables, of any size."""
    for shape in ((3, 5), (1, 1), (40, 60), (2, 3, 4), (0, 0)):
        label = np.random.default_rng(0).integers(0, 9, shape).astype(dtype)
        more = {"a": np.arange(5.0), "gt_label": label, "words": "text", "cell": {"x": 1}, "a_long_name_here": 3}
        scipy.io.savemat(tmp_path / "a.mat", more, do_compression=packed)
        found = read_matrix((tmp_path / "a.mat").read_bytes(), "gt_label", "a.mat")
        wanted = scipy.io.loadmat(tmp_path / "a.mat")["gt_label"]
        assert found is not None and found.dtype == wanted.dtype and np.array_equal(found, wanted)
    assert read_matrix((tmp_path / "a.mat").read_bytes(), "other", "a.mat") is None
    for more in ({"gt_label": "text"}, {"gt_label": np.array([1j])}, {"gt_label": scipy.sparse.eye(3)}):
        scipy.io.savemat(tmp_path / "a.mat", more, do_compression=packed)
        with pytest.raises(SourceError, match=r"a\.mat: expected a MATLAB 5 file"):
            read_matrix((tmp_path / "a.mat").read_bytes(), "gt_label", "a.mat")


@pytest.mark.parametrize(("backend", "write", "name"), [("umd", umd, "category_split.txt"), ("iit-aff", iit_aff, "val.txt")])
def test_a_split_that_is_no_text_is_named(backend: str, write: Callable[[Path], object], name: str, tmp_path) -> None:
    """Byte and file."""
    write(tmp_path)
    (tmp_path / name).write_bytes(b"1 knife\xff\n")
    with pytest.raises(SourceError, match=rf"{name}: expected text in UTF-8, got byte 7 that is not"):
        static_read.run(folder(tmp_path, backend), static_read.Params(backend))


def test_faults_of_iit_aff(tmp_path) -> None:
    """Rows of several lengths, a class too many, nothing at all."""
    iit_aff(tmp_path)
    file = tmp_path / "affordances_labels" / "a.txt"
    for text, said in (("1 2\n3\n", "rows of numbers of one length"), ("12 1\n1 1\n", "labels 0 to 9, got 1 to 12")):
        file.write_text(text)
        assert said in static_read.run(folder(tmp_path, "iit"), static_read.Params("iit-aff", crop_px=0)).refused[0]
    (tmp_path / "empty").mkdir()
    with pytest.raises(SourceError, match=r"affordances_labels/<picture>\.txt"):
        static_read.run(folder(tmp_path / "empty", "iit"), static_read.Params("iit-aff"))
