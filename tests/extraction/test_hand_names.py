"""Laws of sources/hand_names: every usual spelling of a hand is that hand, and a name that may be either is refused."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest

from afford.common.errors import SourceError
from afford.extraction.sources.hand_names import is_vague, side_of
from afford.extraction.sources.remarks import no_hands_remark
from schemas.video import Clip
from tests.extraction.test_own_video import coco, compressed, read_own
from tests.helpers.tiny_root import OTHER, clips, image, mask, write_root

SPELLINGS = ("{} hand", "hand_{}", "{}_hand", "{}Hand", "{}-hand", "hand {}", "Hand ({})", "hand:{}", "{}hand", "hand{}",
             "my {} hand", "person's {} hand", "human_{}_hand")  # fmt: skip
SHORT = ("{} hand", "hand_{}", "{}hand", "{}H")


def named(name: str, **more: Any) -> dict[str, Any]:
    """COCO masks whose hand has this category."""
    document = coco(compressed(), **more)
    return document | {"categories": [{"id": 1, "name": name}, {"id": 2, "name": "mug"}]}


def side_in(clip: Clip) -> list[str]:
    """Side of each mask of the first key frame."""
    return [mask.side for mask in clip.key_frames[0].annotations]


@pytest.mark.parametrize("side", ["left", "right"])
@pytest.mark.parametrize("change", [str.lower, str.upper, str.capitalize, str])
def test_usual_spellings_are_hands(side: str, change: Any) -> None:
    """Words may be in either order, joined or separate, in any case; L and R are left and right."""
    words = [change(spelling.format(side)) for spelling in SPELLINGS]
    words += [change(spelling.format(letter)) for spelling in SHORT for letter in (side[0], side[0].upper())]
    assert {word: side_of(word) for word in words} == dict.fromkeys(words, side)
    assert not any(map(is_vague, words))


@pytest.mark.parametrize("name", [
    "hand", "Hand 2", "hands", "hand_1", "both hands", "left", "Right", "left hand 2", "second hand", "left right hand",
    "person hand"])
def test_a_hand_of_unclear_side_is_refused(tmp_path: Path, name: str) -> None:
    """The sentence names the categories and says how to name them."""
    assert side_of(name) is None and is_vague(name)
    expected = "names of masks: expected each hand called 'left hand' or 'right hand', got '.*rename them"
    with pytest.raises(SourceError, match=expected):
        read_own(tmp_path, named(name))


@pytest.mark.parametrize("name", ["hand towel", "handle", "hand soap", "mug", "leftover", "right side of pan", "", "左手"])
def test_other_things_are_no_hands(name: str) -> None:
    """Neither of a side nor unclear."""
    assert side_of(name) is None and not is_vague(name)


def test_the_right_hand_of_a_tool_is_not_lost(tmp_path: Path) -> None:
    """`hand_right` is what many tools write; it was an object, and the hand was lost without a word."""
    clip = read_own(tmp_path, named("hand_right", in_contact_object="mug"))
    assert side_in(clip) == ["right", ""] and clip.key_frames[0].annotations[0].name == "right hand" and clip.warnings == ()


@pytest.mark.parametrize(("name", "message"), [
    ("left hand mask", "'left hand mask' counts as an object"), ("left glove", "'left glove' counts as an object")])
def test_names_that_resemble_hands_get_a_remark(tmp_path: Path, name: str, message: str) -> None:
    """The mask is kept as an object, with a warning."""
    assert any(message in text for text in read_own(tmp_path, named(name)).warnings)


def test_masks_without_a_hand_are_remarked_on(tmp_path: Path) -> None:
    """Hands may have another name; the sentence lists the names."""
    clip = read_own(tmp_path, named("main gauche"))
    masks = [(mask.side, mask.name) for key in clip.key_frames for mask in key.annotations]
    assert "names are" in no_hands_remark(masks) and "'main gauche'" in no_hands_remark(masks)
    assert no_hands_remark([]) == no_hands_remark([*masks, ("left", "left hand")]) == ""


def test_masks_that_visor_publishes_are_as_they_are(tmp_path: Path) -> None:
    """An id of EPIC's own: its annotators' `hand` is an object, as ever; of another id it is refused."""
    points = [[mask("left hand", "h", in_contact_object="m"), mask("hand", "m", (OTHER,))]]
    (clip,) = clips(write_root(tmp_path / "epic", "P01_01", points=[image("P01_01", 1, points[0])], frames=70), "P01_01")
    assert side_in(clip) == ["left", ""] and clip.warnings == ()
    with pytest.raises(SourceError, match="names of masks"):
        clips(write_root(tmp_path / "own", points=[image("P95_01", 1, points[0])]))


def shares() -> dict[str, Any]:
    """COCO masks in shares of the picture."""
    document = coco([[0.1, 0.1, 0.4, 0.1, 0.4, 0.9]])
    for raw in document["annotations"]:
        raw["segmentation"] = [[0, 0, 1, 0, 0.5, 1]]
    return document


@pytest.mark.parametrize("document", [
    shares(),
    {"video_annotations": [image("mine", 1, [mask("left hand", "h", ([[0.1, 0.2], [0.5, 0.2], [1.0, 1.0]],))])]}])  # fmt: skip
def test_normalised_coordinates_are_refused(tmp_path: Path, document: dict[str, Any]) -> None:
    """Normalised coordinates would give a hand without pixels, and no sample."""
    with pytest.raises(SourceError, match="corners in pixels, got normalised coordinates up to 1; multiply x by the width"):
        read_own(tmp_path, document)
