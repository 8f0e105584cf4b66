"""The verb `fetch-list`: exact names and addresses, complete files omitted, partial files listed, nothing downloaded."""

from __future__ import annotations

import json
import zipfile
from pathlib import Path
from typing import Any

import pytest

from afford.extraction.sources.discover import discover
from afford.extraction.sources.downloads import SPLITS, published_files
from runner.canonical import path_digest
from tests.helpers.command import call
from tests.helpers.made_epic import write_folder, write_tables, write_tar
from tests.helpers.tiny_root import write_video

VISOR, EPIC_100, EPIC_55 = (f"https://data.bris.ac.uk/datasets/{key}" for key in (
    "2v6cgv1x04ol22qp9rm9x2j6a7", "2g1n6qdydwa9u22shpxqzp0t8m", "3h91syskeag572hl6tvuovwv4d"))  # fmt: skip


def listed(root: Path, *words: str) -> dict[str, str]:
    """Map each file name to its state."""
    result: Any = call("fetch-list", root, "--json", *words).json
    assert all(file["licence"] == "CC BY-NC 4.0" and file["bytes"] is None for file in result["files"])
    return {file["name"]: file["state"] for file in result["files"]}


@pytest.mark.parametrize(("video", "kind", "name", "url"), [
    ("P03_101", "frames", "P03/rgb_frames/P03_101.tar", f"{EPIC_100}/P03/rgb_frames/P03_101.tar"),
    ("P01_01", "frames", "P01/rgb_frames/P01_01.tar", f"{EPIC_55}/frames_rgb_flow/rgb/train/P01/P01_01.tar"),
    ("P01_14", "frames", "P01/rgb_frames/P01_14.tar", f"{EPIC_55}/frames_rgb_flow/rgb/test/P01/P01_14.tar"),
    ("P18_01", "videos", "P18/videos/P18_01.MP4", f"{EPIC_55}/videos/test/P18/P18_01.MP4"),
    ("P01_107", "sparse", "GroundTruth-SparseAnnotations/annotations/val/P01_107.json",
     f"{VISOR}/GroundTruth-SparseAnnotations/annotations/val/P01_107.json"),
    ("P01_107", "key-frames", "GroundTruth-SparseAnnotations/rgb_frames/val/P01/P01_107.zip",
     f"{VISOR}/GroundTruth-SparseAnnotations/rgb_frames/val/P01/P01_107.zip"),
    ("P14_05", "dense", "Interpolations-DenseAnnotations/train/P14_05_interpolations.zip",
     f"{VISOR}/Interpolations-DenseAnnotations/train/P14_05_interpolations.zip"),
])
def test_published_names_and_addresses(video: str, kind: str, name: str, url: str) -> None:
    """Names as on data.bris; VISOR annotates 115 and 43 videos."""
    assert [(file.name, file.url) for file in published_files([video], [kind])] == [(name, url)]
    assert [len(SPLITS[split]) for split in ("train", "val")] == [115, 43] and not set(SPLITS["train"]) & set(SPLITS["val"])


def test_a_list_that_a_downloader_reads(tmp_path: Path) -> None:
    """Each address has its file name; an empty or missing folder lacks everything; nothing is written."""
    result = call("fetch-list", tmp_path / "none", "--video", "P03_101")
    lines = [line for line in result.out.splitlines() if not line.startswith("#")]
    assert result.code == 0 and lines[-2:] == [f"{EPIC_100}/P03/rgb_frames/P03_101.tar", "  out=P03/rgb_frames/P03_101.tar"]
    assert "8 of 8 files" in result.out and "CC BY-NC 4.0" in result.out and "not published" in result.out
    assert list(tmp_path.iterdir()) == []


def test_the_list_gets_shorter_as_files_come(tmp_path: Path) -> None:
    """A complete file is omitted, a cut one is partial, and unpacked frames replace their tar. The root is then usable."""
    subset = ("--video", "P03_101", "--with", "sparse", "--with", "frames")
    tar = write_tar(write_tables(tmp_path))
    assert set(listed(tmp_path, *subset).values()) == {"there"}
    assert discover(tmp_path, path_digest).videos
    tar.write_bytes(tar.read_bytes()[:5000])
    assert listed(tmp_path, *subset)["P03/rgb_frames/P03_101.tar"] == "partial"
    tar.unlink()
    write_folder(tmp_path, frames=3)
    assert set(listed(tmp_path, *subset).values()) == {"there"}
    assert call("fetch-list", tmp_path, *subset).out.count("https://") == 0


def test_partial_files_of_each_sort(tmp_path: Path) -> None:
    """A zip without directory, a video cut short, truncated JSON, an empty file, a downloader's note."""
    words = ("--video", "P03_101", "--with", "dense", "--with", "videos", "--with", "sparse")
    dense = tmp_path / "Interpolations-DenseAnnotations" / "train" / "P03_101_interpolations.zip"
    dense.parent.mkdir(parents=True)
    with zipfile.ZipFile(dense, "w") as archive:
        archive.writestr("P03_101_interpolations.json", "{}" * 100)
    video = write_video(tmp_path / "videos" / "P03_101.MP4", 12)
    sparse = tmp_path / "P03_101.json"
    sparse.write_text('{"video_annotations": []}\n')
    assert set(listed(tmp_path, *words).values()) == {"there"}
    for path, left in ((dense, 60), (video, 500), (sparse, 20), (sparse, 0)):
        path.write_bytes(path.read_bytes()[:left])
    assert set(listed(tmp_path, *words).values()) == {"partial"}
    sparse.write_text("{}")
    sparse.with_name("P03_101.json.aria2").write_text("")
    assert listed(tmp_path, *words)["GroundTruth-SparseAnnotations/annotations/train/P03_101.json"] == "partial"


@pytest.mark.parametrize(("words", "count"), [
    ((), 6 + 2 * 158), (("--split", "val", "--with", "sparse"), 43), (("--participant", "P37", "--with", "frames"), 3),
    (("--participant", "P37", "--split", "val", "--with", "frames"), 1),
    (("--participant", "P37", "--video", "P01_01", "--with", "dense"), 4)])
def test_subsets(words: tuple[str, ...], count: int, tmp_path: Path) -> None:
    """Selection by video, person and split; all annotated videos by default."""
    assert len(listed(tmp_path, *words)) == count


@pytest.mark.parametrize(("words", "hint"), [
    (("--video", "P03_1O1"), "P03_101"), (("--participant", "P99"), "unknown participant"),
    (("--split", "test"), "Valid: train, val"), (("--with", "masks"), "Valid: dense, frames")])
def test_names_that_do_not_exist(words: tuple[str, ...], hint: str, tmp_path: Path) -> None:
    """Exit 2 with the nearest or the valid names."""
    refused = call("fetch-list", tmp_path, *words)
    assert refused.code == 2 and hint in refused.words


def test_json_has_one_line_for_programs(tmp_path: Path) -> None:
    """Root, counts by state, files."""
    result = json.loads(call("fetch-list", tmp_path, "--video", "P01_01", "--json").out)
    assert result["counts"] == {"missing": 8} and {file["kind"] for file in result["files"]} == {"tables", "sparse", "frames"}
