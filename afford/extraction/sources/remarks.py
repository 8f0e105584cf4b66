"""Remarks on the masks of a clip, made where a source is checked and where a run ends. Nothing heavy is imported."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable

ALIKE = 1.03
"""sides of pictures whose proportions differ by less are only rounded"""
Size = tuple[int, int]
"""width and height, px"""
SHOWN = 5
"""names that a sentence lists"""


def other_shape(grids: Iterable[Size], size_wh: Size) -> str:
    """A remark on key frames of other proportions than the pictures, `size_wh`; '' when there is none. Masks of such a frame are
    stretched to the picture.
    """
    found = [grid for grid in grids if not 1 / ALIKE <= grid[0] / grid[1] * size_wh[1] / size_wh[0] <= ALIKE]
    if not found:
        return ""
    return (f"masks of {len(found)} key frames refer to a size of another shape than the pictures, {found[0][0]}x{found[0][1]} "
            f"against {size_wh[0]}x{size_wh[1]}, and are stretched; correct 'width' and 'height' of the images if they are wrong")


def handless(masks: Iterable[tuple[str, str]]) -> str:
    """Remark on the (side, name) of the masks of a clip, none of which is a hand; '' where one is, or there are no masks."""
    found = list(masks)
    if not found or any(side for side, _ in found):
        return ""
    names = [name for name, _ in Counter(name for _, name in found).most_common()]
    return ("no mask is called 'left hand' or 'right hand', so there is no contact and no sample; names are "
            f"{listed(names)}")


def listed(names: Iterable[str]) -> str:
    """The first few names, quoted."""
    found = [repr(name) for name in names]
    return ", ".join(found[:SHOWN]) + (f" and {len(found) - SHOWN} more" if len(found) > SHOWN else "")
