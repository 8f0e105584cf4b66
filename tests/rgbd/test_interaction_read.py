"""Sequences on disk: what is written is read, the released code's frames and colours, and one sentence for what is wrong."""

from __future__ import annotations

import json
from dataclasses import replace
from itertools import pairwise

import cv2
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from afford.common.errors import SourceError
from afford.dataset.sor3d_layout import colour_label, discover_sequences, label_of_colours, write_sequence
from afford.rgbd.readers.sor3d import sample_slots
from schemas.interaction import AFFORDANCES, BACKGROUND, COLOURS_BGR
from stages.rgbd import interaction_read
from tests.helpers.made_interactions import clip, digest

READ = interaction_read.Params()
STCAE = interaction_read.Params(grid="stcae")


def back(root, params=READ):
    """The only sequence of a root."""
    (files,) = discover_sequences(root, digest)
    return interaction_read.run(files, params)


@settings(max_examples=12, deadline=None)
@given(st.sampled_from(AFFORDANCES), st.integers(0, 99), st.integers(5, 40), st.integers(5, 40), st.sampled_from(("train", "val")))
def test_written_sequences_are_read_back(tmp_path_factory, affordance, seed, height, width, split) -> None:
    """Colours and masks exactly, depth to its millimetre, K exactly, hot spots to a pixel of 1920 x 1080."""
    made = clip(affordance, seed, height=height, width=width, split=split)
    root = tmp_path_factory.mktemp("root")
    write_sequence(made, root)
    found = back(root)
    assert (found.name, found.split, found.object_type, found.affordance, found.rate_hz) == (
        made.name, made.split, made.object_type, made.affordance, made.rate_hz)  # fmt: skip
    for name in ("rgb", "depth_m", "K", "label"):
        assert np.array_equal(getattr(found, name), getattr(made, name)), name
    np.testing.assert_allclose(found.hotspot, made.hotspot, atol=max(height / 1080, width / 1920))


@given(st.integers(1, 400))
def test_slots_end_with_the_last_frame(count: int) -> None:
    """Ten slots of any number of frames; in order, evenly, black frames in front only."""
    found = sample_slots(count)
    real = [k for k in found if k >= 0]
    assert len(found) == 10 and found[-1] == count - 1
    assert found == [-1] * (10 - len(real)) + real
    assert len({b - a for a, b in pairwise(real)}) <= 1


@pytest.mark.parametrize("count", range(21, 121))
def test_frames_are_those_of_the_released_code(count: int) -> None:
    """Its walk over the files in other words: a step by length, the remainder skipped, dummies in front, every second kept."""
    step = next(s for s, most in ((1, 30), (2, 40), (3, 60), (4, 80), (5, 100), (6, 120)) if count <= most)
    skip = count - 20 if step == 1 else count % step
    taken = [k for k in range(1, count + 1) if k > skip and (k - skip) % step == 0]
    filled = [0] * (20 - len(taken)) + taken
    assert sample_slots(count) == [k - 1 for k in filled[1::2]]


def test_colours_are_those_of_the_released_code() -> None:
    """Numbers of SOR3D-AFF's released code; another class's colour is background."""
    assert COLOURS_BGR["cut"] == (0, 165, 255) and COLOURS_BGR["push"] == (240, 255, 120)
    every = np.arange(10, dtype=np.uint8)[None]
    assert len({tuple(c) for c in colour_label(every)[0].tolist()}) == 10
    for index, name in enumerate(AFFORDANCES):
        assert np.array_equal(label_of_colours(colour_label(every), name)[0] != BACKGROUND, np.arange(10) == index)


