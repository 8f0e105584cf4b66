"""Exports: every format gives the masks back to the bit, where it can."""

from __future__ import annotations

import io
import json
import tarfile
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays
from PIL import Image
from pycocotools.coco import COCO
from scipy.ndimage import binary_fill_holes

from afford.dataset import export_2hands, exports, load
from afford.dataset.table_schema import MASKS
from stages.extraction import dataset_pack
from tests.helpers.made_samples import Scratch, clip

CLIPS = (clip("P01_01", 6, split="train"), clip("P01_02", 5, split="train"), clip("P02_01", 4, split="val"))
EXPORTS = (export_2hands.export, exports.export_coco, exports.export_webdataset)


@pytest.fixture(scope="module")
def root(tmp_path_factory) -> Path:
    folder = tmp_path_factory.mktemp("packed")
    dataset_pack.run(CLIPS, dataset_pack.Params(sheet_samples=1), Scratch(folder))
    return folder / "dataset"


def samples(split: str):
    return [sample for made in CLIPS if made.split == split for sample in made.samples]


def test_2hands_files_are_named_by_their_range(root, tmp_path):
    """start-end is the running index over the sorted files of a split, inclusive."""
    written = export_2hands.export(root, tmp_path)
    assert sorted(path.relative_to(tmp_path).as_posix() for path in written if path.suffix == ".h5") == [
        "train/h5/0-5_P01_01.h5", "train/h5/6-10_P01_02.h5", "val/h5/0-3_P02_01.h5"]
    assert all(path.exists() for path in written)


def test_2hands_gives_masks_without_holes_back(root, tmp_path):
    """Exact but for holes, which outer contours cannot say; words, taxonomy and picture are kept."""
    export_2hands.export(root, tmp_path)
    items = list(load.Dataset(root, "train"))
    for got, sample, item in zip(export_2hands.read(tmp_path / "train"), samples("train"), items, strict=True):
        for found, mask in zip(got["masks"], sample.masks, strict=True):
            assert np.array_equal(found, binary_fill_holes(mask))
        assert got["taxonomy"].tolist() == np.eye(4, dtype=int)[sample.taxonomy].tolist()
        assert np.array_equal(got["image"], item.image)
        assert (got["narration"], got["obj_id_left"]) == (sample.narration.text, sample.object_left)


def test_2hands_layout(root, tmp_path):
    """Names, types and order of the released files: BGR pictures, byte strings, contours with their size."""
    import h5py

    export_2hands.export(root, tmp_path)
    with h5py.File(tmp_path / "train" / "h5" / "0-5_P01_01.h5") as file:
        assert set(file["data"]) == {"inpainted", "obj_id_left", "obj_id_right", "noun", "verb", "narration", "taxonomy"}
        assert file["data/inpainted"].dtype == file["data/taxonomy"].dtype == np.uint8
        assert isinstance(file["data/narration"][0], bytes)
        assert np.array_equal(file["data/inpainted"][0][..., ::-1], load.Dataset(root, "train")[0].image)
    outlines = json.loads((tmp_path / "train" / "jsons" / "0-5_P01_01.json").read_text())
    assert list(outlines) == [str(n) for n in range(6)]
    assert outlines["0"]["original_size"] == [64, 96]
    assert outlines["0"]["aff_right"] == [] and len(outlines["0"]["aff_left"][0][0]) == 2


@given(arrays(bool, st.tuples(st.integers(1, 16), st.integers(1, 16))))
def test_contours_are_exact_but_for_holes(mask):
    """Fill(contours(mask)) is the mask with its holes filled, slivers and single pixels included."""
    filled = binary_fill_holes(mask)
    assert np.array_equal(export_2hands.fill(export_2hands.contours(mask), *mask.shape), filled)
    assert np.array_equal(export_2hands.fill(export_2hands.contours(filled), *mask.shape), filled)


def test_coco_gives_every_mask_back(root, tmp_path):
    """Read by pycocotools: each mask that is not empty, to the bit, with its area."""
    exports.export_coco(root, tmp_path)
    for split in ("train", "val"):
        read = COCO(str(tmp_path / "annotations" / f"{split}.json"))
        for number, sample in enumerate(samples(split), 1):
            found = {one["category_id"] - 1: one for one in read.imgToAnns[number]}
            assert set(found) == {n for n in range(4) if sample.masks[n].any()}
            for n, one in found.items():
                assert np.array_equal(read.annToMask(one).astype(bool), sample.masks[n])
                assert one["area"] == sample.masks[n].sum()
            path = tmp_path / "images" / read.imgs[number]["file_name"]
            assert path.read_bytes() == sample.image_jpeg.tobytes()


def test_webdataset_gives_every_mask_back(root, tmp_path):
    """Files of one sample lie side by side under one key; masks to the bit, JPEG bytes as they were."""
    exports.export_webdataset(root, tmp_path)
    with tarfile.open(tmp_path / "train-000000.tar") as tar:
        files = {member.name: tar.extractfile(member).read() for member in tar}
    assert [name.split(".")[0] for name in files] == [f"{n:09d}" for n in range(11) for _ in range(6)]
    for n, sample in enumerate(samples("train")):
        assert files[f"{n:09d}.jpg"] == sample.image_jpeg.tobytes()
        for name, mask in zip(MASKS, sample.masks, strict=True):
            assert np.array_equal(np.asarray(Image.open(io.BytesIO(files[f"{n:09d}.{name}.png"]))), mask)
        facts = json.loads(files[f"{n:09d}.json"])
        assert facts["narration"] == sample.narration.text
        assert [point is None for point in facts["motion"]["right_hand"]] == np.isnan(sample.motion[1, :, 0]).tolist()


@pytest.mark.parametrize("export", EXPORTS)
def test_an_export_is_the_same_twice(export, root, tmp_path):
    """Same data set, same bytes."""
    first, second = export(root, tmp_path / "a"), export(root, tmp_path / "b")
    assert [path.read_bytes() for path in first] == [path.read_bytes() for path in second]
    assert len(first) == len(set(first)) > 0


@pytest.mark.parametrize("export", EXPORTS)
def test_a_folder_without_a_data_set_is_refused(export, tmp_path):
    """The error states the expected files, and no file is written."""
    with pytest.raises(ValueError, match=r"expected .*\.parquet"):
        export(tmp_path, tmp_path / "out")
