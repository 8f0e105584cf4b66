"""Bad input of the reader: one clear sentence with file, field, value and advice; other videos are read."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from afford.common.errors import SourceError
from schemas.video import Clip
from stages.extraction import narration_labelling, source_read
from tests.helpers.tiny_root import (
    OTHER,
    SQUARE,
    clips,
    decode,
    image,
    mask,
    row,
    trees,
    write_points,
    write_root,
    write_rows,
    write_video,
)

COLUMNS_WITHOUT_START = tuple(c for c in row("P95_01") if c != "start_frame")


def video(root: Path) -> Path:
    return root / "videos" / "P95_01.MP4"


def empty_video(root: Path) -> None:
    video(root).write_bytes(b"")


def half_video(root: Path) -> None:
    data = video(root).read_bytes()
    video(root).write_bytes(data[: len(data) // 2])


def no_video_at_all(root: Path) -> None:
    video(root).write_text("this is text")


def short_video(root: Path) -> None:
    write_video(video(root), 12)


def missing_column(root: Path) -> None:
    write_rows(root / "EPIC_100_train.csv", [row("P95_01")], COLUMNS_WITHOUT_START)


def unparsable_number(root: Path) -> None:
    write_rows(root / "EPIC_100_train.csv", [row("P95_01"), row("P95_01", 1, start_frame="soon")])


def unparsable_list(root: Path) -> None:
    write_rows(root / "EPIC_100_train.csv", [row("P95_01", all_nouns="mug, board")])


def short_row(root: Path) -> None:
    with (root / "EPIC_100_train.csv").open("a") as file:
        file.write("P95_01_7,P95\n")


def masks_of_another_resolution(root: Path) -> None:
    large = [[[x * 2, y * 2] for x, y in OTHER]]
    write_points(root, "P95_01", [image("P95_01", frame, [mask("mug", "m", large)]) for frame in (1, 16, 31)])


def reversed_interval(root: Path) -> None:
    write_rows(root / "EPIC_100_train.csv", [row("P95_01", start_frame=9, stop_frame=3)])


def table_in_another_encoding(root: Path) -> None:
    with (root / "EPIC_100_train.csv").open("ab") as file:
        file.write(b"P95_01_9,\xff\xfe\n")


def broken_json(root: Path) -> None:
    path = write_points(root, "P95_01", [image("P95_01", 1)])
    path.write_text(path.read_text()[:200])


def nan_in_json(root: Path) -> None:
    write_points(root, "P95_01", [image("P95_01", 1, [mask("mug", "m", [[[float("nan"), 1.0], [2.0, 3.0], [4.0, 5.0]]])])])


def words_for_corners(root: Path) -> None:
    write_points(root, "P95_01", [image("P95_01", 1, [mask("mug", "m", [["left", "right"]])])])


def name_of_another_kind(root: Path) -> None:
    write_points(root, "P95_01", [image("P95_01", 1, [mask("mug", "m") | {"name": 7}])])


def another_document(root: Path) -> None:
    write_points(root, "P95_01", []).write_text('{"frames": []}')


def no_points(root: Path) -> None:
    write_points(root, "P95_01", [])


def frame_twice(root: Path) -> None:
    write_points(root, "P95_01", [image("P95_01", 1), image("P95_01", 1)])


REFUSED: list[tuple[Callable[[Path], None], str]] = [
    (empty_video, r"videos/P95_01\.MP4: expected a video, got an empty file \(0 bytes\); get the file again"),
    (half_video, r"videos/P95_01\.MP4: expected a video that can be read, got .*; is the file cut short\? get it again"),
    (no_video_at_all, r"videos/P95_01\.MP4: expected a video that can be read, got .*"),
    (short_video, r"key frame 31: expected one of frames 1 to 12 of videos/P95_01\.MP4, got an annotation outside"),
    (missing_column, r"EPIC_100_train\.csv: expected columns narration_id, .*, got no start_frame; add it"),
    (unparsable_number, r"EPIC_100_train\.csv, line 3, column 'start_frame': expected a whole number, got 'soon'; correct or"),
    (unparsable_list, r"line 2, column 'all_nouns': expected a list such as \['tap', 'sponge'\], got 'mug, board'; correct"),
    (short_row, r"EPIC_100_train\.csv, line 4, column 'verb_class': expected a whole number, got ''; correct or remove"),
    (masks_of_another_resolution, r"P95_01\.json, field 'segments': expected outlines on a grid of 1920x1080, got 3 of 3"),
    (reversed_interval, r"line 2: expected a stop that is not before the start, got frames 9 to 3; correct the row"),
    (table_in_another_encoding, r"EPIC_100_train\.csv: expected a CSV file in UTF-8, got .*; save it again"),
    (broken_json, r"train/P95_01\.json, line 1: expected JSON, got .*; was the file cut short\? get it again"),
    (nan_in_json, r"train/P95_01\.json: expected finite numbers, got NaN; JSON has no NaN"),
    (words_for_corners, r"annotation 1, field 'segments': expected polygons as lists of \[x, y\] numbers, got .*; correct"),
    (name_of_another_kind, r"image 1 \(.*\), annotation 1, field 'name': expected str, got int; compare"),
    (another_document, r"P95_01\.json: expected 'video_annotations' \(VISOR\) or .*, got frames; see docs/.*/own-video\.md"),
    (no_points, r"P95_01: expected at least one image with masks, got files without masks; annotate some frames"),
    (frame_twice, r"image 2 \(.*\): expected one entry per frame, got a second one for frame 1; merge the two"),
]


@pytest.mark.parametrize(("spoil", "sentence"), REFUSED, ids=lambda value: getattr(value, "__name__", ""))
def test_a_bad_file_is_refused_in_one_sentence_and_its_video_fails_alone(
    tmp_path: Path, spoil: Callable[[Path], None], sentence: str
) -> None:
    """The other video of the root is read, unless their common table is invalid."""
    write_root(tmp_path, "P95_02")
    write_root(tmp_path, "P95_01", rows=[row("P95_01"), row("P95_02")])
    spoil(tmp_path)
    with pytest.raises(SourceError, match=sentence) as caught:
        clips(tmp_path, "P95_01")
    assert "\n" not in str(caught.value) and len(str(caught.value)) < 400
    if spoil not in (missing_column, table_in_another_encoding):
        assert len(clips(tmp_path, "P95_02")) == 1


def read_points(root: Path, points: list[Any], **more: Any) -> Clip:
    write_root(root, points=points, **more)
    (clip,) = clips(root)
    return clip


def hand(segments: Any = (SQUARE,), **more: Any) -> dict[str, Any]:
    return mask("left hand", "h", segments, in_contact_object="m", **more)


def names(clip: Clip) -> list[str]:
    return [a.name for key in clip.key_frames for a in key.annotations]


def test_a_polygon_outside_the_image_is_left_out_and_one_across_its_border_cut_off(tmp_path: Path) -> None:
    """Both are reported; other annotations are unchanged."""
    outside = [[2000.0, 50.0], [2100.0, 50.0], [2100.0, 90.0]]
    across = [[1900.0, 50.0], [2100.0, 50.0], [2100.0, 90.0]]
    rows = [hand(), mask("mug", "m", [across]), mask("pan", "p", [outside])]
    clip = read_points(tmp_path, [image("P95_01", 1, rows), image("P95_01", 16)])
    assert names(clip) == ["left hand", "mug"] * 2
    assert "'mug' (m) leaves the 1920x1080 grid and was cut off" in " ".join(clip.warnings)
    assert "'pan' (p) lies outside the 1920x1080 grid and was left out" in " ".join(clip.warnings)


def test_empty_polygons_are_passed_over_and_an_annotation_of_nothing_is_left_out(tmp_path: Path) -> None:
    """`[]` besides a real outline has no effect; a contact with a missing mask counts as inconclusive."""
    clip = read_points(tmp_path, [image("P95_01", 1, [hand([SQUARE, []]), mask("mug", "m", [])])])
    (annotation,) = clip.key_frames[0].annotations
    assert len(annotation.polygons) == 1 and annotation.contact == "inconclusive"
    assert any("has no outline and was left out" in warning for warning in clip.warnings)


def test_an_unknown_contact_id_counts_as_inconclusive(tmp_path: Path) -> None:
    """The warning has the image and the id."""
    clip = read_points(tmp_path, [image("P95_01", 1, [mask("left hand", "h", in_contact_object="ghost")])])
    assert clip.key_frames[0].annotations[0].contact == "inconclusive"
    assert "P95_01_frame_0000000001.jpg" in clip.warnings[0] and "'ghost', which is no mask of this frame" in clip.warnings[0]


def test_a_frame_with_a_hand_annotated_twice_is_left_out(tmp_path: Path) -> None:
    """The right one cannot be known; without a hand the frame would claim that the hand is out of sight."""
    twice = image("P95_01", 16, [hand(), mask("left hand", "h2", [OTHER]), mask("mug", "m", [OTHER])])
    clip = read_points(tmp_path, [image("P95_01", 1), twice])
    assert [key.frame for key in clip.key_frames] == [1]
    assert "the left hand is annotated 2 times; the frame was left out" in clip.warnings[0]


def test_the_same_hand_written_twice_is_one_hand(tmp_path: Path) -> None:
    """Identical outlines are a copy."""
    clip = read_points(tmp_path, [image("P95_01", 1, [hand(), hand(), mask("mug", "m", [OTHER])])])
    assert names(clip) == ["left hand", "mug"] and clip.key_frames[0].annotations[0].contact == "m"


def test_masks_of_another_resolution_are_scaled_or_reported(tmp_path: Path) -> None:
    """A stated grid is used; masks that all lie in one corner of 1920 x 1080 may have been drawn on a smaller one."""
    small = [[x / 3, y / 3] for x, y in OTHER]
    point = image("P95_01", 1, [mask("mug", "m", [small])])
    assert "upper left quarter of the 1920x1080 grid" in read_points(tmp_path / "a", [point]).warnings[0]
    point["image"] |= {"width": 640, "height": 360}
    assert read_points(tmp_path / "b", [point]).warnings == ()


def test_a_few_annotations_behind_the_end_of_the_video_are_left_out(tmp_path: Path) -> None:
    """Tools disagree about the last frames, within half a second of the end."""
    clip = read_points(tmp_path, [image("P95_01", 1), image("P95_01", 44)])
    assert [key.frame for key in clip.key_frames] == [1] and "frame 44 is annotated but not among" in clip.warnings[0]


def test_a_truncated_video_is_used_up_to_the_cut(tmp_path: Path) -> None:
    """Key frames behind the cut are omitted with a warning; earlier frames keep their numbers."""
    points = [image("P95_01", frame) for frame in (1, 16, 31, 46, 61, 76)]
    write_root(tmp_path, points=points, frames=80)
    write_video(video(tmp_path), 80, front=True)
    data = video(tmp_path).read_bytes()
    video(tmp_path).write_bytes(data[: len(data) * 6 // 10])
    (clip,) = clips(tmp_path)
    assert 1 <= len(clip.key_frames) < 6 and "frame 76 is annotated but not among" in clip.warnings[-1]
    frames = decode(trees(tmp_path)["P95_01"], clip)
    assert clip.key_frames[-1].frame <= frames.frame[-1] <= clip.last_frame < 80


def test_a_narration_that_matches_no_frame_is_listed(tmp_path: Path) -> None:
    """The narration labels nothing and stops nothing; a video without narration is reported."""
    write_root(tmp_path, rows=[row("P95_01"), row("P95_01", 1, start_frame=5000, stop_frame=5100)])
    (clip,) = clips(tmp_path)
    assert [n.narration_id for n in clip.narrations] == ["P95_01_0"]
    assert clip.warnings == ("1 of 2 narrations speak of no annotated part of the video: P95_01_1",)
    write_root(tmp_path / "b", rows=[])
    assert "no narration of P95_01 in EPIC_100_train.csv" in clips(tmp_path / "b")[0].warnings[0]


def test_a_clip_without_hands_in_contact_is_a_clip(tmp_path: Path) -> None:
    """Later stages decide that it gives no sample."""
    clip = read_points(tmp_path, [image("P95_01", 1, [mask("mug", "m")])])
    assert names(clip) == ["mug"] and clip.warnings == ()


def test_long_and_unicode_narrations_come_through(tmp_path: Path) -> None:
    """40,000 characters, line breaks, quotes and several scripts, from the file to the label."""
    text = ('κόψε "το" ψωμί, 切面包 🍞\n' * 2000)[:40_000]
    write_root(tmp_path, rows=[row("P95_01", narration=text, noun="面包", noun_class=-1, all_nouns="['面包']")])
    (clip,) = clips(tmp_path)
    frames = decode(trees(tmp_path)["P95_01"], clip)
    labels = narration_labelling.run(clip, frames, narration_labelling.Params())
    assert labels.narrations[0].text == text and labels.narrations[0].noun_key == "面包"


def test_unicode_names_are_names(tmp_path: Path) -> None:
    """Names of objects and of videos."""
    write_root(tmp_path, "Küche_01", points=[image("Küche_01", 1, [mask("茶壶", "m")])], rows=[row("Küche_01")])
    (clip,) = clips(tmp_path, "Küche_01")
    assert clip.clip_id == "Küche_01" and names(clip) == ["茶壶"]


def test_a_parameter_out_of_range_is_refused(tmp_path: Path) -> None:
    """The error comes before any file is opened."""
    write_root(tmp_path)
    with pytest.raises(ValueError, match="max_frames of 2 or more"):
        clips(tmp_path, params=source_read.Params(max_frames=1))


def test_a_mapping_or_correction_that_is_no_json_is_named(tmp_path: Path) -> None:
    """The small files besides the tables are checked like the rest."""
    write_root(tmp_path)
    (tmp_path / "corrections.json").write_text(json.dumps({"a": 1})[:-1])
    with pytest.raises(SourceError, match=r"corrections\.json, line 1: expected JSON"):
        clips(tmp_path)
