"""Frames in a tar, a zip or a large folder are read in place, and partial downloads are reported by video."""

from __future__ import annotations

import shutil
from collections.abc import Callable
from pathlib import Path

import pytest

from afford.common.errors import SourceError
from afford.common.folders import media_of
from afford.extraction.sources.discover import discover
from runner.canonical import path_digest
from schemas.files import FileTree
from schemas.video import Clip, Frames
from stages.extraction import clip_footage, frame_decode, source_read
from tests.helpers.made_epic import VIDEO, write_folder, write_tables, write_tar, write_zip
from tests.helpers.tiny_root import spelt


def tree(root: Path, video: str = VIDEO) -> FileTree:
    return next(tree for tree in discover(root, path_digest).videos if tree.name == video)


def read(root: Path) -> tuple[Clip, Frames]:
    """The only clip of a root and its frames, from its media alone."""
    files = tree(root)
    (clip,) = source_read.run(files, source_read.Params())
    footage = clip_footage.run(clip, clip_footage.Params())
    return clip, frame_decode.run(media_of(files), footage, frame_decode.Params(width_px=128, height_px=64))


def test_a_tar_of_frames_is_read_in_place(tmp_path: Path) -> None:
    """Each picture is the one of its number, at EPIC's 50 frames/s, and nothing is unpacked."""
    write_tar(write_tables(tmp_path))
    before = sorted(tmp_path.rglob("*"))
    clip, frames = read(tmp_path)
    assert clip.media[0] == "P03/rgb_frames/P03_101.tar/frame_0000000001.jpg" and clip.fps == 50
    assert [key.frame for key in clip.key_frames] == [2, 17, 32]
    assert [spelt(picture) for picture in frames.rgb] == frames.frame.tolist() == list(range(1, 41))
    assert sorted(tmp_path.rglob("*")) == before


def test_a_clip_opens_its_tar_and_reads_its_own_frames_alone(tmp_path: Path) -> None:
    """Bytes outside the clip may be overwritten, because the clip contains the index of the tar."""
    path = write_tar(write_tables(tmp_path, frames=200), frames=200)
    files = tree(tmp_path)
    (clip,) = source_read.run(files, source_read.Params())
    data = bytearray(path.read_bytes())
    end = sum(clip.spans[-1])
    assert clip.last_frame == 42 and len(clip.spans) == 42 and end < len(data) / 2
    path.write_bytes(bytes(data[:end]))
    footage = clip_footage.run(clip, clip_footage.Params())
    assert len(frame_decode.run(media_of(files), footage, frame_decode.Params()).frame) == 42


def test_visors_key_frames_are_read_out_of_their_zip(tmp_path: Path) -> None:
    """VISOR's key frames are used without other media; they have VISOR's numbers, and are never a partial download."""
    write_zip(write_tables(tmp_path))
    clip, frames = read(tmp_path)
    assert [key.frame for key in clip.key_frames] == frames.frame.tolist() == [1, 16, 31]
    assert [spelt(picture) for picture in frames.rgb] == [1, 16, 31] and clip.split == "train"
    write_tar(tmp_path)
    assert read(tmp_path)[0].media[0].startswith("P03/rgb_frames/P03_101.tar/")


def test_a_large_folder_of_frames_is_one_input(tmp_path: Path) -> None:
    """Its digest is that of names and bytes; the frames are read by name."""
    folder = write_folder(write_tables(tmp_path, frames=600))
    media = media_of(tree(tmp_path)).files
    assert [file.name for file in media] == ["P03/rgb_frames/P03_101"]
    clip, frames = read(tmp_path)
    assert [spelt(picture) for picture in frames.rgb] == [number % 7 for number in frames.frame] and clip.spans == ()
    (folder / "frame_0000000300.jpg").write_bytes((folder / "frame_0000000301.jpg").read_bytes())
    assert media_of(tree(tmp_path)).files[0].digest != media[0].digest
    (folder / "frame_0000000300.jpg").unlink()
    (folder / "frame_0000000300.jpg").symlink_to(tmp_path / "EPIC_100_train.csv")
    assert "a folder or a link" in discover(tmp_path, path_digest).refused[0].reason


