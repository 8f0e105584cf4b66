"""EPIC/VISOR files of rendered clips: polygons, classes, narrations and joined roots."""

from __future__ import annotations

import csv
import hashlib

import cv2
import numpy as np
import pytest

from afford.common.video.frames import write_video
from afford.synthetic import splits
from afford.synthetic.kitchens import epic_files, vocabulary
from afford.synthetic.kitchens.epic_files import write_root
from schemas.files import FileRef, FileTree
from schemas.video import HAND_CLASS, SIDES
from tests.helpers.made_epic import drawn


@pytest.mark.parametrize("seed", range(4))
def test_polygons_reproduce_the_mask_exactly(seed):
    """A traced mask is read back as the same mask, holes, islands and borders included."""
    noise = np.random.default_rng(seed).standard_normal((256, 456))
    mask = cv2.GaussianBlur(noise, (0, 0), 1.0 + 2 * seed) > 0.01
    np.testing.assert_array_equal(drawn(epic_files.mask_to_polygons(mask), 456, 256), mask)


def test_empty_mask_has_no_polygon():
    """An empty mask gives no outline, and no outline gives an empty mask."""
    assert epic_files.mask_to_polygons(np.zeros((256, 456), bool)) == []
    assert not drawn([], 456, 256).any()


def test_class_ids_and_words_are_unique_and_hands_have_epic_ids():
    """Each id and word belongs to one class; the hands have the ids of EPIC's v2 file."""
    for table in (vocabulary.VERBS, vocabulary.NOUNS):
        assert len({entry.id for entry in table}) == len(table)
        words = [word for entry in table for word in entry.instances]
        assert len(set(words)) == len(words)
    assert {side: vocabulary.noun_class(f"hand:{side}").id for side in SIDES} == HAND_CLASS == {"left": 300, "right": 301}


def test_nouns_outside_epic_get_new_classes():
    """A workshop noun has a class above EPIC's last id; an unknown noun is an error that contains it."""
    assert vocabulary.noun_class("hammer").id > 305
    assert vocabulary.noun_class("mug").key == "cup"
    with pytest.raises(KeyError, match="sextant"):
        vocabulary.noun_class("sextant")


def test_action_rows_have_epics_columns(tmp_path):
    """The narration file has the 15 columns in EPIC's order, and its times agree with its frames."""
    action = epic_files.narration("P91_01", 0, (30, 75), "pour water into mug", "pour", ("bottle", "mug"))
    epic_files.write_actions(tmp_path, "P91_01", "train", [action])
    with (tmp_path / "EPIC_100_train.csv").open(newline="") as file:
        rows = list(csv.reader(file))
    assert len(rows[0]) == 15
    assert rows[0][:3] == ["narration_id", "participant_id", "video_id"]
    assert rows[1][3:8] == ["00:00:01.000", "00:00:01.00", "00:00:02.50", "30", "75"]
    assert rows[1][-2:] == ["['bottle', 'mug']", "[15, 13]"]


def test_video_encoding_is_deterministic(tmp_path):
    """The same frames give the same bytes, whatever memory contained before."""
    rng = np.random.default_rng(0)
    picture = cv2.GaussianBlur(rng.uniform(0, 255, (256, 456, 3)), (0, 0), 4)
    images = np.stack([np.roll(picture, 3 * k, axis=1) + rng.normal(0, 3, picture.shape) for k in range(12)]).clip(0, 255)
    written = set()
    for number in range(4):
        write_video(tmp_path / f"{number}.mp4", images.astype(np.uint8), 23)
        written.add((tmp_path / f"{number}.mp4").read_bytes())
        rng.integers(0, 255, (number + 1) * 1_000_000)
    assert len(written) == 1


def tree(folder, name, files):
    """Build a FileTree of small text files."""
    refs = []
    for file, text in files.items():
        path = folder / name / file
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(text)
        refs.append(FileRef(file, hashlib.sha256(text.encode()).hexdigest(), len(text), path))
    return FileTree(name, tuple(refs))


def test_join_of_two_roots(tmp_path):
    """Tables are joined row by row, class files are sorted by id without duplicates, other files are copied."""
    classes = "EPIC_100_noun_classes_v2.csv"
    info = "EPIC_100_video_info.csv"
    a = tree(tmp_path, "a", {info: "video_id,fps\nP91_01,30\n", classes: "id,key\n2,plate\n5,pan\n", "videos/a": "x"})
    b = tree(tmp_path, "b", {info: "video_id,fps\nP91_02,30\n", classes: "id,key\n1,spoon\n5,pan\n", "videos/b": "y"})
    write_root((a, b), tmp_path / "root")
    assert (tmp_path / "root" / info).read_text() == "video_id,fps\nP91_01,30\nP91_02,30\n"
    assert (tmp_path / "root" / classes).read_text() == "id,key\n1,spoon\n2,plate\n5,pan\n"
    assert (tmp_path / "root" / "videos" / "b").read_text() == "y"


def test_clashing_roots_are_refused(tmp_path):
    """Two clips with different files of one name cannot form one root."""
    with pytest.raises(ValueError, match="different video ids"):
        write_root((tree(tmp_path, "a", {"videos/a": "x"}), tree(tmp_path, "b", {"videos/a": "y"})), tmp_path / "root")


def test_clip_sets_contain_the_required_scripts_settings_and_splits():
    """The sets contain 8 standard and 6 hard clips with the required scripts; the data set has both splits and all settings."""
    standard, hard, data = splits.standard_specs(0), splits.hard_specs(0), splits.dataset_specs(0)
    assert len(standard) == 8
    assert len(hard) == 6
    assert {"parallax", "carry", "pour", "carry_both"} <= {spec.script for spec in standard}
    assert {spec.script for spec in hard} == {"never_free", "turn_over", "open_hinged", "dart", "open_jar"}
    assert {spec.setting for spec in data} == {"kitchen", "workshop", "desk"}
    assert {spec.split for spec in data} == {"train", "val"}
    assert len({spec.video_id for spec in (*standard, *hard, *data)}) == len(standard) + len(hard) + len(data)
    assert all(a.seed != b.seed for a, b in zip(standard, splits.standard_specs(1), strict=True))
