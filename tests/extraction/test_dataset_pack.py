"""dataset_pack: files of the data set on disk."""

from __future__ import annotations

import hashlib
import json
import os
import re
import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pyarrow.parquet as pq
import pytest

from afford.codecs.kinds import digest
from afford.dataset import load, masks, metadata, table_schema
from afford.dataset.metadata import licence_of
from afford.dataset.packing import SplitRule, assign_splits
from afford.dataset.table_schema import collect_classes
from maps.extraction import licensed
from maps.settings import Origin
from schemas.scene import SceneSpec
from stages.extraction import dataset_pack
from tests.helpers.made_samples import Scratch, clip

ROOT = Path(__file__).resolve().parents[2]
CLIPS = tuple(clip(f"P{n:02d}_01", 9, split=("train", "train", "val")[n]) for n in range(3))


def pack(folder: Path, clips=CLIPS, **params):
    scratch = Scratch(folder)
    tree = dataset_pack.run(clips, dataset_pack.Params(**params), scratch)
    return tree, folder / "dataset", scratch


STRANGE = "höhle die 🥑 aus — 切る " * 2000
SAMPLE = CLIPS[0].samples[0]
STRANGE_SAMPLE = replace(SAMPLE, sample_id="P00_02_0000000001", narration=replace(
    SAMPLE.narration, text=STRANGE, verb_key="höhlen", verb="höhlen", verb_class=-1))  # fmt: skip
UNUSUAL = (
    replace(CLIPS[0], clip_id="a", samples=CLIPS[0].samples[:3]), replace(CLIPS[0], clip_id="b", samples=CLIPS[0].samples[2:]),
    replace(CLIPS[0], clip_id="c", video_id="P00_02", split="val", samples=(STRANGE_SAMPLE,)))  # fmt: skip


@pytest.fixture(scope="module")
def packing(tmp_path_factory):
    return pack(tmp_path_factory.mktemp("packed"), samples_per_shard=7)


@pytest.fixture(scope="module")
def packed(packing) -> Path:
    return packing[1]


@pytest.fixture(scope="module")
def unusual(tmp_path_factory) -> Path:
    """A data set of a video cut into two clips, and of one with unusual text, under a licence of its own."""
    return pack(tmp_path_factory.mktemp("unusual"), UNUSUAL, license="apache-2.0")[1]


def samples_of(split: str):
    return [(made, sample) for made in CLIPS if made.split == split for sample in made.samples]


def test_samples_are_written_once_in_order(packed):
    """Rows are the samples of a split, by video and frame; all shards except the last are full."""
    for split, shards in (("train", 3), ("val", 2)):
        paths = load.shards(packed, split)
        assert [path.name for path in paths] == [f"{split}-{k:05d}-of-{shards:05d}.parquet" for k in range(shards)]
        ids = [row["sample_id"] for row in load.rows(packed, split, ["sample_id"])]
        assert ids == [sample.sample_id for _, sample in samples_of(split)]


def test_datasets_reads_the_shards(packed, tmp_path):
    """`load_dataset("parquet")` decodes pictures and classes without our code; masks are bit-exact."""
    datasets = pytest.importorskip("datasets")
    files = {split: [str(path) for path in load.shards(packed, split)] for split in ("train", "val")}
    read = datasets.load_dataset("parquet", data_files=files, cache_dir=str(tmp_path))
    for split in ("train", "val"):
        for row, (made, sample) in zip(read[split], samples_of(split), strict=True):
            for name, mask in zip(table_schema.MASKS, sample.masks, strict=True):
                assert np.array_equal(np.asarray(row[name]), mask)
            assert row["image"].size == (made.width_px, made.height_px)
            assert row["narration"] == sample.narration.text
    features = read["train"].features
    assert features["taxonomy"].names == ["left", "right", "both_same", "both_different"]
    assert features["verb_class"].int2str(read["train"][2]["verb_class"]) == "solder"
    assert features["image"].dtype == "PIL.Image.Image"


def test_datasets_reads_the_folder(packed, tmp_path):
    """The header of the card maps files to splits for `load_dataset(folder)`."""
    datasets = pytest.importorskip("datasets")
    read = datasets.load_dataset(str(packed), cache_dir=str(tmp_path))
    assert {name: len(rows) for name, rows in read.items()} == {"train": 18, "val": 9}


def test_run_lengths_boxes_and_areas_agree_with_the_masks(packed):
    """Run lengths, boxes and areas of a mask agree with its picture."""
    for row, (_, sample) in zip(load.rows(packed, "train", [column.name for column in table_schema.FIXED]), samples_of("train"),
                                strict=True):
        for name, mask in zip(table_schema.MASKS, sample.masks, strict=True):
            assert np.array_equal(masks.decode_rle([row[f"{name}_rle"]], *mask.shape)[0], mask)
            assert row[f"{name}_area"] == mask.sum()
            ys, xs = np.nonzero(mask)
            box = [xs.min(), ys.min(), np.ptp(xs) + 1, np.ptp(ys) + 1] if xs.size else [0, 0, 0, 0]
            assert row[f"{name}_bbox"] == box