def cut(path: Path, share: float) -> None:
    path.write_bytes(path.read_bytes()[: int(path.stat().st_size * share) // 512 * 512 + 100])


def hollow(path: Path) -> None:
    """Write a tar as a downloader leaves it that reserves space before the bytes arrive."""
    data = path.read_bytes()
    path.write_bytes(data[: len(data) // 2 // 512 * 512] + bytes(1 << 21))


def strip(path: Path) -> None:
    """Cut exactly between two frames, where only the end mark of a tar is missing."""
    data = path.read_bytes().rstrip(b"\0")
    path.write_bytes(data + bytes(-len(data) % 512))


def empty(root: Path) -> None:
    write_tar(root, data=b"")


def few(root: Path) -> None:
    write_tar(root, frames=99)


BROKEN: dict[str, tuple[Callable[[Path], None], str]] = {
    "cut in a frame": (lambda root: cut(write_tar(root), 0.5), r"P03_101\.tar: expected a whole archive, got a tar that was cut"),
    "cut after a frame": (lambda root: strip(write_tar(root)), r"P03_101\.tar: expected a whole archive"),
    "reserved": (lambda root: hollow(write_tar(root)), r"P03_101\.tar: expected a whole archive"),
    "last frames": (few, r"P03_101\.tar: expected frames to about 200 .*got 99 up to 99"),
    "no frame": (empty, r"frame_0000000001\.jpg: expected an image, got 0 bytes, as of 40 of 40 frames"),
    "cut zip": (lambda root: cut(write_zip(root), 0.5), r"P03_101\.zip: expected a whole archive, got a zip that was cut"),
    "no tar": (lambda root: cut(write_tar(root), 0), r"P03_101\.tar: expected a whole archive"),
}


@pytest.mark.parametrize("how", BROKEN)
def test_a_partial_download_is_refused_in_one_sentence(how: str, tmp_path: Path) -> None:
    """The error names the file, expected, got and what to do; the other video is read."""
    write_tables(tmp_path, (VIDEO, "P04_101"), frames=200)
    damage, said = BROKEN[how]
    damage(tmp_path)
    write_tar(tmp_path, "P04_101", frames=200)
    with pytest.raises(SourceError, match=said) as caught:
        source_read.run(tree(tmp_path), source_read.Params())
    assert "\n" not in str(caught.value) and str(caught.value).endswith(("again", "finish it"))
    assert source_read.run(tree(tmp_path, "P04_101"), source_read.Params())


def test_empty_images_are_counted_in_the_error(tmp_path: Path) -> None:
    """A full disk leaves empty files when frames are unpacked."""
    folder = write_folder(write_tables(tmp_path, frames=600))
    for number in (590, 600):
        (folder / f"frame_{number:010d}.jpg").write_bytes(b"")
    with pytest.raises(SourceError, match=r"frame_0000000590\.jpg: expected an image, got 0 bytes, as of 2 of 600 frames"):
        source_read.run(tree(tmp_path), source_read.Params())


def test_flow_and_other_archives_of_a_video_are_not_its_frames(tmp_path: Path) -> None:
    """EPIC-KITCHENS names the archive of the optical flow like that of the frames."""
    path = write_tar(write_tables(tmp_path))
    other = tmp_path / "P03" / "flow_frames" / path.name
    other.parent.mkdir()
    shutil.move(path, other)
    with pytest.raises(SourceError, match="none of P03_101"):
        discover(tmp_path, path_digest)


def test_other_videos_are_not_digested(tmp_path: Path) -> None:
    """No byte of other videos is read; an unknown name keeps all, so that the error can list them."""
    videos = ("P03_101", "P03_102", "P04_101")
    write_tables(tmp_path, videos)
    for video in videos:
        write_tar(tmp_path, video)
    seen: list[Path] = []

    def counted(path: Path) -> str:
        seen.append(path)
        return path_digest(path)

    assert [t.name for t in discover(tmp_path, counted, ("P03_102_s01",)).videos] == ["P03_102"]
    assert [path.name for path in seen if path.suffix == ".tar"] == ["P03_102.tar"]
    assert len(discover(tmp_path, path_digest, ("P09_01",)).videos) == 3
