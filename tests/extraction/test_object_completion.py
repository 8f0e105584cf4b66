"""object_completion adds what is hidden, and only where something hides it."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from afford.common.masks import region_similarity
from schemas.masks import CompleteObjects
from schemas.video import Inpainted
from stages.extraction import hand_inpaint, object_completion
from stages.extraction.object_completion import Params
from tests.helpers.toy_clip import Toy, toy

BACKENDS = ("template", "hull", "visible")


@pytest.fixture(scope="module")
def clip() -> Toy:
    return toy()


@pytest.fixture(scope="module")
def inpainted(clip: Toy) -> Inpainted:
    return hand_inpaint.run(clip.frames, clip.tracks, hand_inpaint.Params(backend="telea"))


def hidden_iou(clip: Toy, complete: CompleteObjects) -> float:
    visible = clip.tracks.masks[2]
    rows = zip(complete.masks[0] & ~visible, clip.amodal & ~visible, strict=True)
    return float(np.nanmean([region_similarity(found, truth) for found, truth in rows]))


@pytest.mark.parametrize("backend", BACKENDS)
def test_complete_lies_between_visible_and_hidden(clip: Toy, inpainted: Inpainted, backend: str) -> None:
    """visible ⊆ complete ⊆ visible ∪ what may hide it; confidence in 0..1."""
    complete = object_completion.run(clip.frames, clip.tracks, inpainted, Params(backend=backend))
    visible, hand = clip.tracks.masks[2], clip.tracks.masks[1]
    assert complete.entities == (clip.tracks.entities[2],)
    assert not (visible & ~complete.masks[0]).any()
    assert not (complete.masks[0] & ~visible & ~hand).any()
    assert ((complete.confidence >= 0) & (complete.confidence <= 1)).all()


def test_template_beats_the_baselines(clip: Toy, inpainted: Inpainted) -> None:
    """Hidden part: template > hull > visible."""
    scores = [hidden_iou(clip, object_completion.run(clip.frames, clip.tracks, inpainted, Params(backend=b))) for b in BACKENDS]
    assert scores[0] > 0.9
    assert scores == sorted(scores, reverse=True)


def test_an_unoccluded_object_is_complete(clip: Toy, inpainted: Inpainted) -> None:
    """The mask of an unoccluded object is the visible one, with confidence 1."""
    complete = object_completion.run(clip.frames, clip.tracks, inpainted, Params())
    assert np.array_equal(complete.masks[0, 0], clip.tracks.masks[2, 0])
    assert complete.confidence[0, 0] == 1


def test_an_object_is_composed_of_its_visible_parts() -> None:
    """Frames that all hide some of the card still give most of it."""
    clip = toy(rows=slice(6, 19))
    telea = hand_inpaint.run(clip.frames, clip.tracks, hand_inpaint.Params(backend="telea"))
    assert hidden_iou(clip, object_completion.run(clip.frames, clip.tracks, telea, Params())) > 0.6


def test_untouched_objects_are_left_out(clip: Toy, inpainted: Inpainted) -> None:
    """No contact, no object: an empty but valid answer."""
    tracks = replace(clip.tracks, contact=np.full_like(clip.tracks.contact, -1))
    complete = object_completion.run(clip.frames, tracks, inpainted, Params())
    assert complete.entities == ()
    assert complete.masks.shape == (0, *clip.tracks.masks.shape[1:])


def test_other_frames_are_refused(clip: Toy, inpainted: Inpainted) -> None:
    """Inputs of different lengths give one clear sentence."""
    with pytest.raises(ValueError, match="expected the same frames"):
        object_completion.run(toy(count=20).frames, clip.tracks, inpainted, Params())
