"""Odd videos of real hands: rotated, slow, of variable rate, cut, black, of two people, without hands. Decoding: test_video."""

from __future__ import annotations

import sys
from collections.abc import Callable, Sequence
from fractions import Fraction
from pathlib import Path

import av
import cv2
import numpy as np
import pytest

from afford.common.errors import SourceError
from afford.common.folders import media_of
from afford.common.masks import iou
from afford.common.video.frames import decode_video
from afford.extraction.hands.motion import cuts
from afford.extraction.landmarks.files import FOLDER, PALM, landmark_files
from afford.extraction.sources.discover import discover
from afford.extraction.sources.outlines import rasterise
from schemas.hands import DetectedHands
from schemas.video import SIDES, Frames, Hand
from stages.extraction import clip_footage, frame_decode, hand_detect, hand_landmarks, source_read
from tests.helpers.tiny_root import digest

VIDEO = Path(__file__).resolve().parents[3] / "shared" / "data" / "tabletop" / "videos" / "P90" / "P90_02.MP4"
FIRST, COUNT, SIZE_WH = 125, 36, (640, 360)
FEW = hand_landmarks.Params(width_px=640, height_px=360, colour_every=0)
"""smaller pictures, for time"""


@pytest.fixture(scope="module")
def shown() -> np.ndarray:
    """Frames (t, h, w, 3) of a person with two hands at blocks, seen from above; the person sits at the upper edge."""
    if not (Path(sys.prefix) / FOLDER / PALM).is_file():
        pytest.skip("run `python install/landmark_files.py`")
    if not VIDEO.is_file():
        pytest.skip("the real clips are not here")
    _, _, rgb = decode_video(VIDEO, FIRST, FIRST + COUNT - 1, None, SIZE_WH)
    return rgb


def written(path: Path, images: Sequence[np.ndarray], time_s: np.ndarray | None = None, turned: int = 0) -> Path:
    """Write a video with these times; `turned` quarter turns are undone by its display matrix."""
    path.parent.mkdir(parents=True)
    time_s = np.arange(len(images)) / 30 if time_s is None else time_s
    with av.open(str(path), "w") as container:
        stream = container.add_stream("libx264", rate=30, options={"crf": "18"})
        stream.pix_fmt, stream.codec_context.time_base = "yuv420p", Fraction(1, 90000)
        stream.height, stream.width = np.rot90(images[0], turned).shape[:2]
        for image, at in zip(images, time_s, strict=True):
            picture = av.VideoFrame.from_ndarray(np.ascontiguousarray(np.rot90(image, turned)), format="rgb24")
            picture.pts, picture.time_base = round(at * 90000), Fraction(1, 90000)
            container.mux(stream.encode(picture))
        container.mux(stream.encode(None))
    if turned:
        set_rotation(path, turned)
    return path


def set_rotation(path: Path, turned: int) -> None:
    """Write the display matrix of a file that is turned back by so many quarter turns into its track header."""
    data = bytearray(path.read_bytes())
    header = data.index(b"tkhd") + 4
    start = header + (36 if data[header] == 0 else 48) + 4
    c, s = ((1, 0), (0, 1), (-1, 0), (0, -1))[turned % 4]
    for n, value in enumerate((c, s, 0, -s, c, 0)):
        data[start + 4 * n : start + 4 * n + 4] = (value << 16).to_bytes(4, "big", signed=True)
    path.write_bytes(data)


def detected(path: Path, viewpoint: str = "facing") -> tuple[DetectedHands, Frames]:
    """Detect hands in a video alone."""
    (tree,) = discover(path.parent, digest).videos
    (clip,) = source_read.run(tree, source_read.Params())
    footage = clip_footage.run(clip, clip_footage.Params())
    frames = frame_decode.run(media_of(tree), footage, frame_decode.Params())
    found = hand_landmarks.run(media_of(tree), footage, FEW, landmark_files(digest))
    params = hand_detect.Params(viewpoint=viewpoint)  # type: ignore[arg-type]  # one of two
    return hand_detect.run(clip, frames, params, found), frames


def masks(found: DetectedHands, frames: Frames, side: Hand) -> dict[int, np.ndarray]:
    """Masks of one hand in its key frames."""
    height, width = frames.rgb.shape[1:3]
    return {key.frame: rasterise(one, key.width_px, key.height_px, width, height)
            for key in found.clip.key_frames for one in key.annotations if one.side == side}  # fmt: skip


@pytest.fixture(scope="module")
def plain(shown: np.ndarray, tmp_path_factory: pytest.TempPathFactory) -> tuple[DetectedHands, Frames]:
    found = detected(written(tmp_path_factory.mktemp("odd") / "plain" / "film.mp4", shown))
    assert all(found[0].hands.seen.mean(1) > 0.7)
    return found


