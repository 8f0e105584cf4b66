"""Laws of the search of a clip for hands, with networks that answer from a list."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from afford.extraction.hands.proposals import HandColours
from afford.extraction.landmarks.landmarks import Landmarks
from afford.extraction.landmarks.palm import Palm
from afford.extraction.landmarks.parameters import Search
from afford.extraction.landmarks.region import Region
from afford.extraction.landmarks.search import HandSearch, best_palms, unique, window_around, windows
from tests.helpers.made_landmarks import FLAT

SIZE_WH = (640, 360)
SIDE_PX = 80.0


class Palms:
    """Detects the palms of chosen frames, whose number is their colour."""

    def __init__(self, where: np.ndarray, frames: Sequence[int], min_share: float = 0.0) -> None:
        self.where, self.frames, self.min_share, self.asked = where, frames, min_share, 0

    def detect(self, rgb: np.ndarray, min_score: float, window: tuple[float, float, float]) -> list[Palm]:
        self.asked += 1
        at, (x, y, side) = self.where[int(rgb[0, 0, 0])], window
        inside = x <= at[0] <= x + side and y <= at[1] <= y + side
        if int(rgb[0, 0, 0]) not in self.frames or not inside or SIDE_PX / side < self.min_share:
            return []
        return [Palm(0.8, np.array([*(at - 20), *(at + 20)]), np.tile(at, (7, 1)) + np.array([[0, 20], *[[0, -20]] * 6]))]


class Hands:
    """Presence near 1 in regions around the hand, which is shown in some frames."""

    def __init__(self, where: np.ndarray, shown: Sequence[int]) -> None:
        self.where, self.shown = where, shown

    def landmarks(self, rgb: np.ndarray, region: Region) -> Landmarks:
        t = int(rgb[0, 0, 0])
        at = self.where[t]
        near = bool(np.hypot(region.x_px - at[0], region.y_px - at[1]) < SIDE_PX) and t in self.shown
        points = at + FLAT * 40 + (0, 30) if near else np.array([region.x_px, region.y_px]) + FLAT
        return Landmarks(points, np.zeros(21), np.zeros((21, 3)), 0.95 if near else 0.01, 0.5, region)


def frames(count: int) -> np.ndarray:
    """Pictures whose colour is their number."""
    return np.arange(count, dtype=np.uint8)[:, None, None, None] * np.ones((1, SIZE_WH[1], SIZE_WH[0], 3), np.uint8)


def search(where: np.ndarray, palms: Palms, shown: Sequence[int], **params: float) -> list[list[Landmarks]]:
    made = HandSearch(palms, Hands(where, shown), Search(**params), HandColours())  # type: ignore[arg-type]  # stand-ins for the networks
    return made.search(frames(len(where)))


def test_windows_cover_the_picture() -> None:
    """Every pixel is in a window; windows overlap and stay inside; one with a margin contains the picture."""
    for height, width in ((360, 640), (640, 360), (200, 1000), (400, 420)):
        rgb = np.zeros((height, width, 3), np.uint8)
        for share in (1.0, 0.5):
            seen = np.zeros((height, width), bool)
            for x, y, side in windows(rgb, share):
                assert x >= 0 and y >= 0 and x + side <= width + 1e-6 and y + side <= height + 1e-6
                seen[int(y) : int(np.ceil(y + side)), int(x) : int(np.ceil(x + side))] = True
            assert seen.all() or not windows(rgb, share)
        x, y, side = window_around(rgb, 1.3)
        assert x < 0 and y < 0 and x + side > width and y + side > height


def test_a_hand_is_tracked_both_ways() -> None:
    """One detected palm is enough: its hand is tracked to the first and the last frame that shows it."""
    where = np.linspace((200, 180), (300, 180), 10)
    found = search(where, Palms(where, (4,)), range(2, 9))
    assert [len(here) for here in found] == [0, 0, *[1] * 7, 0]


def test_small_hands_need_small_windows() -> None:
    """A palm that is small in the whole picture is found in fine windows, also between the frames that are searched so."""
    where = np.tile(np.array([(520.0, 90.0)]), (9, 1))
    small = Palms(where, range(9), min_share=0.4)
    assert all(len(here) == 1 for here in search(where, small, range(9)))
    assert not any(search(where, Palms(where, range(9), min_share=0.4), range(9), fine_every=0))


def test_repeated_palms_and_hands_are_one() -> None:
    """The same palm in several windows, and the same hand from several palms, count once."""
    palm = Palm(0.5, np.array([10.0, 10, 50, 50]), np.zeros((7, 2)))
    better = Palm(0.9, np.array([12.0, 12, 52, 52]), np.zeros((7, 2)))
    other = Palm(0.4, np.array([200.0, 10, 240, 50]), np.zeros((7, 2)))
    assert best_palms([palm, better, other]) == [better, other]
    region = Region(0, 0, 10)
    hand, same, away = (Landmarks(FLAT * 30 + x, np.zeros(21), np.zeros((21, 3)), p, 0.5, region)
                        for x, p in ((100, 0.7), (105, 0.9), (200, 0.5)))  # fmt: skip
    assert unique([hand, same, away]) == [same, away]
