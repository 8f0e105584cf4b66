"""Detection of hands, touched objects and sleeves: parameters, and the interface of the backends, which see single pictures."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Literal, Protocol

from afford.common.registry import Own
from afford.models.weights import Pretrained

if TYPE_CHECKING:
    import numpy as np

    from schemas.files import FileTree

LEFT, RIGHT, TOUCHED, SLEEVE = range(4)
"""channels of the output of a backend"""


@dataclass(frozen=True)
class Detection:
    """Parameters of the detection of key frames, common to all backends."""

    viewpoint: Literal["ego", "facing"] = "ego"
    """ego: a head camera, arms enter from below; facing: the person is seen from the front, or sits at the far side of the table"""
    every_s: float = 0.2
    """seconds between two key frames"""
    look_s: float = 0.1
    """seconds between two sampled frames"""
    least_hand: float = 0.002
    """smallest segment of a hand, as a share of the picture area"""
    least_like: float = 0.2
    """smallest hand, as a share of the median size of the largest hand in this clip"""
    least_object: float = 0.001
    """smallest segment of an object, as a share of the picture area"""
    least_evidence: float = 1.2
    """least sum of the presence of a hand over the sampled frames of its track, from landmarks"""
    least_presence: float = 0.6
    """presence that a hand with landmarks must reach in one sampled frame"""
    least_contrast: float = 0.8
    """least mean log odds of the colours of a hand with landmarks against its surroundings"""
    trust: float = 0.5
    """weight of the hand finder where a hand has landmarks (log odds)"""
    least_found: float = 0.5
    """least probability that a region is a hand, of the regions that only the hand finder detects"""
    fov_deg: float = 70.0
    """assumed angle of view across the longer side of the picture"""
    hand_m: float = 0.19
    """assumed length of a hand from the wrist to the tip of the middle finger"""
    least_part: float = 0.25
    """touching hands are split where each is at least this share of both"""
    memory: float = 0.5
    """weight of the probabilities of the previous sampled frame, warped by motion, against 1 for those of the frame itself"""
    colour: float = 0.6
    """weight of the hand colours of the clip, against 1 for the hand finder (log odds)"""
    foreground: float = 5.0
    """weight of being explained by neither earlier nor later frames, against 1 for the hand finder (log odds of an object)"""
    motion: float = 3.0
    """weight of moving with the hand, against 1 for the hand finder (log odds of an object)"""
    sleeve: float = 8.0
    """weight of being a sleeve against being an object (log odds)"""
    held_weight: float = 0.8
    """weight of the network of held objects, where there is one (log odds of an object)"""
    least_touch: float = 0.57
    """least probability of a touch, from the network of held objects where there is one"""
    lasting: float = 0.9
    """weight of the object odds of the previous sampled frame, warped by motion, against 1 for those of the frame itself"""
    segment_s: float = 0.5
    """seconds between two frames in which touched objects are segmented"""
    touch: float = 2.5
    """log odds added to each candidate for a touched object: assumes that four of five hands touch one; less finds fewer touches"""
    same: float = 1.0
    """weight of the overlap with the touched object of the segmented frame before (log odds)"""
    change: float = 0.5
    """cost of another touched object, of a touch that begins and of one that ends (log odds)"""
    unsure: float = -1.0
    """log odds of the best candidate, with `touch` added, from which a hand without a touch is reported"""
    edge_px: int = 4
    """radius of the guided filter that aligns outlines of hands with image edges"""
    link_min_iou: float = 0.2
    """least IoU that links segments of consecutive sampled frames"""
    leap: float = 0.25
    """largest motion of a hand between sampled frames, as a share of the picture width"""
    gap_looks: int = 4
    """sampled frames for which a hand may be invisible within one track"""
    rest_looks: int = 15
    """sampled frames for which a moved object stays in its track while it rests"""
    least_looks: int = 3
    """sampled frames in which a hand, an object and a contact must be seen to count"""
    order: float = 0.3
    """weight of the prior that the left hand is to the left of the right one, against 1 for the hand finder"""
    entry: float = 0.3
    """weight of the prior from the side of the picture at which an arm enters"""
    near: float = 0.08
    """largest distance between segments of one hand, as a share of the picture width"""
    far: float = 0.45
    """largest distance between a hand and an object that it moves, as a share of the picture width"""
    reach_px: int = 4
    """a hand dilated by this much touches the objects it overlaps"""
    batch: int = 16
    """pictures per call of a backend"""


@dataclass(frozen=True)
class Sam3(Pretrained):
    """Parameters of `sam3`."""

    model: str = ""
    """local folder or hub id of a Sam3Model"""
    threshold: float = 0.5
    """least score of a detection"""


class Find(Protocol[Own]):
    """Interface of a backend of `hand_detect`. Time, colours of the clip and motion are applied after it."""

    def __call__(self, rgb: np.ndarray, params: Own, weights: FileTree | None = None) -> np.ndarray | None:
        """Compute probabilities (n, h, w, 4) float32 of left hand, right hand, touched object and sleeve; None without a finder.

        rgb: pictures (n, h, w, 3) uint8. `params` are the parameters of the backend; `weights` are the files of the hand finder.
        """
        ...
