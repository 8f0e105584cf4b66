"""Laws of mask_densify: what is annotated stays, what is linked, what is flagged, what each hand touches."""

from __future__ import annotations

import numpy as np
import pytest

from afford.common.masks import region_similarity
from schemas.masks import TrackFlag
from stages.extraction.mask_densify import Params, run
from tests.helpers.moving_shapes import CUP, HAND, HEIGHT_PX, WIDTH_PX, annotate, clip_of, film, frames_of, key_frame

LAST = 9


@pytest.fixture(scope="module")
def shot() -> tuple[np.ndarray, np.ndarray]:
    return film(LAST)


def both(number: int, labels: np.ndarray, contact: str = "cup") -> object:
    """Key frame with the hand on the cup."""
    said = f"cup@{number}" if contact == "cup" else contact
    hand = annotate(number, labels[number - 1] == HAND, "right hand", "right", said)
    return key_frame(number, hand, annotate(number, labels[number - 1] == CUP, "cup"))


def test_key_masks_are_kept_and_others_follow(shot) -> None:
    """Masks at key frames are the annotator's; between them they follow the truth better than a copy; nothing overlaps."""
    rgb, labels = shot
    clip, frames = clip_of([both(1, labels), both(LAST, labels)], LAST), frames_of(rgb)
    tracks = run(clip, frames, Params())
    assert [e.entity_id for e in tracks.entities] == ["right hand", "cup"]
    assert np.array_equal(tracks.masks[0, 0], labels[0] == HAND) and np.array_equal(tracks.masks[1, -1], labels[-1] == CUP)
    assert (tracks.masks.sum(axis=0) <= 1).all()
    copied = run(clip, frames, Params(backend="nearest"))
    for i, label in enumerate((HAND, CUP)):
        for t in range(1, LAST - 1):
            truth = labels[t] == label
            assert region_similarity(tracks.masks[i, t], truth) > 0.93
            assert region_similarity(tracks.masks[i, t], truth) >= region_similarity(copied.masks[i, t], truth)
    assert (tracks.confidence[:, [0, -1]] == 1).all() and (tracks.confidence[:, 1:-1] > 0).all()


def test_provenance_names_the_nearest_key_frame(shot) -> None:
    """source_frame and distance say which key frame a mask leans on; KEY marks the annotated frames only."""
    rgb, labels = shot
    tracks = run(clip_of([both(1, labels), both(LAST, labels)], LAST), frames_of(rgb), Params())
    assert tracks.source_frame[0].tolist() == [1, 1, 1, 1, 1, 9, 9, 9, 9]
    assert tracks.distance[0].tolist() == [0, 1, 2, 3, 4, 3, 2, 1, 0]
    assert np.flatnonzero(tracks.flags[1] & TrackFlag.KEY).tolist() == [0, LAST - 1]


def test_the_same_input_gives_the_same_bytes(shot) -> None:
    """Two runs agree, and the inputs are unchanged."""
    rgb, labels = shot
    clip, frames = clip_of([both(1, labels), both(LAST, labels)], LAST), frames_of(rgb.copy())
    first, second = run(clip, frames, Params()), run(clip, frames, Params())
    for name in ("masks", "confidence", "flags", "source_frame", "distance", "contact"):
        assert getattr(first, name).tobytes() == getattr(second, name).tobytes()
    assert np.array_equal(frames.rgb, rgb)


def test_an_entering_hand_is_flagged_and_found() -> None:
    """A hand that only the later key frame shows is ENTERING in between and follows the truth once in sight."""
    rgb, labels = film(LAST, entering=True)
    assert not (labels[0] == HAND).any()
    first = key_frame(1, annotate(1, labels[0] == CUP, "cup"))
    tracks = run(clip_of([first, both(LAST, labels)], LAST), frames_of(rgb), Params())
    assert (tracks.flags[0, 1:-1] & TrackFlag.ENTERING).all() and not (tracks.flags[1] & TrackFlag.ENTERING).any()
    assert not tracks.masks[0, 0].any() and tracks.source_frame[0, 0] == -1
    assert region_similarity(tracks.masks[0, LAST - 3], labels[LAST - 3] == HAND) > 0.85


def test_motion_is_not_chained_across_missing_frames(shot) -> None:
    """Tracks of key frames with a gap between them are the key masks."""
    rgb, labels = shot
    numbers = np.array([1, 40, 41])
    clip = clip_of([both(1, labels)], 41)
    tracks = run(clip, frames_of(rgb[[0, 5, 6]], numbers), Params())
    assert np.array_equal(tracks.masks[0, 0], labels[0] == HAND)
    assert not tracks.masks[:, 1:].any()
    assert (tracks.contact[:, 1:] == -2).all() and (tracks.contact_distance[:, 1:] == -1).all()


