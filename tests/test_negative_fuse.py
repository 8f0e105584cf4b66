"""What candidates say of pixels: parts compete, sure ones count most, and what fits nothing does not count."""

from __future__ import annotations

import numpy as np
import pytest

from afford.negative.fuse import judged, pixels
from schemas.negative import PartCandidates, PartDescription, PartNote, PartScores


def description(*roles: str) -> PartDescription:
    notes = tuple(PartNote(f"p{n}", f"the p{n}", role, "", 1.0, False) for n, role in enumerate(roles))  # type: ignore[arg-type]
    return PartDescription("x", "thing", "use", notes, "rules")


def scores(*rows: tuple[float, ...]) -> PartScores:
    share = np.array(rows, np.float32)
    return PartScores("x", share, share.copy())


def test_what_fits_better_wins_even_where_nothing_fits_well() -> None:
    """Only the ratio counts: 0.2 to 0.1 is as 0.8 to 0.4; neutral parts compete as well."""
    value, sure = judged(scores((0.2, 0.1), (0.8, 0.4)), description("negative", "positive"))
    assert value == pytest.approx([0.8, 0.8]) and sure[0] == pytest.approx(sure[1])
    value, _ = judged(scores((0.5, 0.5, 0.5)), description("negative", "positive", "neutral"))
    assert value == pytest.approx([1 / 3])


def test_sure_candidates_count_most_and_misfits_not_at_all() -> None:
    """All alike: next to nothing; below the threshold: nothing; certain: most."""
    _, sure = judged(scores((0.5, 0.5), (0.05, 0.0), (0.9, 0.01), (0.6, 0.3)), description("negative", "positive"))
    assert sure[1] == 0 and sure[0] < 0.05 < sure[3] < sure[2]


def test_pixels_take_the_weighted_mean_of_what_covers_them() -> None:
    """Where a sure and an unsure mask overlap the sure one prevails; where nothing covers there is no weight."""
    masks = np.zeros((2, 1, 4), bool)
    masks[0, 0, :2], masks[1, 0, 1:3] = True, True
    candidates = PartCandidates("x", np.zeros(2, np.int16), masks, np.ones(2, np.float32))
    value, weight = pixels(candidates, scores((0.9, 0.01), (0.4, 0.6)), description("negative", "positive"), (1, 1, 4))
    said, sure = judged(scores((0.9, 0.01), (0.4, 0.6)), description("negative", "positive"))
    assert value[0, 0, [0, 2]] == pytest.approx(said) and weight[0, 0, 3] == value[0, 0, 3] == 0
    assert value[0, 0, 1] == pytest.approx((said * sure).sum() / sure.sum()) and value[0, 0, 1] > 0.8


def test_nothing_is_said_of_what_is_not_described() -> None:
    """No notes, no weight; one note is enough."""
    value, sure = judged(PartScores("x", np.zeros((3, 0), np.float32), np.zeros((3, 0), np.float32)), description())
    assert not value.any() and not sure.any()
    value, sure = judged(scores((0.7,), (0.01,)), description("negative"))
    assert value[0] == pytest.approx(1) and sure[0] > 1 and sure[1] == 0
