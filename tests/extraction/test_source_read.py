"""Laws of source_read: what annotators wrote becomes clips, and the quirks of the formats stop here."""

from __future__ import annotations

import zipfile
from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import pytest

from afford.extraction.sources.outlines import rasterise
from schemas.video import Annotation, Clip, KeyFrame
from stages.extraction import source_read
from tests.extraction.test_discover import DATA
from tests.helpers.tiny_root import (
    OTHER,
    SQUARE,
    clips,
    decode,
    image,
    mask,
    picture,
    row,
    trees,
    write_points,
    write_root,
    write_rows,
)

real = pytest.mark.skipif(not DATA.is_dir(), reason="real sample data are not here")
PARAMS = source_read.Params()


def only(clip: Clip, frame: int = 1) -> KeyFrame:
    return next(key for key in clip.key_frames if key.frame == frame)


def named(key: KeyFrame, name: str) -> Annotation:
    return next(a for a in key.annotations if a.name == name)


def read_points(root: Path, points: list[object], frames: int = 40) -> Clip:
    write_root(root, points=points, frames=frames)
    (clip,) = clips(root)
    return clip


def test_a_plain_root_gives_one_clip(tmp_path: Path) -> None:
    """Frames, key frames, contact, narration, participant and split are those of the files."""
    (clip,) = clips(write_root(tmp_path))
    assert (clip.clip_id, clip.participant_id, clip.split, clip.media_kind) == ("P95_01", "P95", "train", "video")
    assert (clip.first_frame, clip.last_frame, clip.fps, clip.resample) == (1, 40, 30.0, False)
    assert [key.frame for key in clip.key_frames] == [1, 16, 31]
    assert named(only(clip), "left hand").contact == "m1" and named(only(clip), "left hand").side == "left"
    narration = clip.narrations[0]
    assert (narration.verb_key, narration.verb_class, narration.noun_key, narration.noun_class) == ("take", 0, "cup", 13)
    assert clip.warnings == ()


def test_reading_twice_gives_the_same(tmp_path: Path) -> None:
    """The stage is a function of its inputs."""
    write_root(tmp_path)
    first, second = clips(tmp_path)[0], clips(tmp_path)[0]
    assert repr(first) == repr(second)


def test_a_glove_is_the_hand_it_is_on(tmp_path: Path) -> None:
    """Hand and glove become one hand: the union of the masks, with the glove's contact; a lone glove is a hand as well."""
    overlap = [[700.0, 500.0], [1000.0, 500.0], [1000.0, 800.0], [700.0, 800.0]]
    rows = [mask("left hand", "h", (SQUARE,), in_contact_object="hand-not-in-contact"),
            mask("rubber glove", "g", (overlap,), in_contact_object="m", on_which_hand=["left hand"]),
            mask("glove", "r", (OTHER,), in_contact_object="g", on_which_hand=["rigth hand"]), mask("mug", "m", (OTHER,))]
    key = only(read_points(tmp_path, [image("P95_01", 1, rows)]))
    left, right = named(key, "left hand"), named(key, "right hand")
    assert left.contact == "m" and right.side == "right" and right.contact == left.annotation_id
    drawn = rasterise(left, 1920, 1080, 1920, 1080)
    assert drawn[450, 650] and drawn[750, 950] and drawn[600, 800]
    assert [a.name for a in key.annotations] == ["left hand", "right hand", "mug"]


def test_gloves_that_are_not_on_one_hand(tmp_path: Path) -> None:
    """Gloves on both hands are one annotation of both; gloves on no hand are an object."""
    rows = [mask("gloves", "b", in_contact_object="glove-not-in-contact", on_which_hand=["left hand", "right hand"]),
            mask("oven glove", "o", (OTHER,), in_contact_object=None, on_which_hand=None)]
    key = only(read_points(tmp_path, [image("P95_01", 1, rows)]))
    assert named(key, "gloves").side == "both" and named(key, "oven glove").side == ""


@pytest.mark.parametrize(("written", "read"), [
    ("hand-not-in-contact", "hand-not-in-contact"), ("none-of-the-above", "none-of-the-above"),
    ("inconclusive", "inconclusive"), (None, ""), ("m", "m")])
def test_words_of_contact_are_kept(tmp_path: Path, written: str | None, read: str) -> None:
    """VISOR's words, an id, and nothing at all stay what they are."""
    rows = [mask("right hand", "h", in_contact_object=written), mask("mug", "m", (OTHER,))]
    clip = read_points(tmp_path, [image("P95_01", 1, rows)])
    assert named(only(clip), "right hand").contact == read and clip.warnings == ()


