"""Laws of regions of hands that colours propose."""

from __future__ import annotations

import numpy as np

from afford.extraction.hands.proposals import HandColours
from afford.extraction.landmarks.region import Region
from tests.helpers.made_landmarks import FLAT, SIZE_WH, MadeHand, made_video, still

GLOVE = (30, 60, 190)


def near(regions: list[Region], hand: MadeHand) -> bool:
    """Test whether a region has the middle of a hand in its inner half."""
    x, y = hand.points(0).mean(0) * 4
    return any(abs(one.x_px - x) < one.side_px / 4 and abs(one.y_px - y) < one.side_px / 4 for one in regions)


def picture(hands: list[MadeHand]) -> np.ndarray:
    """Draw the hands over a table, four times as large."""
    return np.asarray(made_video(hands)[0].rgb[0].repeat(4, 0).repeat(4, 1))


def test_skin_proposes_hands() -> None:
    """Regions lie where there is skin, with both directions of the fingers; a blue table has none."""
    hand = MadeHand(still(200, 120, 1), sleeve=(40, 60, 160))
    found = HandColours().regions(picture([hand]), [])
    assert near(found, hand) and {one.angle_rad for one in found} == {0.0, -np.pi}
    assert not HandColours().regions(np.full((720, 1280, 3), (60, 90, 160), np.uint8), [])


def test_a_known_hand_is_not_proposed() -> None:
    hand = MadeHand(still(200, 120, 1), sleeve=(40, 60, 160))
    assert not near(HandColours().regions(picture([hand]), [4 * hand.points(0)]), hand)


def test_colours_of_known_hands_propose_the_other_one() -> None:
    """A glove is proposed once another one was found."""
    hands = [MadeHand(still(80, 120, 1), colour=GLOVE, sleeve=(120, 120, 120)),
             MadeHand(still(240, 120, 1), colour=GLOVE, sleeve=(120, 120, 120))]  # fmt: skip
    rgb, colours = picture(hands), HandColours()
    assert not near(colours.regions(rgb, []), hands[1])
    colours.learn(rgb, [4 * hands[0].points(0)])
    assert near(colours.regions(rgb, [4 * hands[0].points(0)]), hands[1])


def test_regions_stay_in_the_picture() -> None:
    rgb = np.full((SIZE_WH[1], SIZE_WH[0], 3), (205, 150, 125), np.uint8)
    found = HandColours().regions(rgb, [FLAT * 20 + 100])
    assert found and all(0 <= one.x_px <= SIZE_WH[0] and 0 <= one.y_px <= SIZE_WH[1] for one in found)
