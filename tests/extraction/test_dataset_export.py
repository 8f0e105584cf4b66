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
from pycocotools import mask as coco_mask
from pycocotools.coco import COCO
from scipy.ndimage import binary_fill_holes

from afford.common.image_files import decode_image
from afford.dataset import export_2hands, exports, load, metadata
from afford.dataset.table_schema import MASKS
from commands.session import open_runner
from stages.extraction import dataset_pack
from tests.helpers.command import Made, call
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
    videos = [tmp_path / "train" / "h5" / name for name in ("0-5_P01_01.h5", "6-10_P01_02.h5")]
    outlines = [json.loads((tmp_path / "train" / "jsons" / f"{h5.stem}.json").read_text()) for h5 in videos]
    read = (export_2hands.read_sample(h5, int(n), one)
            for h5, rows in zip(videos, outlines, strict=True) for n, one in rows.items())
    for got, sample, item in zip(read, samples("train"), items, strict=True):
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


@pytest.mark.parametrize("export", EXPORTS)
def test_an_export_states_licence_and_citation(export, root, tmp_path):
    """README.md has the name, the licence with its note, and the works to cite; it is among the returned files."""
    assert tmp_path / "README.md" in export(root, tmp_path)
    text = (tmp_path / "README.md").read_text()
    for part in ("# afford-2hands\n", "`cc-by-nc-4.0`. " + metadata.LICENCE_NOTES["cc-by-nc-4.0"], "Format: ",
                 "2HandedAfforder (2025); VISOR (2022); EPIC-KITCHENS-100 (2022)"):
        assert part in text


def test_citation_follows_the_licence(tmp_path):
    """Data cite EPIC-KITCHENS and VISOR only under EPIC's licence; Croissant and exports cite the same."""
    params = dataset_pack.Params(sheet_samples=1, license="apache-2.0")
    dataset_pack.run((clip("room", 3, split="train"),), params, Scratch(tmp_path))
    assert json.loads((tmp_path / "dataset" / "croissant.json").read_text())["citeAs"] == "2HandedAfforder (2025)"
    exports.export_coco(tmp_path / "dataset", tmp_path / "out")
    assert (tmp_path / "out" / "README.md").read_text().endswith("## Citation\n\n2HandedAfforder (2025)\n")
    assert json.loads((tmp_path / "out" / "annotations" / "train.json").read_text())["licenses"] == [
        {"id": 1, "name": "apache-2.0", "url": "https://spdx.org/licenses/Apache-2.0"}]


def test_coco_has_info_and_licence(root, tmp_path, capsys):
    """`COCO.info()` prints the description; every image refers to the one licence."""
    exports.export_coco(root, tmp_path)
    read = COCO(str(tmp_path / "annotations" / "train.json"))
    read.info()
    assert "description: afford-2hands" in (printed := capsys.readouterr().out) and "version: 1.0.0" in printed
    assert [licence["id"] for licence in read.dataset["licenses"]] == [1]
    assert {image["license"] for image in read.imgs.values()} == {1}


def test_coco_polygons_cover_the_masks_without_holes(root, tmp_path):
    """Decoded by pycocotools, IoU with the filled mask is at least 0.95; area is that of the exact mask."""
    exports.export_coco(root, tmp_path, polygons=True)
    read = COCO(str(tmp_path / "annotations" / "train.json"))
    for number, sample in enumerate(samples("train"), 1):
        for one in read.imgToAnns[number]:
            mask = sample.masks[one["category_id"] - 1]
            found, filled = read.annToMask(one).astype(bool), binary_fill_holes(mask)
            assert isinstance(one["segmentation"], list) and one["area"] == mask.sum()
            assert (found & filled).sum() >= 0.95 * (found | filled).sum()


@given(arrays(bool, st.tuples(st.integers(1, 16), st.integers(1, 16))).filter(np.any))
def test_polygons_follow_pixel_borders(mask):
    """Decoded polygons are the mask with its holes filled, single pixels and pixels that touch at a corner included."""
    parts = coco_mask.frPyObjects(exports.trace_polygons(mask), *mask.shape)
    assert np.array_equal(coco_mask.decode(coco_mask.merge(parts)).astype(bool), binary_fill_holes(mask))


@pytest.mark.parametrize(("format", "option"), [("2hands", "--polygons"), ("webdataset", "--polygons"), ("epic", "--polygons"),
                                                ("2hands", "--original-frames"), ("epic", "--original-frames")])
def test_an_option_of_another_format_is_a_usage_error(format, option, tmp_path):
    """Exit 2, one sentence, and no file is written."""
    refused = call("export", format, tmp_path / "out", option, "--store", tmp_path / "store")
    assert refused.code == 2 and refused.err.startswith(f"error: {option}: only for") and refused.err.count("\n") == 1
    assert not list(tmp_path.iterdir())


def test_original_frames_have_hands(made: Made, tmp_path: Path):
    """Both formats give the same JPEG; it equals the image outside the hands, and differs from it inside."""
    assert made.ask("export", "coco", tmp_path / "coco", "--original-frames").code == 0
    assert made.ask("export", "webdataset", tmp_path / "tars", "--original-frames").code == 0
    originals = {}
    for path in sorted((tmp_path / "tars").glob("*.tar")):
        with tarfile.open(path) as tar:
            files = {member.name: tar.extractfile(member).read() for member in tar}
        originals |= {json.loads(files[name])["sample_id"]: files[name.replace(".json", ".original.jpg")]
                      for name in files if name.endswith(".json")}  # fmt: skip
    lists = (tmp_path / "coco" / "annotations").glob("*.json")
    images = [image for path in lists for image in json.loads(path.read_text())["images"]]
    assert len(images) == len(originals) > 0
    for image in images:
        data = (tmp_path / "coco" / "originals" / image["original_file_name"]).read_bytes()
        assert data == originals[image["sample_id"]]
        original = decode_image(data, "original").astype(int)
        change = np.abs(original - decode_image((tmp_path / "coco" / "images" / image["file_name"]).read_bytes(), "image"))
        assert original.shape[:2] == (image["height"], image["width"])
        assert np.median(change) <= 2 and change.max() > 20


@pytest.mark.parametrize("lost", ["record", "bytes"])
def test_lost_original_frames_are_one_sentence(lost: str, made: Made, tmp_path: Path):
    """Exit 1, and the folder is left empty, so that the export can be repeated."""
    mine = made.copy(tmp_path)
    runner = open_runner(mine.store)
    for trace in [trace for trace in runner.traces.all() if trace.stage == "sample_assemble"]:
        if lost == "record":
            runner.traces.forget(trace.key)
        else:
            for path in runner.unverified_files(trace.inputs["frames"]).values():
                path.unlink(missing_ok=True)
    out = tmp_path / "out"
    refused = mine.ask("export", "coco", out, "--original-frames")
    assert refused.code == 1 and refused.err.count("\n") == 1 and "original frames of samples" in refused.err
    assert not list(out.iterdir())
    assert mine.ask("export", "coco", out).code == 0


def test_a_damaged_data_set_is_one_sentence(made: Made, tmp_path: Path):
    """Exit 1 names the damaged file, and the folder is left empty."""
    mine = made.copy(tmp_path)
    (card := mine.store / "datasets" / mine.source.name / "README.md").unlink()
    card.write_text("no header\n")
    refused = mine.ask("export", "coco", tmp_path / "out")
    assert refused.code == 1 and refused.err.startswith(f"error: {card}: expected pretty_name") and refused.err.count("\n") == 1
    assert not list((tmp_path / "out").iterdir())
