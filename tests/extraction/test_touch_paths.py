"""Laws of the choice of touched objects over time, on drawn candidates before a still camera."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import pytest

from afford.extraction.hands import touch_paths
from afford.extraction.hands.motion import SampledFrames
from afford.extraction.hands.touch_candidates import Candidates
from afford.extraction.hands.touch_paths import PathModel, carried, fill_between, touch_path

HEIGHT, WIDTH, COUNT, EVERY = 48, 80, 21, 5
Y, X = np.mgrid[:HEIGHT, :WIDTH]
CUP, PLATE = (abs(X - 30) < 8) & (abs(Y - 20) < 8), (abs(X - 60) < 8) & (abs(Y - 30) < 8)
MODEL = PathModel(touch=0.0, same=2.0, change=1.0, unsure=-1.0)
SHOWN = range(0, COUNT, EVERY)


@pytest.fixture(autouse=True)
def first_feature(monkeypatch: pytest.MonkeyPatch) -> None:
    """The score of a candidate is its first feature."""
    monkeypatch.setattr(touch_paths, "touch_scores", lambda features: features[:, 0].astype(np.float64))


def still(count: int = COUNT, cut: int | None = None) -> SampledFrames:
    """Sampled frames without motion, with a cut before frame `cut`."""
    flow = np.zeros((HEIGHT // 2, WIDTH // 2, 2), np.float32)
    back = [None if k in (0, cut) else flow for k in range(count)]
    forth = [None if k + 1 in (count, cut) else flow for k in range(count)]
    return SampledFrames(np.arange(count), np.zeros((count, HEIGHT, WIDTH, 3), np.uint8), np.arange(count) / 10, back, forth)


def candidates(scores: dict[str, float]) -> Candidates:
    masks = [{"cup": CUP, "plate": PLATE}[name] for name in scores]
    features = np.array([[score] for score in scores.values()], np.float32).reshape(-1, 1)
    return Candidates(np.array(masks, bool).reshape(-1, HEIGHT, WIDTH), features)


def names(frames: Sequence[dict[str, float]]) -> list[str]:
    """Names of the objects chosen in consecutive segmented frames, '' for no touch."""
    path = touch_path({k: candidates(scores) for k, scores in zip(SHOWN, frames, strict=False)}, still(), MODEL)
    word = {CUP.tobytes(): "cup", PLATE.tobytes(): "plate"}
    return ["" if mask is None else word[mask.tobytes()] for mask in path.masks.values()]


def test_likely_objects_are_touched() -> None:
    """Above 0 an object is touched in every frame, below it in none; nothing is chosen where there is no candidate."""
    assert names([{"cup": 1.0}] * 5) == ["cup"] * 5
    assert names([{"cup": -3.0}] * 5) == [""] * 5
    assert names([{}] * 5) == [""] * 5 and names([]) == []


def test_one_frame_does_not_change_the_object() -> None:
    """A better candidate in a single frame, and a frame in which the object is unlikely, do not interrupt a touch."""
    both = {"cup": 1.0, "plate": 0.5}
    assert names([both, both, {"cup": 0.5, "plate": 1.5}, both, both]) == ["cup"] * 5
    assert names([both, both, {"cup": -1.0, "plate": -3.0}, both, both]) == ["cup"] * 5


def test_another_object_is_touched_when_it_stays() -> None:
    """Two frames of each."""
    first, second = {"cup": 3.0, "plate": -3.0}, {"cup": -3.0, "plate": 3.0}
    assert names([first, first, second, second]) == ["cup", "cup", "plate", "plate"]


def test_a_nearly_likely_touch_is_unsure() -> None:
    """Frames without a touch whose best candidate is not far below; not frames with a touch."""
    path = touch_path({0: candidates({"cup": -0.5}), 5: candidates({"cup": -3.0}), 10: candidates({})}, still(), MODEL)
    assert path.unsure == (0,) and set(path.masks.values()) == {None}
    assert touch_path({0: candidates({"cup": 2.0})}, still(), MODEL).unsure == ()


def test_objects_are_carried_to_the_frames_between() -> None:
    """Each sampled frame takes the nearer segmented one, loses the pixels of hands, and has nothing where the hand is hidden."""
    path = touch_path({0: candidates({"cup": 3.0}), 10: candidates({"plate": 3.0})}, still(), MODEL)
    hands = [np.zeros((HEIGHT, WIDTH), bool)] * COUNT
    visible = {k: CUP for k in range(COUNT) if k != 3}
    out = fill_between(path, visible, hands, still(), range(COUNT))
    assert set(out) == set(visible)
    assert np.array_equal(out[4], CUP) and np.array_equal(out[6], PLATE) and np.array_equal(out[20], PLATE)
    hidden = fill_between(path, visible, [X > 55] * COUNT, still(), range(COUNT))
    assert np.array_equal(hidden[6], PLATE & ~(X > 55))


def test_masks_are_not_carried_across_a_cut() -> None:
    """Forwards and backwards the mask is empty behind the cut, and unchanged before it."""
    sampled = still(cut=5)
    assert np.array_equal(carried(CUP, 0, 4, sampled), CUP) and not carried(CUP, 0, 5, sampled).any()
    assert np.array_equal(carried(CUP, 8, 5, sampled), CUP) and not carried(CUP, 8, 4, sampled).any()