def test_layout_of_the_shards(packed):
    """Shards have small row groups, a page index, and zstd for all columns except the JPEGs."""
    file = pq.ParquetFile(load.shards(packed, "train")[0])
    group = file.metadata.row_group(0)
    assert group.num_rows <= 100
    leaves = {group.column(n).path_in_schema: group.column(n) for n in range(group.num_columns)}
    assert all(leaf.has_offset_index and leaf.has_column_index for leaf in leaves.values())
    assert {name for name, leaf in leaves.items() if leaf.compression != "ZSTD"} == {"image.bytes"}


def test_same_input_same_bytes(packed, tmp_path):
    """Bytes depend on neither the order of clips, nor files of a killed run, nor the hash seed of the process."""
    code = ("import sys; from pathlib import Path; import cv2; cv2.ipp.setUseIPP(False); "
            "from tests.extraction.test_dataset_pack import CLIPS, pack; "
            "print(pack(Path(sys.argv[1]), CLIPS[::-1], samples_per_shard=7)[1])")
    (tmp_path / "dataset").mkdir()
    (tmp_path / "dataset" / "left_over").write_text("x")
    done = subprocess.run([sys.executable, "-c", code, tmp_path], cwd=ROOT, env=os.environ | {"PYTHONHASHSEED": "77"}, check=True,
                          capture_output=True, text=True)
    second = Path(done.stdout.strip())
    assert (second / "manifest.json").read_bytes() == (packed / "manifest.json").read_bytes()
    assert not (second / "left_over").exists()


def test_manifest_names_every_file(packed):
    """The manifest lists size and sha256 of every other file."""
    listed = json.loads((packed / "manifest.json").read_text())["files"]
    present = {path.relative_to(packed).as_posix() for path in packed.rglob("*") if path.is_file()}
    assert set(listed) == present - {"manifest.json"}
    for name, entry in listed.items():
        data = (packed / name).read_bytes()
        assert (len(data), hashlib.sha256(data).hexdigest()) == (entry["bytes"], entry["sha256"])


def test_statistics(packed):
    """Statistics contain totals next to the published ones, classes outside EPIC, and reasons for frames without samples."""
    numbers = json.loads((packed / "statistics.json").read_text())
    assert numbers["totals"]["samples"] == {"here": 27, "published_2hands": 278000}
    assert numbers["splits"] == {"train": 18, "val": 9}
    assert [entry["key"] for entry in numbers["verbs"]] == ["take", "open", "cut", "solder"]
    assert [entry["epic_id"] for entry in numbers["verbs"]] == [0, 3, 7, -1]
    assert sum(numbers["taxonomy"].values()) == sum(numbers["taxonomy3"].values()) == 27
    assert numbers["frames_without_sample"] == {"no_contact": 9, "too_small": 3}
    plots = {path.name for path in (packed / "plots").iterdir()}
    assert plots == {"areas.png", "classes.png", "hand_positions.png", "taxonomy.png"}


def test_croissant_lists_columns_and_shards(packed):
    """Columns are fields; shards are listed with their sha256."""
    described = json.loads((packed / "croissant.json").read_text())
    names = pq.ParquetFile(load.shards(packed, "train")[0]).schema_arrow.names
    assert {field["source"]["extract"]["column"] for field in described["recordSet"][0]["field"]} == set(names)
    shards = {file["contentUrl"]: file["sha256"] for file in described["distribution"] if file["@type"] == "cr:FileObject"}
    assert shards == {path.relative_to(packed).as_posix(): hashlib.sha256(path.read_bytes()).hexdigest()
                      for split in ("train", "val") for path in load.shards(packed, split)}


def test_croissant_is_valid(packed):
    """mlcroissant reports no error, and reads every sample (only where it is installed)."""
    mlcroissant = pytest.importorskip("mlcroissant")
    described = mlcroissant.Dataset(str(packed / "croissant.json"))
    assert not described.metadata.ctx.issues.errors
    assert sum(1 for _ in described.records("samples")) == 27


def test_provenance_is_the_digest_of_the_clips_samples(packed):
    """Provenance equals the content digest of the input in the store."""
    wanted = {made.clip_id: digest(made) for made in CLIPS}
    for split in ("train", "val"):
        assert all(row["provenance"] == wanted[row["clip"]] for row in load.rows(packed, split, ["clip", "provenance"]))


def test_an_empty_data_set_is_refused(tmp_path):
    """The error lists the reasons of all clips."""
    empty = tuple(replace(made, samples=()) for made in CLIPS)
    with pytest.raises(ValueError, match=r"no clip gives a sample.*no_contact 9, too_small 3"):
        pack(tmp_path, empty)


def test_a_repeated_sample_id_is_refused(tmp_path):
    """Two clips over the same frames would leak between splits and count twice."""
    with pytest.raises(ValueError, match="sample_id 'P00_01_0000000001': expected once, found 2"):
        pack(tmp_path, (CLIPS[0], replace(CLIPS[0], clip_id="again")))


