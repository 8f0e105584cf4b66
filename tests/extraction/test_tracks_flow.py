"""Laws of the propagation backends that need no weights, and of the parts that `flow` is made of."""

from __future__ import annotations

import cv2
import numpy as np
import pytest

from afford.common.masks import region_similarity
from afford.common.optical_flow import compose_flow, flow_between
from afford.extraction.tracks import UNKNOWN, Flow, flow
from afford.extraction.tracks.densify import dense, nearest
from afford.extraction.tracks.match import UNMATCHED, coarse_to_fine_flow, padded_lab, patch_match
from tests.helpers.moving_shapes import CUP, HAND, film, texture

PARAMS = Flow(search_px=1, band_px=4)
BACKENDS = (flow.propagate, nearest, dense)


def arm(t: int) -> tuple[np.ndarray, np.ndarray]:
    """A bar that comes from the right by 20 px per frame: rgb (h, w, 3) uint8 and its mask (h, w)."""
    ground, skin = texture(3, (120, 120, 110))[:112, :160], texture(4, (200, 150, 120))
    mask = np.zeros((112, 160), bool)
    left = 170 - 20 * t
    mask[40:70, max(left, 0) :] = left < 160
    shifted = np.roll(skin, left, axis=1)[:112, :160]
    return np.clip(np.where(mask[..., None], shifted, ground), 0, 255).astype(np.uint8), mask


@pytest.mark.parametrize("propagate", BACKENDS)
def test_key_labels_are_kept_and_unknown_pixels_are_no_entity(propagate) -> None:
    """Key frames keep their labels, with unknown pixels as background; confidence is 1 for visible entities, else 0."""
    rgb, truth = film(5)
    keys = truth[[0, 4]].copy()
    keys[0][keys[0] == CUP] = UNKNOWN
    found = propagate(rgb, np.array([0, 4]), keys, 2, PARAMS)
    assert np.array_equal(found.labels[0], np.where(keys[0] == UNKNOWN, 0, keys[0])) and np.array_equal(found.labels[4], keys[1])
    assert found.confidence[:, [0, 4]].T.tolist() == [[1, 0], [1, 1]]
    assert found.labels.min() >= 0 and found.confidence.min() >= 0 and found.confidence.max() <= 1


@pytest.mark.parametrize("propagate", BACKENDS)
def test_a_run_of_one_frame_and_a_key_frame_without_entities(propagate) -> None:
    """One annotated frame is its own answer; nothing annotated gives nothing."""
    rgb, truth = film(2)
    assert np.array_equal(propagate(rgb[:1], np.array([0]), truth[:1], 2, PARAMS).labels, truth[:1])
    empty = propagate(rgb, np.array([1]), np.zeros_like(truth[:1]), 0, PARAMS)
    assert not empty.labels.any() and empty.confidence.shape == (0, 2)


def test_frames_beyond_the_last_key_frame_are_reached_from_it() -> None:
    """A single key frame in the middle is propagated to both sides."""
    rgb, truth = film(7)
    found = flow.propagate(rgb, np.array([3]), truth[[3]], 2, PARAMS)
    for t in (0, 6):
        assert region_similarity(found.labels[t] == HAND, truth[t] == HAND) > 0.85


def test_an_arm_that_is_too_fast_for_flow_is_followed() -> None:
    """An arm that only the last frame shows is traced back to the border at 20 px per frame, and is absent before."""
    rgb, masks = (np.stack(part) for part in zip(*(arm(t) for t in range(8)), strict=True))
    keys = masks[[0, 7]].astype(np.int16)
    found = flow.propagate(rgb, np.array([0, 7]), keys, 1, PARAMS)
    assert not masks[0].any() and all(region_similarity(found.labels[t] == 1, masks[t]) > 0.85 for t in range(2, 7))


def test_following_two_flows_adds_up() -> None:
    """A shift by a, then by b, is a shift by a + b."""
    a, b = np.full((6, 8, 2), (1.0, 0.5), np.float32), np.full((6, 8, 2), (-2.0, 1.0), np.float32)
    assert np.allclose(compose_flow(a, b), (-1.0, 1.5))


def test_flow_between_shifted_images_is_the_shift() -> None:
    """Moving a textured picture by (3, -2) px gives that flow nearly everywhere, with and without a start."""
    picture = cv2.cvtColor(np.clip(texture(5, (128, 128, 128)), 0, 255).astype(np.uint8), cv2.COLOR_RGB2GRAY)
    a, b = picture[10:110, 10:150].copy(), picture[12:112, 7:147].copy()
    for start in (None, np.full((100, 140, 2), (3, -2), np.float32)):
        assert np.abs(np.median(flow_between(a, b, start=start), axis=(0, 1)) - (3, -2)).max() < 0.1


def test_coarse_search_finds_fast_motion() -> None:
    """Most pixels of a bar that jumps by 20 px get the jump as their flow to the previous frame."""
    (last, before), (rgb, here) = arm(4), arm(5)
    grey = [cv2.cvtColor(image, cv2.COLOR_RGB2GRAY) for image in (rgb, last)]
    step = coarse_to_fine_flow(*grey, before.astype(np.int16))
    jumped = (here & np.roll(before, -20, axis=1))[..., None] & (np.abs(step - (20, 0)) < 2)
    assert jumped.all(axis=2).sum() > 0.8 * (here & np.roll(before, -20, axis=1)).sum()


def test_a_patch_is_found_in_its_own_entity() -> None:
    """A pixel costs little for the entity it shows, and stays unmatched for entities that the key frame does not show."""
    rgb, truth = film(1)
    where = np.argwhere(truth[0] == HAND)[::40]
    cost = np.full((len(where), 4), UNMATCHED, np.float32)
    same = padded_lab(rgb[0])
    patch_match(same, same, truth[0], np.zeros((*truth[0].shape, 2), np.float32), where, 1, np.float32(0), cost)
    assert (cost[:, HAND] == 0).all() and (cost[:, 3] == UNMATCHED).all()


def test_nearest_copies_the_earlier_key_frame_on_a_tie() -> None:
    """Five frames between two keys: the middle one repeats the first."""
    rgb, truth = film(5)
    found = nearest(rgb, np.array([0, 4]), truth[[0, 4]], 2, PARAMS)
    assert np.array_equal(found.labels[2], truth[0]) and np.array_equal(found.labels[3], truth[4])
    assert (np.diff(found.confidence[0, :3]) < 0).all()
