"""Stage scene_render: determinism, files in EPIC's layout, and consistent ground truth."""

from __future__ import annotations

import json
from types import SimpleNamespace

import av
import numpy as np
import pytest

from afford.codecs import load
from afford.synthetic.kitchens.animation import DURATION
from afford.synthetic.kitchens.scripts import SCRIPTS
from afford.synthetic.kitchens.vocabulary import noun_class
from afford.synthetic.kitchens.world import build_animation, build_world, elbow, random_stream
from afford.synthetic.splits import dataset_specs, hard_specs, standard_specs
from schemas.scene import SceneSpec
from schemas.video import SIDES
from stages.synthetic import scene_render
from tests.helpers.made_epic import drawn

SPEC = SceneSpec("P91_01", "pour", "kitchen", 3, frames=3, key_gap=2)
SETTING = {"hammer": "workshop", "screw": "workshop", "fetch_tool": "workshop", "fetch_item": "desk", "tidy_desk": "desk"}
PARAMS = scene_render.Params(supersample=1)


def render(folder, spec=SPEC):
    """Run the stage in a folder."""
    return scene_render.run(spec, PARAMS, SimpleNamespace(scratch=folder, progress=lambda done, total: None))


@pytest.fixture(scope="module")
def clip(tmp_path_factory):
    """Short rendered clip of pouring."""
    return render(tmp_path_factory.mktemp("clip"))


@pytest.fixture(scope="module")
def truth(clip):
    """Ground truth of the clip."""
    return load("ClipTruth", {file.name.rsplit("/", 1)[1]: file.path for file in clip.truth.files})


def test_same_spec_gives_the_same_bytes(clip, tmp_path):
    """A second rendering in another folder gives files of the same names and digests."""
    again = render(tmp_path)
    for first, second in ((clip.files, again.files), (clip.truth, again.truth)):
        assert [(f.name, f.digest) for f in first.files] == [(f.name, f.digest) for f in second.files]


def test_files_follow_the_epic_layout(clip):
    """Video, annotations and tables are at EPIC's and VISOR's paths, without any ground truth."""
    names = [file.name for file in clip.files.files]
    assert names == sorted(names)
    assert {"videos/P91/P91_01.MP4", "GroundTruth-SparseAnnotations/annotations/train/P91_01.json", "EPIC_100_train.csv",
            "EPIC_100_video_info.csv", "EPIC_100_verb_classes.csv", "EPIC_100_noun_classes_v2.csv"} == set(names)
    assert all(file.name.startswith("truth/P91_01/") for file in clip.truth.files)


def test_video_has_every_frame(clip):
    """Frame n is the n-th decoded frame."""
    with av.open(str(clip.files.find("videos/P91/P91_01.MP4").path)) as container:
        assert sum(1 for _ in container.decode(video=0)) == SPEC.frames


def test_annotations_equal_the_visible_masks(clip, truth):
    """Polygons of key frames are read back as the true visible masks; key frames are 1, 1 + gap, ..."""
    path = clip.files.find("GroundTruth-SparseAnnotations/annotations/train/P91_01.json").path
    points = json.loads(path.read_text())["video_annotations"]
    assert [int(point["image"]["name"][-14:-4]) for point in points] == [1, 3]
    names = [entity.name for entity in truth.entities]
    for point in points:
        t = int(point["image"]["name"][-14:-4]) - 1
        for row in point["annotations"]:
            np.testing.assert_array_equal(drawn(row["segments"], 456, 256), truth.visible[names.index(row["name"]), t])


def test_contacts_refer_to_masks_of_the_same_image(clip, truth):
    """A hand's contact is the id of an annotation of the same image, or VISOR's word for no contact."""
    points = json.loads(clip.files.find("GroundTruth-SparseAnnotations/annotations/train/P91_01.json").path.read_text())
    for point in points["video_annotations"]:
        ids = {row["id"] for row in point["annotations"]}
        for row in point["annotations"]:
            assert ("in_contact_object" in row) == (row["name"] in ("left hand", "right hand"))
            assert row.get("in_contact_object", "hand-not-in-contact") in ids | {"hand-not-in-contact", "none-of-the-above"}
            if row["name"] in ("left hand", "right hand"):
                touched = truth.contact[int(row["name"] == "right hand"), int(point["image"]["name"][-14:-4]) - 1]
                by_id = {other["id"]: other["name"] for other in point["annotations"]}
                assert by_id.get(row["in_contact_object"], "") in ("", truth.entities[touched].name if touched >= 0 else "")
                assert (row["in_contact_object"] == "hand-not-in-contact") == (touched < 0)
    assert (truth.contact >= 0).any()


def test_ground_truth_is_consistent(truth):
    """Visible pixels are amodal ones, entities do not overlap, and contact pixels belong to the hand.

    Where there is neither a hand nor its shadow, both images without hands are equal.
    """
    assert not (truth.visible & ~truth.amodal).any()
    assert truth.visible.sum(axis=0).max() <= 1
    assert not (truth.contact_mask & ~truth.visible[:2]).any()
    assert truth.contact_mask.any()
    assert (truth.rgb_no_hands[0] == truth.rgb_no_hands_shadow[0]).mean() > 0.5


def test_hands_occlude_the_held_object(truth):
    """Part of a held object is behind the hand."""
    side, t = np.argwhere(truth.contact >= 0)[0]
    held = truth.contact[side, t]
    assert (truth.amodal[held, t] & truth.visible[side, t]).any()


def test_unknown_script_is_refused():
    """The error lists the scripts."""
    with pytest.raises(ValueError, match="carry_both"):
        build_world(SceneSpec("P91_01", "juggle", "kitchen", 0))


@pytest.mark.parametrize("script", sorted(SCRIPTS))
def test_scripts_reach_their_objects_with_straight_wrists(script):
    """Arms reach the objects that they hold with a wrist bend below 80 degrees, and actions are narrated."""
    spec = SceneSpec("P91_01", script, SETTING.get(script, "kitchen"), 5)
    animation = build_animation(spec, random_stream(spec))
    intervals = [interval for side in SIDES for interval in animation.arms[side].grip_intervals]
    assert intervals
    assert animation.narrations
    for interval in intervals:
        palm = animation.arms[interval.grip.side].track.at(0.5 * (interval.start + interval.stop))
        forearm = elbow(interval.grip.side, palm) - palm[:3, 3]
        assert -palm[:3, 0] @ forearm / np.linalg.norm(forearm) > np.cos(np.radians(80))
        assert 0 <= interval.start < interval.stop <= DURATION


def test_narrations_have_classes_and_intervals_inside_the_clip():
    """Narrations of all clip sets use nouns with a class and intervals inside the clip."""
    for spec in (*standard_specs(2), *hard_specs(2), *dataset_specs(2)):
        for action in build_animation(spec, random_stream(spec)).narrations:
            assert 0 <= action.start < action.stop <= DURATION
            assert action.nouns and all(noun_class(noun).id >= 0 for noun in action.nouns)


@pytest.mark.slow
@pytest.mark.parametrize("script", sorted(SCRIPTS))
def test_scripts_build_a_world(script):
    """The world of every script has entities for both hands and all objects, and instances to draw."""
    world = build_world(SceneSpec("P91_01", script, SETTING.get(script, "kitchen"), 5))
    assert len(world.entities) == 2 + len(world.objects) and world.instances(60.0)
