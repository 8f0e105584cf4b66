"""Laws of sources/discover: sources are found by name, hold exactly the files they need and never leave their folder."""

from __future__ import annotations

import os
import socket
import subprocess
import sys
from pathlib import Path

import pytest

from afford.common.errors import SourceError
from afford.extraction.sources.discover import discover
from tests.helpers.tiny_root import digest, image, write_points, write_root, write_video

ROOT = Path(__file__).resolve().parents[2]
DATA = ROOT.parent / "shared" / "data"


def test_a_tree_holds_what_its_video_needs_and_nothing_of_others(tmp_path: Path) -> None:
    """Two videos share the tables; media and masks are their own."""
    write_root(tmp_path, "P95_01")
    write_root(tmp_path, "P95_02")
    names = {tree.name: [file.name for file in tree.files] for tree in discover(tmp_path, digest).videos}
    assert names["P95_02"] == [
        "EPIC_100_noun_classes_v2.csv", "EPIC_100_train.csv", "EPIC_100_verb_classes.csv",
        "GroundTruth-SparseAnnotations/annotations/train/P95_02.json", "videos/P95_02.MP4"]
    assert [name.replace("P95_01", "P95_02") for name in names["P95_01"]] == names["P95_02"]


def test_a_video_is_preferred_to_images_and_images_serve_without_it(tmp_path: Path) -> None:
    """Key-frame images beside a video are left out; alone they are the media."""
    write_root(tmp_path)
    folder = tmp_path / "rgb_frames" / "train" / "P95" / "P95_01"
    folder.mkdir(parents=True)
    (folder / "P95_01_frame_0000000001.jpg").write_bytes(b"x")
    assert not any(f.name.startswith("rgb_frames") for f in discover(tmp_path, digest).videos[0].files)
    (tmp_path / "videos" / "P95_01.MP4").unlink()
    assert any(f.name.startswith("rgb_frames") for f in discover(tmp_path, digest).videos[0].files)


def test_annotated_videos_without_media_are_listed(tmp_path: Path) -> None:
    """Missing media are no error as long as another video is present."""
    write_root(tmp_path)
    write_points(tmp_path, "P95_07", [image("P95_07", 1)])
    source = discover(tmp_path, digest)
    assert [tree.name for tree in source.videos] == ["P95_01"] and source.missing == ("P95_07",)


def test_truth_is_apart_and_its_names_are_relative_to_the_video(tmp_path: Path) -> None:
    """No file of truth/ is ever in the tree of a video."""
    write_root(tmp_path)
    (tmp_path / "truth" / "P95_01").mkdir(parents=True)
    (tmp_path / "truth" / "P95_01" / "value.json").write_text("{}")
    source = discover(tmp_path, digest)
    assert [file.name for file in source.truths["P95_01"].files] == ["value.json"]
    assert not any("truth" in file.name for tree in source.videos for file in tree.files)


def test_a_link_out_of_the_root_refuses_its_video_alone(tmp_path: Path) -> None:
    """The other video is used; the outside file is never read."""
    root = tmp_path / "root"
    write_root(root, "P95_01")
    write_root(root, "P95_02")
    video = root / "videos" / "P95_02.MP4"
    outside = video.rename(tmp_path / "outside.MP4")
    video.symlink_to(outside)
    seen: list[Path] = []
    source = discover(root, lambda path: seen.append(path) or digest(path))  # type: ignore[func-returns-value]
    assert [tree.name for tree in source.videos] == ["P95_01"]
    assert source.refused[0].video_id == "P95_02" and "a link to" in source.refused[0].reason
    assert outside not in [path.resolve() for path in seen]


def test_a_linked_folder_or_table_out_of_the_root_is_refused(tmp_path: Path) -> None:
    """A linked `videos` refuses the videos behind it; a linked table, which all share, refuses the source."""
    root = write_root(tmp_path / "root")
    (root / "videos").rename(tmp_path / "elsewhere")
    (root / "videos").symlink_to(tmp_path / "elsewhere")
    assert "videos: expected a file inside the source folder" in discover(root, digest).refused[0].reason
    (root / "EPIC_100_train.csv").rename(tmp_path / "table.csv")
    (root / "EPIC_100_train.csv").symlink_to(tmp_path / "table.csv")
    with pytest.raises(SourceError, match=r"EPIC_100_train\.csv: expected a file inside"):
        discover(root, digest)


