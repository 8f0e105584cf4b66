"""affordance_intersect: complete object AND same-side hand, the papers' taxonomy, and a reason for every rejection."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from schemas.affordance import Rejection, Taxonomy
from schemas.masks import CompleteObjects, Entity, Tracks
from stages.extraction import affordance_intersect
from stages.extraction.affordance_intersect import Params

SIZE = (48, 86)
EXACT = Params(dilate_px855=0)
ENTITIES = (
    Entity("left hand", "left hand", -1, "hand", "left"),
    Entity("right hand", "right hand", -1, "hand", "right"),
    Entity("jar", "jar", 1, "object", ""),
    Entity("lid", "lid", 2, "object", ""),
)


def box(x: int, y: int, width: int, height: int) -> np.ndarray:
    mask = np.zeros(SIZE, bool)
    mask[y : y + height, x : x + width] = True
    return mask


def scene(contact: tuple[int, int], **changes: Any) -> tuple[Tracks, CompleteObjects]:
    """One frame: both hands lie over the jar, the right one over the lid as well."""
    masks = [box(10, 10, 12, 20), box(40, 10, 12, 20), box(18, 10, 26, 24), box(42, 4, 14, 8)]
    visible = np.stack([masks[0], masks[1], masks[2] & ~masks[0] & ~masks[1], masks[3] & ~masks[1]])[:, None]
    ones = np.ones((4, 1), np.float32)
    tracks = Tracks(
        "c", ENTITIES, np.array([7]), visible, ones, np.full((4, 1), 3, np.uint8),
        np.full((4, 1), 7), np.zeros((4, 1), np.int32),
        np.array(contact, np.int16)[:, None], np.zeros((2, 1), np.int32),
    )  # fmt: skip
    complete = CompleteObjects("c", ENTITIES[2:], tracks.frame, np.stack(masks[2:])[:, None], ones[2:])
    return replace(tracks, **changes), complete


@pytest.mark.parametrize(
    ("contact", "four", "three"),
    [
        ((2, -1), Taxonomy.LEFT, 0),
        ((-1, 2), Taxonomy.RIGHT, 0),
        ((2, 2), Taxonomy.BOTH_SAME, 1),
        ((2, 3), Taxonomy.BOTH_DIFFERENT, 2),
        ((-1, -1), Taxonomy.NONE, -1),
        ((-2, 3), Taxonomy.RIGHT, 0),
    ],
)
def test_taxonomy(contact: tuple[int, int], four: Taxonomy, three: int) -> None:
    """Left only, right only, both on the same id, both on different ids: the order of the released one-hot vectors."""
    found = affordance_intersect.run(*scene(contact), EXACT)
    assert (found.taxonomy[0], found.taxonomy3[0]) == (four, three)


def test_intersection_lies_in_both_and_has_the_right_hand() -> None:
    """Each mask is exactly its own hand AND the complete object that this hand touches."""
    tracks, complete = scene((2, 3))
    found = affordance_intersect.run(tracks, complete, EXACT)
    assert np.array_equal(found.masks[0], tracks.masks[0] & complete.masks[0])
    assert np.array_equal(found.masks[1], tracks.masks[1] & complete.masks[1])
    assert found.object_index[:, 0].tolist() == [0, 1]
    assert found.rejection[0] == Rejection.ACCEPTED


def test_swapping_the_hands_swaps_the_masks() -> None:
    """Left and right hands are treated the same."""
    tracks, complete = scene((2, 3))
    swapped = replace(tracks, masks=tracks.masks[[1, 0, 2, 3]], contact=tracks.contact[::-1].copy())
    one, other = affordance_intersect.run(tracks, complete, EXACT), affordance_intersect.run(swapped, complete, EXACT)
    assert np.array_equal(one.masks, other.masks[::-1])


def test_dilation_scales_with_the_image() -> None:
    """10 px at 855 is 1 px at 86, which changes nothing, and 5 px at 456."""
    tracks, complete = scene((2, -1))
    assert np.array_equal(
        affordance_intersect.run(tracks, complete, Params()).masks, affordance_intersect.run(tracks, complete, EXACT).masks
    )
    grown = affordance_intersect.run(tracks, complete, Params(dilate_px855=30)).masks[0, 0]
    assert np.array_equal(grown, box(18 - 1, 10 - 1, 4 + 2, 20 + 2))


@pytest.mark.parametrize(
    ("contact", "params", "reason"),
    [
        ((-1, -1), EXACT, Rejection.NO_CONTACT),
        ((-2, -1), EXACT, Rejection.CONTACT_UNKNOWN),
        ((3, -1), EXACT, Rejection.EMPTY_INTERSECTION),
        ((2, -1), Params(dilate_px855=0, min_area_px855=9000), Rejection.TOO_SMALL),
        ((2, -1), Params(dilate_px855=0, max_area_px855=79.5 * (855 / 86) ** 2), Rejection.TOO_LARGE),
        ((2, -1), Params(dilate_px855=0, max_area_px855=80.5 * (855 / 86) ** 2), Rejection.ACCEPTED),
        ((2, -1), Params(dilate_px855=0, min_quality=1.01), Rejection.LOW_QUALITY),
    ],
)
def test_rejection(contact: tuple[int, int], params: Params, reason: Rejection) -> None:
    """Each reason occurs; areas are below the upper limit, as in the paper's code (0 < area < 20000 at 855)."""
    assert affordance_intersect.run(*scene(contact), params).rejection[0] == reason


def test_missing_object() -> None:
    """A touched object without a complete mask rejects the frame."""
    tracks, complete = scene((2, -1))
    gone = replace(complete, masks=np.zeros_like(complete.masks))
    assert affordance_intersect.run(tracks, gone, EXACT).rejection[0] == Rejection.OBJECT_MISSING
    none = CompleteObjects("c", (), tracks.frame, complete.masks[:0], complete.confidence[:0])
    assert affordance_intersect.run(tracks, none, EXACT).rejection[0] == Rejection.OBJECT_MISSING


def test_quality_falls_with_doubt() -> None:
    """1 when everything is sure; lower with key distance, confidence, or an unknown other hand."""
    sure = affordance_intersect.run(*scene((2, -1)), EXACT).quality[0]
    far = affordance_intersect.run(*scene((2, -1), contact_distance=np.full((2, 1), 60, np.int32)), EXACT).quality[0]
    vague = affordance_intersect.run(*scene((2, -1), confidence=np.full((4, 1), 0.25, np.float32)), EXACT).quality[0]
    assert (sure, far, vague) == (1, 0.5, 0.5)
    assert affordance_intersect.run(*scene((2, -2)), EXACT).quality[0] == 0.5
    assert affordance_intersect.run(*scene((-1, -1)), EXACT).quality[0] == 0


def test_another_size_is_refused() -> None:
    """Complete masks of another resolution give one clear sentence."""
    tracks, complete = scene((2, -1))
    with pytest.raises(ValueError, match="expected masks of"):
        affordance_intersect.run(tracks, replace(complete, masks=complete.masks[..., ::2]), EXACT)