def test_a_root_of_the_released_layout(tmp_path) -> None:
    """1920 x 1080, no depth, no camera: shrunk and cut like the released code, K of the part that is left."""
    at = tmp_path / "val" / "Subject20_lift_x_cup" / "rgb"
    at.mkdir(parents=True)
    for k in range(25):
        cv2.imwrite(str(at / f"{k:03d}.png"), np.full((1080, 1920, 3), k, np.uint8))
    mask = np.zeros((1080, 1920, 3), np.uint8)
    mask[300:600, 900:1200] = COLOURS_BGR["lift"]
    for k, picture in enumerate((mask, mask, mask)):
        cv2.imwrite(str(at / f"025_{k}.png"), picture)
    (at / "025_9.json").write_text(json.dumps({"center": [{"x_coord": "900", "y_coord": 450, "radius": 30}]}))
    found = back(tmp_path, interaction_read.Params("slots", "stcae"))
    assert found.rgb.shape == (10, 300, 300, 3) and (found.depth_m == 0).all()
    assert found.rgb[:, 0, 0, 0].tolist() == [*range(6, 25, 2)]
    rows, columns = np.nonzero(found.label == AFFORDANCES.index("lift"))
    assert (rows.min(), rows.max(), columns.min(), columns.max()) == (100, 199, 100, 199)
    np.testing.assert_allclose(found.hotspot, [[100, 150, 10]], atol=1e-5)
    assert found.K[0, 0] == pytest.approx(1081.4 / 3) and found.K[0, 2] == pytest.approx(119.5)


def test_frames_without_zeros_in_front_keep_their_order(tmp_path) -> None:
    """1, 2, ..., 12, not 1, 10, 11, 12, 2; masks stay behind the frames, depth goes with its frame."""
    made = clip()
    grey, far = np.arange(12, dtype=np.uint8), np.arange(12, dtype=np.float32)
    made = replace(made, rgb=np.broadcast_to(grey[:, None, None, None], (12, *made.rgb.shape[1:])),
                   depth_m=np.broadcast_to(far[:, None, None], (12, *made.depth_m.shape[1:])))  # fmt: skip
    folder = write_sequence(made, tmp_path)
    for path in [*folder.glob("rgb/0*.png"), *folder.glob("depth/*.png")]:
        path.rename(path.with_stem(str(int(path.stem))))
    found = back(tmp_path)
    assert found.rgb[:, 0, 0, 0].tolist() == found.depth_m[:, 0, 0].tolist() == [*range(12)]
    assert np.array_equal(found.label, made.label)


def blank(path, *shape: int, dtype=np.uint8) -> None:
    """An empty picture (h, w[, 3]) in the place of a file."""
    cv2.imwrite(str(path), np.zeros(shape, dtype))


def tint(path, found: tuple[int, int, int]) -> None:
    """The marked pixels of a mask, in another colour."""
    mask = cv2.imread(str(path))
    mask[mask.any(axis=-1)] = found
    cv2.imwrite(str(path), mask)


def as_jpeg(path) -> None:
    """A mask that was compressed on its way: one flat region, a little off."""
    mask = np.full((12, 16, 3), COLOURS_BGR["cut"], np.uint8)
    path.write_bytes(cv2.imencode(".jpg", mask, [cv2.IMWRITE_JPEG_QUALITY, 60])[1].tobytes())


FAULTS = {
    "a mask a little off": ("rgb/target_1_mask.png", lambda p: tint(p, (1, 165, 255)),
                            r"expected pixels of B, G, R \(0, 165, 255\) for cut, .*got mostly \(1, 165, 255\); write"),
    "a mask of JPEG": ("rgb/target_1_mask.png", as_jpeg, r"expected pixels of B, G, R \(0, 165, 255\) for cut"),
    "a mask of another affordance": ("rgb/target_1_mask.png", lambda p: tint(p, COLOURS_BGR["push"]),
                                     r"for cut, the second word of the folder, got mostly \(240, 255, 120\)"),
    "a black mask": ("rgb/target_1_mask.png", lambda p: blank(p, 12, 16, 3), "got mostly black alone; write masks"),
    "a mask of another size": ("rgb/target_1_mask.png", lambda p: blank(p, 4, 4, 3), "a mask of 16 x 12 px like"),
    "a frame that is no picture": ("rgb/0002.png", lambda p: p.write_bytes(b"none"), "expected a picture, got 4 bytes"),
    "a frame of another size": ("rgb/0001.png", lambda p: blank(p, 4, 4, 3), "a frame of 16 x 12 px .*got 4 x 4"),
    "depth of another size": ("depth/0002.png", lambda p: blank(p, 10, 12, dtype=np.uint16),
                              "expected depth of 16 x 12 px .*got 12 x 10.*register colour to the depth grid"),
    "depth of 8 bits": ("depth/0002.png", lambda p: blank(p, 12, 16), "one channel of uint16"),
    "depth that is missing": ("depth/0003.png", lambda p: p.unlink(), "0003.png, as rgb/ has that frame"),
    "a hot spot that is no number": ("rgb/target_4_hotspot.json", lambda p: p.write_text('{"center": [{"x_coord": "a"}]}'),
                                     "x_coord"),
    "hot spots that are no list": ("rgb/target_4_hotspot.json", lambda p: p.write_text('{"center": 3}'), "a list of circles"),
    "a camera without fy": ("camera.json", lambda p: p.write_text('{"fx": 3}'), "fy: expected a number, got None"),
    "a camera of no length": ("camera.json", lambda p: p.write_text(p.read_text().replace("20.5", "0")), "positive fx, fy"),
}  # fmt: skip


