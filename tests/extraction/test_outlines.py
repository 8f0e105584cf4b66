"""Laws of sources/polygons: outlines and masks are exact inverses, drawn by VISOR's rule."""

from __future__ import annotations

import cv2
import numpy as np
import pytest

from afford.extraction.sources.outlines import fill, rasterise, trace, union
from schemas.video import Annotation, Polygon


def outline(*corners: tuple[float, float]) -> Polygon:
    return Polygon(np.array(corners, np.float32).reshape(-1, 2))


def square(x: float, y: float, side: float) -> Polygon:
    return outline((x, y), (x + side, y), (x + side, y + side), (x, y + side))


def annotation(*polygons: Polygon) -> Annotation:
    return Annotation("a", "mug", 13, "", "", "y", polygons)


@pytest.mark.parametrize("seed", range(20))
def test_fill_undoes_trace(seed: int) -> None:
    """Any mask, with holes, islands and single pixels, comes back bit for bit."""
    rng = np.random.default_rng(seed)
    noise = cv2.GaussianBlur(rng.normal(size=(60, 80)), (0, 0), rng.uniform(0.3, 4))
    mask = noise > rng.uniform(-0.1, 0.1)
    assert np.array_equal(fill(trace(mask), 80, 60) > 0, mask)


def test_corners_are_truncated_not_rounded() -> None:
    """10.9 is pixel 10; borders are part of the mask."""
    mask = rasterise(annotation(square(10.9, 20.9, 4.0)), 100, 100, 100, 100)
    rows, columns = np.nonzero(mask)
    assert (rows.min(), rows.max(), columns.min(), columns.max()) == (20, 24, 10, 14)


def test_an_outline_inside_another_is_a_hole() -> None:
    """Even-odd: all outlines of an annotation are drawn together."""
    mask = rasterise(annotation(square(10, 10, 40), square(20, 20, 10)), 100, 100, 100, 100)
    assert mask[15, 15] and not mask[25, 25]


def test_the_grid_is_shrunk_by_nearest_neighbour() -> None:
    """Drawn at 1920 x 1080 first, then sampled: pixel (x, y) of the small mask is cell (x * 1920 // w, y * 1080 // h)."""
    shape = annotation(outline((300, 100), (1500, 300), (900, 1000)))
    large = rasterise(shape, 1920, 1080, 1920, 1080)
    small = rasterise(shape, 1920, 1080, 480, 270)
    assert np.array_equal(small, large[::4, ::4])


def test_outlines_are_clipped_to_the_grid() -> None:
    """An outline that leaves the grid is drawn inside it only; one outside draws no pixel."""
    partly = rasterise(annotation(outline((50, 50), (1e9, 50), (1e9, 1e9), (50, 1e9))), 100, 100, 100, 100)
    assert partly[50:, 50:].all() and partly.sum() == 2500
    assert not rasterise(annotation(square(500, 500, 20)), 100, 100, 100, 100).any()


def test_empty_outlines_draw_nothing() -> None:
    """Neither an annotation without outlines nor an outline without corners marks a pixel."""
    assert not rasterise(annotation(), 10, 10, 10, 10).any()
    assert not rasterise(annotation(Polygon(np.zeros((0, 2), np.float32))), 10, 10, 10, 10).any()


def test_union_does_not_cancel_overlaps() -> None:
    """A glove drawn over a hand adds to it."""
    hand, glove = (square(10, 10, 30),), (square(30, 30, 30),)
    both = fill(union(hand, glove, 100, 100), 100, 100)
    assert np.array_equal(both, fill(hand, 100, 100) | fill(glove, 100, 100))
