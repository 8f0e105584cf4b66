"""Laws of touched objects with promptable segmentation, on a still scene in which motion shows nothing."""

from __future__ import annotations

import numpy as np

from afford.common.masks import iou
from afford.extraction.hands.held_objects import NOTHING, ContactModel, TouchedObjects, touched_objects
from afford.extraction.hands.motion import SampledFrames, sample_frames
from afford.extraction.hands.object_evidence import EvidenceModel, HandMasks
from afford.extraction.hands.touch_paths import PathModel
from afford.extraction.prompted import AtPoint, Outlines
from afford.extraction.sources.narrations import default_narration
from schemas.video import Clip, Frames
from stages.extraction import hand_detect
from tests.helpers.made_landmarks import MadeHand, made_video, path

HEIGHT, WIDTH, COUNT = 96, 160, 16
Y, X = np.mgrid[:HEIGHT, :WIDTH]
HAND, CUP = (abs(X - 60) < 10) & (abs(Y - 60) < 12), (abs(X - 82) < 13) & (abs(Y - 58) < 11)
EVIDENCE = EvidenceModel(5.0, 3.0, 8.0, 0.9, 70.0, False)


def still() -> SampledFrames:
    """Sample a still picture of a hand at a cup, ten times a second."""
    rgb = np.random.default_rng(2).integers(80, 200, (HEIGHT, WIDTH, 3)).astype(np.uint8)
    rgb[CUP], rgb[HAND] = (40, 60, 170), (224, 172, 140)
    time_ns = (np.arange(COUNT) * 1e8).astype(np.int64)
    return sample_frames(Frames("made", np.arange(1, COUNT + 1), time_ns, np.repeat(rgb[None], COUNT, 0)), 0.1)


def found(quality: float, touch: float, shown: np.ndarray = CUP, segment: bool = True,
          pictures: list[np.ndarray] | None = None) -> TouchedObjects:  # fmt: skip
    """Find the touched objects with a segmentation that knows one outline, of this expected quality, and keep its `pictures`."""
    def at(point: tuple[float, float]) -> Outlines:
        x, y = round(point[0]), round(point[1])
        return Outlines(np.where(shown & shown[y, x], 5.0, -5.0).astype(np.float32)[None], np.array([quality], np.float32))

    def segmenter(rgb: np.ndarray) -> AtPoint:
        if pictures is not None:
            pictures.append(rgb)
        return at

    model = ContactModel(4, 60.0, 0.2, 15, 3, PathModel(touch, 1.0, 0.5, -1.0), 0.5)
    hands: HandMasks = {"left": dict.fromkeys(range(COUNT), HAND), "right": {}}
    return touched_objects(still(), hands, {}, EVIDENCE, model, segment=segmenter if segment else None)


def test_an_object_that_rests_is_found_by_its_outline() -> None:
    """One object, the cup, touched in every frame by the hand that is at it, though only every fifth frame is segmented."""
    pictures: list[np.ndarray] = []
    result = found(0.95, 3.0, pictures=pictures)
    (one,) = result.objects
    assert len(pictures) == 4
    assert (result.contact["left"] == 0).all() and (result.contact["right"] == NOTHING).all() and result.reasons == ()
    assert all(iou(one.segments[k].mask, CUP & ~HAND) > 0.95 for k in range(COUNT))


def test_an_object_that_rests_is_not_found_by_motion() -> None:
    """The same scene without segmentation has no touched object."""
    result = found(0.95, 3.0, segment=False)
    assert result.objects == [] and (result.contact["left"] == NOTHING).all()


def test_an_uncertain_outline_gives_no_object() -> None:
    """A likelier touch gives more: nothing, then one sentence with the times, then the object alone."""
    seen = []
    for touch in np.arange(-3.0, 5.0, 0.25):
        result = found(0.9, float(touch))
        said = [text.startswith("a hand may touch something near 0.0, 0.5, 1.0, 1.5 s") for text in result.reasons]
        assert said in ([], [True]) and bool(result.objects) == bool((result.contact["left"] != NOTHING).any())
        seen.append("object" if result.objects else "unsure" if said else "nothing")
        assert not (result.objects and said)
    order = ["nothing", "unsure", "object"]
    assert set(seen) == set(order) and seen == sorted(seen, key=order.index)


def test_an_object_away_from_the_hand_is_not_touched() -> None:
    """An outline away from the hand is no candidate, however certain it is."""
    assert found(1.0, 9.0, shown=(abs(X - 140) < 12) & (abs(Y - 20) < 10)).objects == []


def test_the_stage_warns_where_set_up_has_no_networks() -> None:
    """One sentence, but none when `none` was asked for."""
    frames, landmarks = made_video([MadeHand(path((210, 130), (240, 125), 12))])
    clip = Clip("made", "made", "made", "", ("made.mp4",), "video", 10.0, False, 1, 12, (), (default_narration(1, 12),), ())
    for chosen, said in (("mobile_sam", True), ("none", False)):
        params = hand_detect.Params(segment=chosen)  # type: ignore[arg-type]  # one of two
        found = hand_detect.run(clip, frames, params, landmarks)
        assert any("by motion alone" in text for text in found.clip.warnings) == said
