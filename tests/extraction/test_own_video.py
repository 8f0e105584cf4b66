"""Laws of one's own video: VISOR or COCO masks and a plain table become the same clips as EPIC's files."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from pycocotools import mask as coco_mask

from afford.common.errors import SourceError
from afford.extraction.sources.narrations import seconds, verb_and_nouns
from afford.extraction.sources.outlines import boxed_mask, rasterise, run_lengths, trace
from schemas.video import Clip
from stages.extraction import source_read
from tests.helpers.tiny_root import HEIGHT, WIDTH, image, trees, write_video

CATEGORIES = [{"id": 1, "name": "left_hand"}, {"id": 2, "name": "mug"}]


def disc() -> np.ndarray:
    rows, columns = np.mgrid[:HEIGHT, :WIDTH]
    return (rows - 30) ** 2 + (columns - 60) ** 2 < 200


def coco(segmentation: Any, **more: Any) -> dict[str, Any]:
    """Frames 1 and 16 of 30: a hand and a mug, whose mask is `segmentation`."""
    images = [{"id": i, "file_name": f"frame_{15 * i - 14:06d}.png", "width": WIDTH, "height": HEIGHT} for i in (1, 2)]
    annotations = []
    for i in (1, 2):
        hand = {"id": 10 * i, "image_id": i, "category_id": 1, "segmentation": [[5, 5, 25, 5, 25, 25, 5, 25]]}
        annotations.append(hand | more)
        annotations.append({"id": 10 * i + 1, "image_id": i, "category_id": 2, "segmentation": segmentation})
    return {"images": images, "annotations": annotations, "categories": CATEGORIES}


def read_own(folder: Path, document: Any, table: str = "start,stop,narration\n0,1,pick up the red mug\n") -> Clip:
    write_video(folder / "My clip ü.mp4", 30)
    (folder / "masks.json").write_text(json.dumps(document))
    (folder / "words.csv").write_text(table, encoding="utf-8")
    (tree,) = trees(folder).values()
    (clip,) = source_read.run(tree, source_read.Params())
    return clip


def plain_counts(mask: np.ndarray) -> list[int]:
    flat = mask.flatten(order="F").astype(np.int8)
    edges = np.flatnonzero(np.diff(np.concatenate([[0], flat, [1 - flat[-1]]])))
    return np.diff(np.concatenate([[0], edges])).tolist()


def compressed() -> dict[str, Any]:
    code = coco_mask.encode(np.asfortranarray(disc().astype(np.uint8)))
    return {"size": list(code["size"]), "counts": code["counts"].decode()}


@pytest.mark.parametrize("segmentation", [compressed(), {"size": [HEIGHT, WIDTH], "counts": plain_counts(disc())}])
def test_run_lengths_give_the_very_mask(tmp_path: Path, segmentation: dict[str, Any]) -> None:
    """Compressed or plain, not one pixel differs."""
    clip = read_own(tmp_path, coco(segmentation))
    mug = next(a for a in clip.key_frames[0].annotations if a.name == "mug")
    assert np.array_equal(rasterise(mug, WIDTH, HEIGHT, WIDTH, HEIGHT), disc())


def test_coco_polygons_are_united(tmp_path: Path) -> None:
    """Overlapping polygons of one COCO annotation do not cancel."""
    square, other = [10, 10, 40, 10, 40, 40, 10, 40], [20, 20, 60, 20, 60, 60, 20, 60]
    mug = next(a for a in read_own(tmp_path, coco([square, other])).key_frames[0].annotations if a.name == "mug")
    drawn = rasterise(mug, WIDTH, HEIGHT, WIDTH, HEIGHT)
    assert drawn[30, 30] and drawn[12, 12] and drawn[55, 55] and not drawn[12, 55]


def test_names_frames_and_hands_of_coco(tmp_path: Path) -> None:
    """The number in the file name is the frame; 'left_hand' is the left hand; no contact given means not known."""
    clip = read_own(tmp_path, coco(compressed()))
    assert (clip.clip_id, clip.participant_id, clip.split) == ("My clip ü", "My clip ü", "")
    assert [key.frame for key in clip.key_frames] == [1, 16]
    hand = clip.key_frames[0].annotations[0]
    assert (hand.name, hand.side, hand.contact) == ("left hand", "left", "")


@pytest.mark.parametrize(("more", "contact"), [
    ({"in_contact_object": "mug"}, "11"), ({"attributes": {"in_contact_object": 11}}, "11"),
    ({"in_contact_object": "none"}, "hand-not-in-contact"), ({"in_contact_object": "inconclusive"}, "inconclusive")])
def test_contact_may_be_given_by_id_by_name_or_in_words(tmp_path: Path, more: dict[str, Any], contact: str) -> None:
    """Directly or among the attributes, as annotation tools write it."""
    assert read_own(tmp_path, coco(compressed(), **more)).key_frames[0].annotations[0].contact == contact


def test_numbers_from_zero_must_be_declared(tmp_path: Path) -> None:
    """Frame 0 is refused with the remedy; with the remedy it is frame 1."""
    document = coco(compressed())
    document["images"][0]["file_name"] = "frame_000000.png"
    with pytest.raises(SourceError, match="first_frame"):
        read_own(tmp_path, document)
    document["info"] = {"first_frame": 0}
    assert [key.frame for key in read_own(tmp_path, document).key_frames] == [1, 17]


def test_visor_masks_of_ones_own_video_may_state_their_grid(tmp_path: Path) -> None:
    """1920 x 1080 unless the image says otherwise."""
    point = image("mine", 1)
    point["image"] |= {"width": 3840, "height": 2160}
    key = read_own(tmp_path, {"video_annotations": [point]}).key_frames[0]
    assert (key.width_px, key.height_px) == (3840, 2160)


@pytest.mark.parametrize(("table", "interval"), [
    ("start,stop,narration\n0.5,1,move mug\n", (16, 30)), ("Start,Stop,Narration\n0.5,1,move mug\n", (16, 30)),
    ("start,stop,narration\n00:00:00.5,0:01,move mug\n", (16, 30)),
    ("start_frame,stop_frame,narration\n4,9,move mug\n", (4, 9)), ("narration,end_s,start_s\nmove mug,0.2,0.1\n", (4, 7))])
def test_times_may_be_frames_seconds_or_clock(tmp_path: Path, table: str, interval: tuple[int, int]) -> None:
    """Half a second is frame 16 at 30 frames/s; times beyond the end are the last frame."""
    narration = read_own(tmp_path, coco(compressed()), table).narrations[0]
    assert (narration.start_frame, narration.stop_frame) == interval


def test_verb_and_noun_columns_win_over_the_sentence(tmp_path: Path) -> None:
    """Given words are taken as they are; without them the sentence is read."""
    table = "start,stop,narration,verb,noun\n0,1,pick up the red mug,grab,cup\n0,1,pick up the red mug,,\n"
    first, second = read_own(tmp_path, coco(compressed()), table).narrations
    assert (first.verb, first.noun, second.verb, second.noun) == ("grab", "cup", "pick-up", "mug:red")
    assert second.verb_class == -1 and second.verb_key == "pick-up"


@pytest.mark.parametrize(("sentence", "words"), [
    ("pick up the red mug", ("pick-up", ("mug:red",))), ("Pour coffee into the mug.", ("pour", ("coffee", "mug"))),
    ("open jar with left hand", ("open", ("jar", "hand:left"))), ("öffne Glas", ("öffne", ("glas",))),
    ("put down", ("put-down", ())), ("!?", ("", ()))])
def test_a_sentence_gives_verb_and_nouns(sentence: str, words: tuple[str, tuple[str, ...]]) -> None:
    """Imperatives, in EPIC's spelling: verb-particle, head:modifier."""
    assert verb_and_nouns(sentence) == words