def test_misspelt_hands_are_hands(tmp_path: Path) -> None:
    """'rigth hand' is a known fault of the data set."""
    clip = read_points(tmp_path, [image("P95_01", 1, [mask("rigth hand", "h"), mask("mug", "m", (OTHER,))])])
    assert named(only(clip), "right hand").class_id == 301


def test_corrections_replace_wrong_contacts(tmp_path: Path) -> None:
    """corrections.json: {image name: {hand name: object id}}."""
    write_root(tmp_path)
    (tmp_path / "corrections.json").write_text('{"P95_01_frame_0000000016.jpg": {"left hand": "hand-not-in-contact"}}')
    (clip,) = clips(tmp_path)
    assert named(only(clip, 16), "left hand").contact == "hand-not-in-contact"
    assert named(only(clip, 31), "left hand").contact == "m31"


@pytest.mark.parametrize("zipped", [False, True])
def test_dense_masks_join_the_sparse_ones(tmp_path: Path, zipped: bool) -> None:
    """Ready-made frames are marked, refer to 854 x 480, and never replace an annotator's own frame."""
    write_root(tmp_path)
    small = [[x / 2.25, y / 2.25] for x, y in SQUARE]
    points = [image("P95_01", frame, [mask("mug", f"d{frame}", [small])]) for frame in (16, 17, 18)]
    dense = write_points(tmp_path, "P95_01_interpolations", points)
    folder = tmp_path / "Interpolations-DenseAnnotations" / "train"
    folder.mkdir(parents=True)
    if zipped:
        with zipfile.ZipFile(folder / f"{dense.stem}.zip", "w") as archive:
            archive.write(dense, dense.name)
        dense.unlink()
    else:
        dense.rename(folder / dense.name)
    (clip,) = clips(tmp_path)
    assert [(key.frame, key.dense, key.width_px) for key in clip.key_frames] == [
        (1, False, 1920), (16, False, 1920), (17, True, 854), (18, True, 854), (31, False, 1920)]


def test_a_wide_gap_cuts_a_video_and_a_narrow_one_does_not(tmp_path: Path) -> None:
    """Key frames 1 to 31 and 151 to 181 are 4 s apart: two clips with margins, named by order, each with its own narrations."""
    points = [image("P95_01", frame) for frame in (1, 16, 31, 151, 166, 181)]
    write_root(tmp_path, frames=200, points=points, rows=[row("P95_01", 0), row("P95_01", 1, start_frame=150, stop_frame=160)])
    parts = clips(tmp_path)
    assert [(c.clip_id, c.first_frame, c.last_frame) for c in parts] == [("P95_01_s01", 1, 41), ("P95_01_s02", 141, 191)]
    assert [[n.narration_id for n in c.narrations] for c in parts] == [["P95_01_0"], ["P95_01_1"]]
    assert len(clips(tmp_path, params=replace(PARAMS, max_gap_s=4.0))) == 1


def test_a_long_clip_is_cut_at_a_key_frame_that_both_sides_keep(tmp_path: Path) -> None:
    """Frames between key frames keep a key frame before and after them."""
    write_root(tmp_path, frames=100, points=[image("P95_01", frame) for frame in range(1, 92, 15)])
    parts = clips(tmp_path, params=replace(PARAMS, max_frames=40, margin_frames=3))
    assert [(c.first_frame, c.last_frame) for c in parts] == [(1, 31), (31, 61), (61, 94)]
    assert all(c.key_frames[-1].frame - c.first_frame < 40 for c in parts)


def test_margins_stop_at_the_ends_of_the_video_and_halfway_to_the_next_key_frame(tmp_path: Path) -> None:
    """Clips never share a frame across a gap."""
    write_root(tmp_path, frames=40, points=[image("P95_01", frame) for frame in (5, 20)])
    parts = clips(tmp_path, params=replace(PARAMS, max_gap_s=0.1, margin_frames=30))
    assert [(c.first_frame, c.last_frame) for c in parts] == [(1, 12), (13, 40)]


def test_frame_images_alone_are_one_clip_of_the_frames_that_exist(tmp_path: Path) -> None:
    """A gap of 20 s without frames does not cut; a key frame without image is dropped with a remark."""
    write_root(tmp_path, points=[image("P95_01", frame) for frame in (1, 16, 601)])
    (tmp_path / "videos" / "P95_01.MP4").unlink()
    folder = tmp_path / "rgb_frames" / "train" / "P95_01"
    folder.mkdir(parents=True)
    for frame in (1, 601):
        cv2.imwrite(str(folder / f"P95_01_frame_{frame:010d}.jpg"), picture(1))
    (clip,) = clips(tmp_path)
    assert clip.media_kind == "frames" and len(clip.media) == 2 and [key.frame for key in clip.key_frames] == [1, 601]
    assert "frame 16 is annotated but not among" in clip.warnings[0]