@pytest.mark.parametrize("fault", FAULTS)
def test_errors_name_file_and_expectation(fault: str, tmp_path) -> None:
    """One sentence each."""
    name, spoil, said = FAULTS[fault]
    folder = write_sequence(clip(), tmp_path)
    spoil(folder / name)
    with pytest.raises(SourceError, match=said) as caught:
        back(tmp_path)
    assert str(caught.value).count("\n") == 0


SHRUNK_FAULTS = {
    "depth of its own camera": ("depth/0002.png", lambda p: blank(p, 424, 512, dtype=np.uint16),
                                "depth of 64 x 36 px like the last frame, got 512 x 424.*register colour to the depth grid first"),
    "a smaller frame of the same shape": ("rgb/0002.png", lambda p: blank(p, 18, 32, 3), "a frame of 64 x 36 px .*got 32 x 18"),
    "a smaller mask of the same shape": ("rgb/target_1_mask.png", lambda p: blank(p, 18, 32, 3), "a mask of 64 x 36 .*got 32 x 18"),
    "frames that would be squeezed": ("rgb/0003.png", lambda p: blank(p, 424, 512, 3),
                                      "a frame of 16 : 9.*got 512 x 424.*grid=native"),
}  # fmt: skip


@pytest.mark.parametrize("fault", SHRUNK_FAULTS)
def test_sizes_are_compared_before_resizing(fault: str, tmp_path) -> None:
    """grid=stcae resizes every picture to 640 x 360: files on another grid than the colours must not pass."""
    name, spoil, said = SHRUNK_FAULTS[fault]
    folder = write_sequence(clip(height=36, width=64), tmp_path)
    (folder / "camera.json").unlink()
    assert back(tmp_path, STCAE).depth_m.shape == (3, 300, 300)
    spoil(folder / name)
    with pytest.raises(SourceError, match=said):
        back(tmp_path, STCAE)


def test_folders_of_other_names_are_refused(tmp_path) -> None:
    """No root; an unknown affordance; a name in both splits; a link out of the root."""
    with pytest.raises(SourceError, match="no such folder"):
        discover_sequences(tmp_path, digest)
    write_sequence(replace(clip(), name="Subject1_juggle_knife"), tmp_path / "a")
    with pytest.raises(SourceError, match="second word: expected one of grasp"):
        back(tmp_path / "a")
    for split in ("train", "val"):
        write_sequence(clip(split=split), tmp_path / "b")
    with pytest.raises(SourceError, match="in train and val"):
        discover_sequences(tmp_path / "b", digest)
    folder = write_sequence(clip(), tmp_path / "c")
    (folder / "rgb" / "0001.png").unlink()
    (folder / "rgb" / "0001.png").symlink_to(tmp_path / "b" / "train")
    with pytest.raises(SourceError, match="a link that leaves it"):
        discover_sequences(tmp_path / "c", digest)


def test_too_few_files_and_parameters_out_of_range(tmp_path) -> None:
    """Frames must exist; parameter values must be known."""
    folder = write_sequence(clip(), tmp_path)
    (files,) = discover_sequences(tmp_path, digest)
    for k in (1, 2, 3):
        (folder / "rgb" / f"{k:04d}.png").unlink()
    with pytest.raises(SourceError, match="frames and 4 files behind them"):
        back(tmp_path)
    with pytest.raises(ValueError, match="expected frames 'all' or 'slots'"):
        interaction_read.run(files, interaction_read.Params(frames="some"))
