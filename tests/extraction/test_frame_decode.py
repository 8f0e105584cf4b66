"""Laws of frame_decode: the frames of a clip, each with its own number and time, at working size."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import pytest

from afford.common.folders import media_of
from schemas.video import Clip, Footage
from stages.extraction import clip_footage, frame_decode, source_read
from tests.helpers import tiny_root
from tests.helpers.tiny_root import HEIGHT, WIDTH, image, picture, spelt, trees, write_root

PARAMS = frame_decode.Params()


def footage(clip: Clip) -> Footage:
    return clip_footage.run(clip, clip_footage.Params())


def stills(root: Path, numbers: tuple[int, ...]) -> Path:
    """An EPIC root whose media are images alone."""
    write_root(root, points=[image("P95_01", number) for number in numbers])
    (root / "videos" / "P95_01.MP4").unlink()
    folder = root / "rgb_frames" / "P95_01"
    folder.mkdir(parents=True)
    for number in numbers:
        cv2.imwrite(str(folder / f"P95_01_frame_{number:010d}.png"), picture(number)[..., ::-1])
    return folder


def decode(root: Path, **params: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    files = trees(root)["P95_01"]
    (clip,) = source_read.run(files, source_read.Params())
    frames = tiny_root.decode(files, clip, replace(PARAMS, **params))
    return frames.frame, frames.time_ns, frames.rgb


def test_a_clip_is_decoded_completely(tmp_path: Path) -> None:
    """Numbers run from first to last, times follow the rate of the file, images equal those encoded."""
    number, time_ns, rgb = decode(write_root(tmp_path))
    assert number.tolist() == list(range(1, 41)) == [spelt(image) for image in rgb]
    assert np.abs(np.diff(time_ns) - 1e9 / 30).max() < 1e5 and rgb.shape == (40, HEIGHT, WIDTH, 3)


def test_decoding_twice_gives_the_same_bytes(tmp_path: Path) -> None:
    """Bit for bit."""
    write_root(tmp_path)
    assert all(np.array_equal(a, b) for a, b in zip(decode(tmp_path), decode(tmp_path), strict=True))


def test_frames_are_scaled_into_the_box(tmp_path: Path) -> None:
    """Half the size; each pixel is the mean of four."""
    write_root(tmp_path)
    whole, half = decode(tmp_path)[2], decode(tmp_path, width_px=WIDTH // 2, height_px=HEIGHT // 2)[2]
    means = whole.reshape(40, HEIGHT // 2, 2, WIDTH // 2, 2, 3).mean(axis=(2, 4))
    assert np.abs(half - means).max() <= 0.51


def test_images_are_the_frames_that_their_names_say(tmp_path: Path) -> None:
    """Numbers far apart; lossless images come through to the bit; time is the number at the source's rate."""
    stills(tmp_path, (3, 50, 99))
    number, time_ns, rgb = decode(tmp_path)
    assert number.tolist() == [3, 50, 99] and np.array_equal(rgb[1], picture(50))
    assert time_ns.tolist() == [round((n - 1) / 30 * 1e9) for n in (3, 50, 99)]


def test_an_image_of_another_shape_is_refused(tmp_path: Path) -> None:
    """Both files and shapes are named."""
    folder = stills(tmp_path, (3, 50))
    cv2.imwrite(str(folder / "P95_01_frame_0000000050.png"), picture(50)[:20])
    with pytest.raises(ValueError, match=r"50\.png: expected the shape of .*03\.png, 128x64, got 128x20"):
        decode(tmp_path)


def test_a_broken_image_is_named(tmp_path: Path) -> None:
    """One sentence with the file."""
    folder = stills(tmp_path, (3, 50))
    (folder / "P95_01_frame_0000000050.png").write_bytes(b"not a picture")
    with pytest.raises(ValueError, match=r"50\.png: expected an image, got 13 bytes"):
        decode(tmp_path)


def test_a_clip_without_a_decodable_key_frame_is_refused(tmp_path: Path) -> None:
    """The message says which frames there are."""
    write_root(tmp_path)
    files = trees(tmp_path)["P95_01"]
    (clip,) = source_read.run(files, source_read.Params())
    with pytest.raises(ValueError, match=r"expected a key frame of P95_01 .*, got 3 frames, 2 to 4"):
        tiny_root.decode(files, replace(clip, first_frame=2, last_frame=4))


def test_footage_excludes_narrations_and_outlines(tmp_path: Path) -> None:
    """Other narrations or outlines give the same footage; another video gives another one."""
    write_root(tmp_path)
    files = trees(tmp_path)["P95_01"]
    (clip,) = source_read.run(files, source_read.Params())
    keys = tuple(replace(key, annotations=()) for key in clip.key_frames)
    assert footage(replace(clip, narrations=(), warnings=(), key_frames=keys)) == footage(clip)
    assert footage(replace(clip, last_frame=9)) != footage(clip)
    assert [file.name for file in media_of(files).files] == ["videos/P95_01.MP4"]


def test_a_video_that_is_not_there_is_named(tmp_path: Path) -> None:
    """The file, whose it is, and what to do."""
    write_root(tmp_path)
    files = trees(tmp_path)["P95_01"]
    (clip,) = source_read.run(files, source_read.Params())
    with pytest.raises(ValueError, match=r"gone\.MP4: expected among the files of P95_01, got nothing; read the source again"):
        tiny_root.decode(files, replace(clip, media=("gone.MP4",)))