def test_epic_videos_are_numbered_at_60_or_50_frames_a_second(tmp_path: Path) -> None:
    """P01_01 at 30 frames/s: frame 61 is one second in; a key frame at the 60 Hz end is inside the video."""
    write_root(tmp_path, "P01_01", frames=40, points=[image("P01_01", frame) for frame in (1, 61, 80)], rows=[row("P01_01")])
    (clip,) = clips(tmp_path, "P01_01")
    assert (clip.fps, clip.resample, clip.last_frame) == (60.0, True, 80)


def test_released_frames_are_renumbered_by_the_mapping(tmp_path: Path) -> None:
    """frame_mapping.json ties VISOR's image names to the names of EPIC's own frames."""
    write_root(tmp_path, points=[image("P95_01", 16)])
    (tmp_path / "videos" / "P95_01.MP4").unlink()
    folder = tmp_path / "rgb_frames" / "P95_01"
    folder.mkdir(parents=True)
    cv2.imwrite(str(folder / "frame_0000000018.jpg"), picture(1))
    (tmp_path / "frame_mapping.json").write_text('{"P95_01": {"P95_01_frame_0000000016.jpg": "frame_0000000018.jpg"}}')
    assert [key.frame for key in clips(tmp_path)[0].key_frames] == [18]


def test_classes_are_matched_exactly_and_new_words_stay_themselves(tmp_path: Path) -> None:
    """A class that the row states wins; 'pick' is not 'pick-up'; what EPIC does not know is its own key."""
    given = [row("P95_01", 0, verb="wibble", verb_class=0), row("P95_01", 1, verb="pick", verb_class=99),
             row("P95_01", 2, verb="pick-up", verb_class=99, noun="sprocket", noun_class=500)]
    write_root(tmp_path, rows=given)
    (clip,) = clips(tmp_path)
    assert [(n.verb_class, n.verb_key) for n in clip.narrations] == [(0, "take"), (-1, "pick"), (0, "take")]
    assert (clip.narrations[2].noun_class, clip.narrations[2].noun_key) == (-1, "sprocket")


def test_other_tables_count_when_they_have_epics_columns(tmp_path: Path) -> None:
    """Ids that came before are not repeated; a table of another kind is passed over."""
    write_root(tmp_path)
    write_rows(tmp_path / "EPIC_100_uda.csv", [row("P95_01", 0), row("P95_01", 5)])
    write_rows(tmp_path / "EPIC_100_sentences.csv", [{"narration_id": "P95_01_9"}], ("narration_id", "sentence"))
    assert [n.narration_id for n in clips(tmp_path)[0].narrations] == ["P95_01_0", "P95_01_5"]


@real
def test_real_visor_frames_are_read_whole() -> None:
    """P03_101: ten key frames of one clip at 50 frames/s, 64 masks, every contact an object or a word."""
    (clip,) = source_read.run(trees(DATA / "epic_P03_101")["P03_101"], PARAMS)
    assert (clip.fps, clip.split, len(clip.media), len(clip.key_frames)) == (50.0, "val", 10, 10)
    assert sum(len(key.annotations) for key in clip.key_frames) == 64
    assert [len(clip.narrations), *clip.warnings] == [
        12, "339 of 351 narrations speak of no annotated part of the video: P03_101_12, P03_101_13, P03_101_14, ..."]


@real
@pytest.mark.parametrize(("video", "frames"), [("P90_01", (1, 287)), ("P90_02", (19, 292))])
def test_real_video_is_one_clip_and_key_frame_n_is_its_nth_picture(video: str, frames: tuple[int, int]) -> None:
    """The decoded frame is the annotated image, and no neighbour of it is nearer."""
    files = trees(DATA / "tabletop")[video]
    (clip,) = source_read.run(files, PARAMS)
    assert (clip.first_frame, clip.last_frame) == frames
    decoded = decode(files, replace(clip, first_frame=193, last_frame=253))
    wanted = cv2.imread(str(next((DATA / "tabletop" / "rgb_frames").rglob(f"{video}_frame_0000000241.jpg"))))
    wanted = cv2.resize(wanted, (456, 256), interpolation=cv2.INTER_AREA)[..., ::-1]
    error = np.abs(decoded.rgb.astype(int) - wanted).mean(axis=(1, 2, 3))
    assert decoded.frame[error.argmin()] == 241 and error.min() < 2