def test_the_key_frame_at_a_cut_gives_its_samples_once(unusual):
    """Two clips of a cut video share one frame; the data set contains it once."""
    assert [row["frame"] for row in load.rows(unusual, "train", ["frame"])] == [sample.frame for sample in CLIPS[0].samples]


def test_unusual_text_is_kept(unusual):
    """Unicode and a very long narration are unchanged, and the pictures and the card are written."""
    assert next(load.rows(unusual, "val", ["narration"]))["narration"] == STRANGE


def test_progress_reaches_the_end(packing):
    """The last report of progress covers all samples."""
    assert packing[2].said[-1] == (27, 27)


def test_a_participant_is_in_one_split():
    """Splits by participant keep the videos of a participant together for any seed."""
    clips = [clip(f"P{n % 5:02d}_{n:02d}", 1) for n in range(20)]
    for seed in range(10):
        rule = SplitRule("participant", 0.3, 0.3, seed)
        split = assign_splits(clips, rule)
        assert len({(made.participant_id, split[made.video_id]) for made in clips}) == 5
        assert "train" in split.values()


def test_a_video_keeps_its_split_when_videos_are_added():
    """The split by hash depends on each video alone."""
    clips = [clip(f"P01_{n:02d}", 1) for n in range(40)]
    rule = SplitRule("video", 0.2, 0.2, 7)
    few, many = assign_splits(clips[:20], rule), assign_splits(clips, rule)
    assert few == {video: many[video] for video in few}
    assert set(many.values()) == {"train", "val", "test"}


def test_a_complete_split_of_the_source_has_priority():
    """A split of the source for all videos is used; for some videos only, the hash decides for all."""
    rule = SplitRule("video", 0.0, 0.0, 0)
    assert assign_splits(CLIPS, rule) == {"P00_01": "train", "P01_01": "train", "P02_01": "val"}
    assert set(assign_splits([replace(CLIPS[0], split=""), *CLIPS[1:]], rule).values()) == {"train"}


def test_contradictory_splits_are_refused():
    """A video in two splits is an error of the source."""
    with pytest.raises(ValueError, match="P00_01: its clips are in the splits"):
        assign_splits([CLIPS[0], replace(CLIPS[0], clip_id="b", split="val")], SplitRule("video", 0.1, 0.1, 0))


@pytest.mark.parametrize("wrong", [("clip", 0.1, 0.1), ("video", 0.6, 0.6), ("video", -0.1, 0.1)])
def test_wrong_split_rules_are_refused(wrong):
    """Unknown units and fractions out of range are refused."""
    with pytest.raises(ValueError, match="expected"):
        SplitRule(*wrong, seed=0)


def test_classes_are_sorted_by_epic_id_then_new_ones():
    """The order of the samples does not matter."""
    seen = [("wire", -1), ("jar", 34), ("mug", 13), ("anvil", -1), ("jar", 34)]
    assert collect_classes(seen) == collect_classes(seen[::-1])
    assert collect_classes(seen).keys == ("mug", "jar", "anvil", "wire")


def test_the_guide_lists_the_columns():
    """The table in docs/extraction/dataset.md equals that of the card."""
    guide = (ROOT / "docs" / "extraction" / "dataset.md").read_text(encoding="utf-8")
    assert metadata.column_table(table_schema.FIXED) in guide
    assert re.search(r"`verb_class`.*`noun_class`", guide, re.DOTALL)


@pytest.mark.parametrize(("videos", "stated", "licence"), [
    (["P91_01", "P03_101"], "", "cc-by-nc-4.0"), (["P03_101"], "cc-by-nc-4.0", "cc-by-nc-4.0"), (["tabletop"], "", "other"),
    (["P91_01"], "", "other"), (["P91_01"], "apache-2.0", "apache-2.0")])  # fmt: skip
def test_licence_of_videos(videos, stated, licence):
    """EPIC's videos are under EPIC's licence; the licence of unknown videos is `other`."""
    assert licence_of(videos, stated) == licence


def test_another_licence_of_epic_videos_is_refused(tmp_path):
    """The message names the video."""
    with pytest.raises(ValueError, match=r"license: expected cc-by-nc-4\.0, because P01_01 is of EPIC-KITCHENS, got 'mit'"):
        pack(tmp_path, license="mit")


def test_licence_of_rendered_clips(unusual):
    """Rendered clips are packed under apache-2.0, unless the user sets another licence; other clips are not."""
    spec = SceneSpec("P91_01", "carry", "kitchen", seed=3)
    rendered, read = Origin("synthetic", specs=(spec,)), Origin("own")
    assert licensed(dataset_pack.Params(), rendered).license == "apache-2.0"
    assert licensed(dataset_pack.Params(license="cc0-1.0"), rendered).license == "cc0-1.0"
    assert licensed(dataset_pack.Params(), read).license == ""
    header = (unusual / "README.md").read_text().split("---")[1]
    assert "license: apache-2.0\n" in header