def test_a_rotated_video_gives_the_same_hands(shown: np.ndarray, plain: tuple[DetectedHands, Frames], tmp_path: Path) -> None:
    """A phone stores turned pictures with a display matrix; frames, masks and sides are upright."""
    for turned in (1, 2):
        found, frames = detected(written(tmp_path / str(turned) / "film.mp4", shown, turned=turned))
        assert frames.rgb.shape == plain[1].rgb.shape
        for side in SIDES:
            mine, theirs = masks(found, frames, side), masks(*plain, side)
            overlaps = [iou(mine[frame], theirs[frame]) for frame in mine.keys() & theirs.keys()]
            assert len(overlaps) >= 0.6 * len(theirs) and np.median(overlaps) > 0.7


@pytest.mark.parametrize("kept", [slice(None, None, 6), "random"])
def test_slow_and_uneven_video_keeps_its_times(kept: slice | str, shown: np.ndarray, tmp_path: Path) -> None:
    """5 frames a second, and frames left out at random: hands are found, at the times of the file."""
    time_s = np.arange(COUNT) / 30
    some = np.sort(np.random.default_rng(0).choice(COUNT, 18, replace=False))
    chosen = np.arange(COUNT)[kept] if isinstance(kept, slice) else some
    found, _ = detected(written(tmp_path / "v" / "film.mp4", shown[chosen], time_s[chosen] - time_s[chosen[0]]))
    times = found.hands.time_ns / 1e9
    assert np.abs(times[:, None] - (time_s[chosen] - time_s[chosen[0]])).min(1).max() < 0.002
    assert found.hands.seen.any(0).mean() > 0.7


@pytest.mark.parametrize("level", [0, 1])
def test_a_cut_separates_two_shots(level: int, shown: np.ndarray, tmp_path: Path) -> None:
    """No hand of the first shot is expected in the second, which is black or shows an empty table."""
    second = level * _nothing(shown)[:18]
    found, frames = detected(written(tmp_path / "v" / "film.mp4", np.concatenate([shown[:18], second])))
    assert found.hands.seen[:, found.hands.frame <= 18].any() and not found.hands.seen[:, found.hands.frame > 18].any()
    assert len(cuts(frames.rgb)) == 1 and not cuts(shown)


def test_hands_of_two_people_are_two_at_a_time(shown: np.ndarray, tmp_path: Path) -> None:
    """The two of four hands that have most evidence are kept in each frame, without overlap."""
    half = [cv2.resize(image, (320, 180)) for image in shown]
    found, frames = detected(written(tmp_path / "v" / "film.mp4", [np.concatenate([one, one[:, ::-1]], 1) for one in half]))
    left, right = (masks(found, frames, side) for side in SIDES)
    assert left or right
    assert not any((left[frame] & right[frame]).any() for frame in left.keys() & right.keys())


def _nothing(shown: np.ndarray) -> np.ndarray:
    table = np.full((COUNT, 360, 640, 3), (150, 120, 90), np.uint8)
    return np.clip(table + np.random.default_rng(0).normal(0, 4, table.shape), 0, 255).astype(np.uint8)


def _gloves(shown: np.ndarray) -> np.ndarray:
    turned = [(cv2.cvtColor(image, cv2.COLOR_RGB2HSV).astype(int) + (100, 0, 0)) % (180, 256, 256) for image in shown]
    return np.stack([cv2.cvtColor(one.astype(np.uint8), cv2.COLOR_HSV2RGB) for one in turned])


@pytest.mark.parametrize("made", [_nothing, _gloves, lambda shown: shown * 0], ids=["empty table", "blue hands", "black"])
def test_no_hand_is_invented(made: Callable[[np.ndarray], np.ndarray], shown: np.ndarray,
                             tmp_path: Path) -> None:  # fmt: skip
    """An empty table, black pictures and hands of a colour that no hand has give key frames without annotations."""
    found, _ = detected(written(tmp_path / "v" / "film.mp4", made(shown)))
    assert found.clip.key_frames and not any(key.annotations for key in found.clip.key_frames) and not found.hands.seen.any()


def test_short_and_oddly_sized_video(shown: np.ndarray, tmp_path: Path) -> None:
    """Two frames, and one hand at a size that is no multiple of 16."""
    found, frames = detected(written(tmp_path / "short" / "film.mp4", shown[-2:]))
    assert len(frames.frame) == 2 and found.hands.seen.any()
    found, frames = detected(written(tmp_path / "odd" / "film.mp4", [cv2.resize(image[:, :300], (202, 242)) for image in shown]))
    assert found.hands.width_px == frames.rgb.shape[2] and found.hands.seen.any()


@pytest.mark.parametrize(("content", "message"), [(b"", "empty file"), (bytes(2000), "expected a video that can be read")])
def test_a_broken_file_is_one_sentence(content: bytes, message: str, tmp_path: Path) -> None:
    (tmp_path / "film.mp4").write_bytes(content)
    (tree,) = discover(tmp_path, digest).videos
    with pytest.raises((SourceError, ValueError), match=message) as error:
        source_read.run(tree, source_read.Params())
    assert "\n" not in str(error.value)
