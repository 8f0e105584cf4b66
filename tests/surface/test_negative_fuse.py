"""What candidates say of pixels: parts compete, sure ones count most, and what fits nothing does not count."""

from __future__ import annotations

import numpy as np
import pytest

from afford.surface.negative.project import part_posterior, pixel_probability
from schemas.surface import PartCandidates, PartDescription, PartNote, PartScores


def description(*roles: str) -> PartDescription:
    notes = tuple(PartNote(f"p{n}", f"the p{n}", role, "", 1.0, False) for n, role in enumerate(roles))  # type: ignore[arg-type]
    return PartDescription("x", "thing", "use", notes, "rules")


def scores(*rows: tuple[float, ...]) -> PartScores:
    """Shares; every candidate is all of what it shows."""
    share = np.array(rows, np.float32)
    return PartScores("x", share, np.ones_like(share))


def test_what_fits_better_wins_even_where_nothing_fits_well() -> None:
    """Only the ratio counts: 0.2 to 0.1 is as 0.8 to 0.4; neutral parts compete as well."""
    value, sure = part_posterior(scores((0.2, 0.1), (0.8, 0.4), (0.1, 0.8)), description("negative", "positive"))
    assert value[:2] == pytest.approx([0.8, 0.8], abs=0.02) and sure[0] == pytest.approx(sure[1])
    value, _ = part_posterior(scores((0.5, 0.5, 0.5)), description("negative", "positive", "neutral"))
    assert value == pytest.approx([1 / 3])


def test_sure_candidates_count_most_and_misfits_not_at_all() -> None:
    """All alike: next to nothing; below the threshold: nothing; certain: most."""
    given = scores((0.5, 0.5), (0.05, 0.0), (0.9, 0.01), (0.6, 0.3), (0.01, 0.9))
    _, sure = part_posterior(given, description("negative", "positive"))
    assert sure[1] == 0 and sure[0] < 0.05 < sure[3] < sure[2]


def test_pixels_take_the_weighted_mean_of_what_covers_them() -> None:
    """Where a sure and an unsure mask overlap the sure one prevails; where nothing covers there is no weight."""
    masks = np.zeros((2, 1, 4), bool)
    masks[0, 0, :2], masks[1, 0, 1:3] = True, True
    candidates = PartCandidates("x", np.zeros(2, np.int16), masks, np.ones(2, np.float32))
    face = np.zeros((1, 1, 4), np.int32)
    value, weight = pixel_probability(candidates, scores((0.9, 0.01), (0.4, 0.6)), description("negative", "positive"), face)
    said, sure = part_posterior(scores((0.9, 0.01), (0.4, 0.6)), description("negative", "positive"))
    assert value[0, 0, [0, 2]] == pytest.approx(said) and weight[0, 0, 3] == value[0, 0, 3] == 0
    assert value[0, 0, 1] == pytest.approx((said * sure).sum() / sure.sum()) and value[0, 0, 1] > said.mean()


def test_a_part_that_fits_nothing_well_counts_for_more_where_it_fits_best() -> None:
    """A trigger at 0.3 beside a body at 0.5 is more likely than where a trigger elsewhere has 0.9; who fits wholly wins over who is
    merely in it.
    """
    roles = description("negative", "positive")
    alone, beside = (part_posterior(scores((0.3, 0.5), other), roles)[0] for other in ((0.0, 0.9), (0.9, 0.0)))
    assert alone[0] > beside[0]
    both = PartScores("x", np.array([[0.5, 0.5]], np.float32), np.array([[0.9, 0.2]], np.float32))
    assert part_posterior(both, roles)[0][0] > 0.6


def test_a_small_mask_outvotes_the_large_one_that_holds_it() -> None:
    """By as much as it is smaller; the size of the view does not matter, only what it shows of the object."""
    masks = np.zeros((2, 1, 8), bool)
    masks[0, 0, :1], masks[1, 0, :4] = True, True
    candidates = PartCandidates("x", np.zeros(2, np.int16), masks, np.ones(2, np.float32))
    told, roles = scores((0.9, 0.0), (0.0, 0.9)), description("negative", "positive")
    for beyond in (0, 30):
        face = np.full((1, 1, 8 + beyond), -1, np.int32)
        face[..., :8] = 0
        wide = PartCandidates("x", candidates.view, np.pad(masks, ((0, 0), (0, 0), (0, beyond))), candidates.quality)
        value, weight = pixel_probability(wide, told, roles, face)
        assert value[0, 0, 0] == pytest.approx(0.8, abs=0.01) and weight[0, 0, 0] == pytest.approx(5 * weight[0, 0, 1], rel=0.01)


def test_nothing_is_said_of_what_is_not_described() -> None:
    """No notes, no weight; one note is enough."""
    value, sure = part_posterior(PartScores("x", np.zeros((3, 0), np.float32), np.zeros((3, 0), np.float32)), description())
    assert not value.any() and not sure.any()
    value, sure = part_posterior(scores((0.7,), (0.01,)), description("negative"))
    assert value[0] == pytest.approx(1) and sure[0] > 1 and sure[1] == 0