@pytest.mark.parametrize(("text", "value"), [("12.5", 12.5), ("1:02.5", 62.5), ("01:00:02", 3602.0)])
def test_clock_times(text: str, value: float) -> None:
    """Seconds, minutes and hours from the right."""
    assert seconds(text) == value


def example(kind: str) -> str:
    """A block of docs/extraction/own-video.md."""
    text = (Path(__file__).resolve().parents[2] / "docs" / "extraction" / "own-video.md").read_text(encoding="utf-8")
    return text.split(f"{kind}\n", 1)[1].split("```", 1)[0]


@pytest.mark.parametrize(("kind", "keys"), [("```json coco", [1, 16]), ("```json visor", [16])])
def test_the_examples_of_the_guide_work_as_printed(tmp_path: Path, kind: str, keys: list[int]) -> None:
    """Copied into a folder beside a video they give key frames, contacts and narrations."""
    clip = read_own(tmp_path, json.loads(example(kind)), example("```csv narrations"))
    assert [key.frame for key in clip.key_frames] == keys and clip.warnings == ()
    hand, mug = clip.key_frames[-1].annotations
    assert (hand.side, hand.contact) == ("right", mug.annotation_id)
    assert [(n.verb, n.noun, n.start_frame) for n in clip.narrations] == [("reach", "mug", 1), ("pick-up", "mug", 19)]


@pytest.mark.parametrize("text", ["1e999", "inf", "nan", "1e308:0:0", "-1", "1:2:3:4"])
def test_times_that_are_none_are_refused(tmp_path: Path, text: str) -> None:
    """A narration that never stops was the last frame."""
    with pytest.raises(SourceError, match="expected seconds, mm:ss or hh:mm:ss"):
        read_own(tmp_path, coco(compressed()), f"start,stop,narration\n0,{text},move mug\n")


def test_images_of_one_frame_or_one_id_are_refused(tmp_path: Path) -> None:
    """The first of the two was lost without a word."""
    document = coco(compressed())
    document["images"][1]["file_name"] = document["images"][0]["file_name"]
    with pytest.raises(SourceError, match="one entry per frame"):
        read_own(tmp_path, document)
    document["images"][1]["id"] = 1
    with pytest.raises(SourceError, match="ids that differ"):
        read_own(tmp_path, document)


@pytest.mark.parametrize("seed", range(20))
def test_a_mask_drawn_in_its_box_is_the_mask(seed: int) -> None:
    """The same pixels and the same outlines as on the whole picture, also where a run goes on in the next column."""
    rng = np.random.default_rng(seed)
    height, width = rng.integers(1, 50, 2)
    mask = rng.random((height, width)) < rng.choice([0.02, 0.3, 0.98])
    code = coco_mask.encode(np.asfortranarray(mask.astype(np.uint8)))["counts"].decode()
    found, whole = boxed_mask(run_lengths(code, height, width), height), np.zeros_like(mask)
    whole[found.y : found.y + found.mask.shape[0], found.x : found.x + found.mask.shape[1]] = found.mask
    assert np.array_equal(whole, mask)
    outlines = trace(found.mask, (found.x, found.y))
    assert [p.points.tolist() for p in outlines] == [p.points.tolist() for p in trace(mask)]
