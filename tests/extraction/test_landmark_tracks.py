"""Laws of tracks of landmarks: links over time and gaps, crossing hands, and evidence."""

from __future__ import annotations

import numpy as np

from afford.extraction.hands.landmark_tracks import landmark_tracks
from afford.extraction.landmarks.geometry import palm_centre
from tests.helpers.made_landmarks import SIZE_WH, MadeHand, made_video, path

COUNT = 20
RUNS = [range(COUNT)]


def tracks(hands: list[MadeHand], runs: list[range] | None = None):  # type: ignore[no-untyped-def]  # tracks
    return landmark_tracks(made_video(hands)[1], SIZE_WH[0], runs or RUNS, 1.2, 0.6)


def test_each_hand_is_one_track() -> None:
    """Two moving hands are two tracks with all their frames, at working size."""
    hands = [MadeHand(path((60, 120), (120, 140), COUNT)), MadeHand(path((250, 120), (200, 130), COUNT))]
    found = tracks(hands)
    assert [sorted(one.found) for one in found] == [list(range(COUNT))] * 2
    for one in found:
        assert min(max(np.abs(one.found[t].points_px - hand.points(t)).max() for t in one.found) for hand in hands) < 0.01


def test_a_lost_hand_continues_its_track() -> None:
    """A hand that is lost for a second and comes back nearby is the same; one far away is another."""
    near = [MadeHand(path((100, 120), (130, 120), COUNT), found=(*range(5), *range(15, COUNT)))]
    far = [MadeHand(path((40, 120), (300, 120), COUNT), found=(*range(4), *range(17, COUNT)))]
    assert len(tracks(near)) == 1 and len(tracks(far)) == 2


def test_a_gap_of_the_video_ends_a_track() -> None:
    assert len(tracks([MadeHand(path((100, 120), (130, 120), COUNT))], [range(10), range(10, COUNT)])) == 2


def test_crossing_hands_keep_their_tracks() -> None:
    """Hands that pass each other keep moving as before."""
    hands = [MadeHand(path((60, 100), (250, 100), COUNT)), MadeHand(path((250, 130), (60, 130), COUNT), left=True)]
    found = tracks(hands)
    assert len(found) == 2
    for one in found:
        x = [palm_centre(one.found[t].points_px)[0] for t in sorted(one.found)]
        assert np.all(np.diff(x) > 0) or np.all(np.diff(x) < 0)


def test_repeated_detections_are_one() -> None:
    """Two detections of one hand in one frame count once."""
    hand = MadeHand(path((100, 120), (130, 120), COUNT))
    twice = MadeHand(hand.wrist_px + 2, presence=0.7)
    found = tracks([hand, twice])
    assert len(found) == 1 and found[0].certainty > 0.9


def test_two_readings_of_one_hand_are_one() -> None:
    """A reading that is turned around the same place, and mostly covers the other one, is the same hand."""
    hand = MadeHand(path((100, 120), (130, 120), COUNT))
    turned = MadeHand(hand.wrist_px + (-10, -45), palm_px=25.0, down=True, presence=0.7)
    assert len(tracks([hand, turned])) == 1