def test_links_inside_the_root_are_followed_and_loops_end(tmp_path: Path) -> None:
    """A folder linked within the source is fine; a link to its own parent is not walked for ever."""
    root = write_root(tmp_path / "root")
    (root / "videos").rename(root / "media")
    (root / "videos").symlink_to("media")
    (root / "media" / "up").symlink_to("..")
    (root / "media" / "self").symlink_to("self")
    assert [tree.name for tree in discover(root, digest).videos] == ["P95_01"]


def test_an_unreadable_file_refuses_its_video_alone(tmp_path: Path) -> None:
    """The message of the operating system is the reason."""
    write_root(tmp_path, "P95_01")
    write_root(tmp_path, "P95_02")

    def careful(path: Path) -> str:
        if path.name == "P95_02.MP4":
            raise PermissionError(13, "Permission denied", str(path))
        return digest(path)

    source = discover(tmp_path, careful)
    assert [tree.name for tree in source.videos] == ["P95_01"] and "Permission denied" in source.refused[0].reason


def test_an_unknown_layout_is_refused_in_one_sentence(tmp_path: Path) -> None:
    """A missing path, a file, an empty folder and two videos are each refused with the expected layout."""
    with pytest.raises(SourceError, match="expected a folder, got nothing"):
        discover(tmp_path / "none", digest)
    with pytest.raises(SourceError, match="exactly one video"):
        discover(tmp_path, digest)
    write_video(tmp_path / "one.mp4", 3)
    write_video(tmp_path / "two.mp4", 3)
    with pytest.raises(SourceError, match=r"exactly one video.*got one\.mp4, two\.mp4"):
        discover(tmp_path, digest)
    (tmp_path / "masks.json").write_text("{}")
    with pytest.raises(SourceError, match=r"exactly one video.*got one\.mp4, two\.mp4"):
        discover(tmp_path, digest)


def test_a_root_without_media_is_refused(tmp_path: Path) -> None:
    """The error names the videos of an EPIC root with annotations only."""
    write_points(tmp_path, "P95_07", [image("P95_07", 1)])
    with pytest.raises(SourceError, match=r"none of P95_07; put videos/"):
        discover(tmp_path, digest)


def test_discovery_loads_nothing_heavy() -> None:
    """Discovery runs in the command itself, before planning."""
    code = "import sys, afford.extraction.sources.discover; print([m for m in ('numpy', 'cv2', 'av') if m in sys.modules])"
    assert subprocess.run([sys.executable, "-c", code], cwd=ROOT, capture_output=True, text=True, check=True).stdout == "[]\n"


@pytest.mark.skipif(not DATA.is_dir(), reason="real sample data are not here")
def test_the_real_samples_are_found() -> None:
    """Ten key-frame images and no video; two videos beside key-frame images."""
    frames = discover(DATA / "epic_P03_101", digest).videos[0]
    assert sum(file.name.endswith(".jpg") for file in frames.files) == 10
    tabletop = discover(DATA / "tabletop", digest)
    assert [tree.name for tree in tabletop.videos] == ["P90_01", "P90_02"]
    assert not any(file.name.endswith(".jpg") for tree in tabletop.videos for file in tree.files)


@pytest.mark.parametrize("kind", ["pipe", "socket"])
def test_a_named_pipe_is_refused_and_never_opened(tmp_path: Path, kind: str, monkeypatch: pytest.MonkeyPatch) -> None:
    """Reading a named pipe would block; the other video is used."""
    write_root(tmp_path, "P95_01")
    write_root(tmp_path, "P95_02")
    odd = tmp_path / "videos" / "P95_02.MP4"
    odd.unlink()
    if kind == "pipe":
        os.mkfifo(odd)
    else:
        monkeypatch.chdir(odd.parent)
        socket.socket(socket.AF_UNIX).bind(odd.name)
    source = discover(tmp_path, digest)
    assert [tree.name for tree in source.videos] == ["P95_01"]
    assert f"videos/P95_02.MP4: expected a file, got a {'named pipe' if kind == 'pipe' else kind}" in source.refused[0].reason


def test_a_pipe_as_a_table_of_all_videos_refuses_the_source(tmp_path: Path) -> None:
    """A file that all videos share cannot be skipped."""
    write_root(tmp_path)
    (tmp_path / "EPIC_100_train.csv").unlink()
    os.mkfifo(tmp_path / "EPIC_100_train.csv")
    with pytest.raises(SourceError, match=r"EPIC_100_train\.csv: expected a file, got a named pipe"):
        discover(tmp_path, digest)
