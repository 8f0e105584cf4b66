"""Videos: frames are identified by time and upright, in any container."""

from __future__ import annotations

from fractions import Fraction
from pathlib import Path

import numpy as np
import pytest

from afford.common.errors import SourceError
from afford.common.video.frames import decode_video, fit
from afford.common.video.probe import epic_rate, parse_frame_number, probe, resampled_frames
from tests.helpers.tiny_root import HEIGHT, WIDTH, spelt, write_video

BOX = (456, 256)


@pytest.mark.parametrize(("name", "codec"), [
    ("a.mp4", "libx264"), ("a.mkv", "libx264"), ("a.avi", "mpeg4"), ("a.webm", "libvpx-vp9"), ("a.mpg", "mpeg2video")])
def test_frame_n_is_the_nth_image_of_the_file(tmp_path: Path, name: str, codec: str) -> None:
    """Check a range in the middle, with reordered frames."""
    path = write_video(tmp_path / name, 60, codec=codec)
    number, time_ns, rgb = decode_video(path, 20, 41, None, BOX)
    assert number.tolist() == list(range(20, 42))
    assert [spelt(image) for image in rgb] == number.tolist()
    assert np.abs(time_ns - (number - 1) / 30 * 1e9).max() < 1e6


def test_variable_frame_rate_keeps_numbers_and_times(tmp_path: Path) -> None:
    """Check numbers and times of a file with uneven times."""
    ticks = np.cumsum([0, *([20, 20, 20, 60] * 10)][:40]).tolist()
    path = write_video(tmp_path / "v.mp4", 40, ticks=ticks)
    number, time_ns, rgb = decode_video(path, 5, 30, None, BOX)
    assert [spelt(image) for image in rgb] == number.tolist() == list(range(5, 31))
    assert np.allclose(time_ns / 1e9, np.array(ticks)[4:30] / 600, atol=1e-3)


def test_resampling_shows_the_nearest_image(tmp_path: Path) -> None:
    """Check a file of 30 frames/s numbered at 60."""
    path = write_video(tmp_path / "r.mp4", 30)
    number, time_ns, rgb = decode_video(path, 1, 60, 60.0, BOX)
    assert number.tolist() == list(range(1, 61))
    assert [spelt(image) for image in rgb] == [(n + 1) // 2 for n in number]
    assert time_ns[6] == 100_000_000


def test_resampling_ntsc_video_repeats_one_picture_in_a_thousand() -> None:
    """Check 59.94 frames/s numbered at 60: one image in about 1000 is repeated, none is lost."""
    source = resampled_frames(np.arange(5000) * 1001 / 60000, 60.0)
    assert (np.diff(source) >= 0).all() and set(source.tolist()) == set(range(5000))
    assert len(source) - 5000 == 5


def test_rotated_video_is_upright(tmp_path: Path) -> None:
    """Check the display matrix of a phone."""
    path = write_video(tmp_path / "t.mp4", 20, turned=1)
    number, _, rgb = decode_video(path, 3, 9, None, BOX)
    assert rgb.shape[1:3] == (HEIGHT, WIDTH)
    assert [spelt(image) for image in rgb] == number.tolist()


@pytest.mark.parametrize("name", ["a.mkv", "a.mp4", "a.avi"])
def test_truncated_file_keeps_its_frames(tmp_path: Path, name: str) -> None:
    """Check a file cut at 60 %: it is reported as truncated, and its frames keep their numbers."""
    path = write_video(tmp_path / name, 80, codec="mpeg4" if name == "a.avi" else "libx264", front=name == "a.mp4")
    data = path.read_bytes()
    path.write_bytes(data[: len(data) * 6 // 10])
    number, _, rgb = decode_video(path, 1, 80, None, BOX)
    assert probe(path).truncated and 5 < len(number) < 80
    assert [spelt(image) for image in rgb] == number.tolist()


def test_damaged_frames_keep_the_numbers_of_others(tmp_path: Path) -> None:
    """Check bytes overwritten in the middle."""
    path = write_video(tmp_path / "d.mp4", 80)
    data = bytearray(path.read_bytes())
    at = data.index(b"mdat") + (data.index(b"moov") - data.index(b"mdat")) // 2
    data[at : at + 200] = bytes(200)
    path.write_bytes(bytes(data))
    number, _, rgb = decode_video(path, 1, 80, None, BOX)
    assert {1, 2, 3, 79, 80} <= set(number.tolist())
    assert sum(spelt(image) == n for image, n in zip(rgb, number, strict=True)) > 60


def test_intact_file_is_not_truncated(tmp_path: Path) -> None:
    """Check odd rates and few frames."""
    assert not probe(write_video(tmp_path / "a.mkv", 7, Fraction(30000, 1001))).truncated


@pytest.mark.parametrize(("video", "rate"), [
    ("P01_01", 60.0), ("P37_102", 50.0), ("P03_101", 50.0), ("P38_01", None), ("P90_01", None), ("P01_201", None),
    ("mug", None)])
def test_epic_rates(video: str, rate: float | None) -> None:
    """Check 60 for PXX_YY, 50 for PXX_1YY, P01 to P37, and none for other names."""
    assert epic_rate(video) == rate


@pytest.mark.parametrize(("size", "expected"), [
    ((1920, 1080), (456, 256)), ((1280, 720), (456, 256)), ((854, 480), (456, 256)), ((456, 256), (456, 256)),
    ((1080, 1920), (256, 456)), ((640, 480), (342, 256)), ((320, 180), (320, 180)), ((100_000, 10), (456, 2))])
def test_working_size_keeps_the_aspect_ratio(size: tuple[int, int], expected: tuple[int, int]) -> None:
    """Check 16:9, upright and small video, and even sides."""
    assert fit(*size, BOX) == expected


def test_frame_numbers_in_names() -> None:
    """Check the last run of digits."""
    assert parse_frame_number("rgb_frames/P03_101/P03_101_frame_0000000157.jpg") == 157
    assert parse_frame_number("x/no digits.png") is None


@pytest.mark.parametrize("text", [
    "ffconcat version 1.0\nfile other.mp4\n",
    "#EXTM3U\n#EXT-X-TARGETDURATION:1\n#EXTINF:1,\nother.mp4\n#EXT-X-ENDLIST\n",
    "v=0\no=- 0 0 IN IP4 127.0.0.1\ns=x\nc=IN IP4 127.0.0.1\nt=0 0\nm=video 4567 RTP/AVP 96\na=rtpmap:96 H264/90000\n",
    '<?xml version="1.0"?><MPD xmlns="urn:mpeg:dash:schema:mpd:2011" type="static"><Period><AdaptationSet><Representation id="1">'
    "<BaseURL>other.mp4</BaseURL></Representation></AdaptationSet></Period></MPD>"], ids=["ffconcat", "HLS", "SDP", "DASH"])
def test_playlists_are_refused(tmp_path: Path, text: str) -> None:
    """Check files whose contents are in no digest."""
    write_video(tmp_path / "other.mp4", 12)
    path = tmp_path / "list.mp4"
    path.write_text(text)
    for read in (probe, lambda file: decode_video(file, 1, 3, None, BOX)):
        with pytest.raises(SourceError, match=r"list\.mp4: expected a video that can be read"):
            read(path)


def test_file_name_with_a_colon(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Check a name that looks like a protocol."""
    write_video(tmp_path / "a.mp4", 12).rename(tmp_path / "concat:b.mp4")
    monkeypatch.chdir(tmp_path)
    assert len(probe(Path("concat:b.mp4")).pts) == 12
