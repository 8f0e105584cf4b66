"""Remarks on the annotations of a clip, for the person who runs the pipeline; loads no image library."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable

ALIKE = 1.03
"""largest ratio of two aspect ratios that counts as rounding"""
Size = tuple[int, int]
"""width and height, px"""
SHOWN = 5
"""largest number of names in a message"""


def aspect_remark(grids: Iterable[Size], size_wh: Size) -> str:
    """Remark on key frames with another aspect ratio than the pictures, `size_wh`, whose masks are stretched; '' without any."""
    found = [grid for grid in grids if not 1 / ALIKE <= grid[0] / grid[1] * size_wh[1] / size_wh[0] <= ALIKE]
    if not found:
        return ""
    return (f"masks of {len(found)} key frames refer to a size of another shape than the pictures, {found[0][0]}x{found[0][1]} "
            f"against {size_wh[0]}x{size_wh[1]}, and are stretched; correct 'width' and 'height' of the images if they are wrong")


def no_hands_remark(masks: Iterable[tuple[str, str]]) -> str:
    """Remark on the (side, name) of the masks of a clip without hands; '' with a hand, and without masks."""
    found = list(masks)
    if not found or any(side for side, _ in found):
        return ""
    names = [name for name, _ in Counter(name for _, name in found).most_common()]
    return ("no mask is called 'left hand' or 'right hand', so there is no contact and no sample; names are "
            f"{quoted_list(names)}")


def quoted_list(names: Iterable[str]) -> str:
    """List the first few names, quoted."""
    found = [repr(name) for name in names]
    return ", ".join(found[:SHOWN]) + (f" and {len(found) - SHOWN} more" if len(found) > SHOWN else "")