def test_radius_limits_how_far_a_mask_may_be_from_its_key_frame(shot) -> None:
    """radius=2 keeps masks up to two frames from a key frame that shows the entity, and none beyond."""
    rgb, labels = shot
    tracks = run(clip_of([both(1, labels), both(LAST, labels)], LAST), frames_of(rgb), Params(radius=2))
    assert tracks.masks.any(axis=(2, 3))[0].tolist() == [True] * 3 + [False] * 3 + [True] * 3
    assert (tracks.confidence[0, 3:6] == 0).all() and (tracks.source_frame[0, 3:6] == -1).all()


@pytest.mark.parametrize(("contact", "expected"), [("cup", 1), ("hand-not-in-contact", -1), ("inconclusive", -2), ("", 1)])
def test_contact_is_carried_from_key_frames(shot, contact: str, expected: int) -> None:
    """Agreeing key frames decide every frame between them; '' is derived from the masks; an absent hand touches nothing."""
    rgb, labels = shot
    clip = clip_of([both(1, labels, contact), both(LAST, labels, contact)], LAST)
    tracks = run(clip, frames_of(rgb), Params(keep_untouched=True))
    assert (tracks.contact[1] == expected).all() and (tracks.contact[0] == -1).all()
    assert tracks.contact_distance[1].tolist() == [0, 1, 2, 3, 4, 3, 2, 1, 0]


def test_contact_switches_where_the_masks_part() -> None:
    """Key frames that disagree: the hand touches the cup from about the frame in which its mask reaches it."""
    rgb, labels = film(LAST, entering=True)
    first = key_frame(1, annotate(1, labels[0] == CUP, "cup"))
    tracks = run(clip_of([first, both(LAST, labels)], LAST), frames_of(rgb), Params())
    contact = tracks.contact[1] == 1
    assert contact[-1] and not contact[0] and (np.diff(contact.astype(int)) >= 0).all()
    reached = [bool((tracks.masks[0, t, 4:] & tracks.masks[1, t, :-4]).any()) for t in range(LAST)]
    assert abs(int(contact.argmax()) - reached.index(True)) <= 1


def test_untouched_objects_are_dropped_unless_asked_for(shot) -> None:
    """keep_untouched decides whether an object that no hand ever touches becomes an entity."""
    rgb, labels = shot
    clip, frames = clip_of([both(1, labels, "hand-not-in-contact")], LAST), frames_of(rgb)
    assert [e.name for e in run(clip, frames, Params()).entities] == ["right hand"]
    assert [e.name for e in run(clip, frames, Params(keep_untouched=True)).entities] == ["right hand", "cup"]


def test_same_name_objects_are_followed_by_overlap() -> None:
    """Two blocks annotated in swapped order stay two entities, each where it moved to."""
    rgb, labels = film(LAST)
    left, right = labels == CUP, labels == HAND
    keys = [
        key_frame(1, annotate(1, left[0], "block"), annotate(100, right[0], "block")),
        key_frame(LAST, annotate(LAST, right[-1], "block"), annotate(900, left[-1], "block")),
    ]
    tracks = run(clip_of(keys, LAST), frames_of(rgb), Params(keep_untouched=True))
    assert [e.entity_id for e in tracks.entities] == ["block#1", "block#2"]
    assert np.array_equal(tracks.masks[0, -1], left[-1]) and np.array_equal(tracks.masks[1, -1], right[-1])


def test_one_mask_for_both_hands_is_no_entity(shot) -> None:
    """A glove on both hands is neither left nor right: its pixels are unknown, no hand is made of it."""
    rgb, labels = shot
    glove = annotate(1, labels[0] == HAND, "gloves", "both", "cup@1")
    clip = clip_of([key_frame(1, glove, annotate(1, labels[0] == CUP, "cup"))], LAST)
    tracks = run(clip, frames_of(rgb), Params(keep_untouched=True))
    assert [e.entity_id for e in tracks.entities] == ["cup"]


def test_a_clip_without_a_decoded_key_frame_is_refused(shot) -> None:
    """The error names the clip and what is missing."""
    rgb, labels = shot
    with pytest.raises(ValueError, match=r"T01_01.*key frame"):
        run(clip_of([both(LAST, labels)], LAST), frames_of(rgb[:4]), Params())


def test_dense_takes_ready_made_masks(shot) -> None:
    """backend=dense copies dense key frames; the others ignore them."""
    rgb, labels = shot
    ready = [key_frame(n, annotate(n, labels[n - 1] == CUP, "cup")) for n in range(2, LAST)]
    ready = [type(k)(k.frame, WIDTH_PX, HEIGHT_PX, k.annotations, True) for k in ready]
    clip = clip_of([both(1, labels), *ready, both(LAST, labels)], LAST)
    tracks = run(clip, frames_of(rgb), Params(backend="dense"))
    assert all(np.array_equal(tracks.masks[1, t], labels[t] == CUP) for t in range(LAST))
    assert not tracks.masks[0, 1:-1].any()
    assert np.flatnonzero(run(clip, frames_of(rgb), Params()).flags[1] & TrackFlag.KEY).tolist() == [0, LAST - 1]
