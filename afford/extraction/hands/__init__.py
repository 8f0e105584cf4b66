"""Where hands are in pictures, what they touch and where sleeves are: the question that the backends of `hand_detect` answer, each
picture alone.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Literal, Protocol

from afford.common.registry import Own
from afford.models.weights import Pretrained

if TYPE_CHECKING:
    import numpy as np

    from schemas.files import FileTree

LEFT, RIGHT, TOUCHED, SLEEVE = range(4)
"""what the last axis of an answer stands for"""


@dataclass(frozen=True)
class Detection:
    """Parameters of key frames, whichever backend finds hands in single pictures."""

    viewpoint: Literal["ego", "facing"] = "ego"
    """ego: a head camera, arms come from below; facing: the person is seen from the front, or sits at the far side of the table"""
    every_s: float = 0.5
    """seconds between two key frames"""
    look_s: float = 0.1
    """seconds between two frames that are looked at"""
    least_hand: float = 0.002
    """smallest part of a hand, as a share of the picture's area"""
    least_like: float = 0.2
    """smallest hand, as a share of the usual size of the largest one in sight in this clip"""
    least_object: float = 0.001
    """smallest part of an object, as a share of the picture's area"""
    least_part: float = 0.25
    """hands that touch are parted where each is at least this share of both"""
    memory: float = 0.5
    """weight of what motion carries from one look to the next, against 1 for what is seen there"""
    colour: float = 0.6
    """weight of the clip's own colours of hands, against 1 for what the finder says (log odds)"""
    motion: float = 4.0
    """weight of moving as the hand does, against 1 for what the finder says of objects (log odds)"""
    sleeve: float = 8.0
    """weight of being a sleeve against being an object (log odds)"""
    lasting: float = 0.8
    """weight of what is known of objects from one look to the next, against 1 for what is seen there"""
    edge_px: int = 4
    """radius within which outlines of hands are drawn to edges of the picture"""
    link_min_iou: float = 0.2
    """overlap from which a part of one look is the one of the look before"""
    leap: float = 0.25
    """farthest that a hand moves from one look to the next, as a share of the picture's width"""
    gap_looks: int = 4
    """looks for which something may be out of sight and still be the same"""
    rest_looks: int = 15
    """looks for which a thing that a hand moved is still there when it rests"""
    least_looks: int = 3
    """looks in which a hand, an object and a touch must be seen to be one"""
    order: float = 0.3
    """what it counts that a left hand is to the left of the right one, against a sure look at one of them"""
    entry: float = 0.3
    """what it counts at which side of the picture an arm comes in"""
    near: float = 0.08
    """parts of one hand are at most this far apart, as a share of the picture's width"""
    far: float = 0.25
    """what a hand moves is at most this far from it, as a share of the picture's width"""
    reach_px: int = 4
    """a hand dilated by this much touches what it overlaps"""
    batch: int = 16
    """pictures that a backend is shown at a time"""


@dataclass(frozen=True)
class Sam3(Pretrained):
    """Parameters of `sam3`."""

    model: str = ""
    """local folder or hub id of a Sam3Model"""
    threshold: float = 0.5
    """least score of what counts as a hand"""


class Find(Protocol[Own]):
    """A backend. What is known of time, of the clip's own colours and of motion comes after it."""

    def __call__(self, rgb: np.ndarray, params: Own, weights: FileTree | None = None) -> np.ndarray:
        """Pictures (n, h, w, 3) uint8 -> (n, h, w, 4) float32, 0..1: how likely a pixel is left hand, right hand, touched object,
        sleeve.

        `params` are those of this backend; `weights` are the files of the finder, as the stage was given them.
        """
        ...
