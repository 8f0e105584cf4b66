"""Ground truth of an evaluation clip of hands: masks, touched objects, contact and keypoints of the left and the right hand."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np

VIDEO, TRUTH = "video.mp4", "truth.npz"
MASKS = ("hands", "touched", "sleeves")
ARRAYS = ("frame", "contact", "contact_known", "keypoints_px", "keypoints_m", "keypoints_known")


@dataclass(frozen=True, eq=False)
class ClipTruth:
    """Ground truth of the annotated frames of one clip, at the size of its video. Sides are those of the person."""

    name: str
    viewpoint: str
    """ego or facing"""
    frame: np.ndarray
    """(t,) int64, annotated frames, 1-based, ascending"""
    hands: np.ndarray
    """(2, t, h, w) bool, visible skin or glove of the left and the right hand and its forearm, up to the sleeve"""
    touched: np.ndarray
    """(2, t, h, w) bool, visible pixels of the object that each hand touches"""
    contact: np.ndarray
    """(2, t) bool, whether the hand touches an object"""
    keypoints_px: np.ndarray
    """(2, t, 21, 2) float32, in the order of schemas.hand.KEYPOINTS, also where hidden; 0 where `keypoints_known` is False"""
    keypoints_m: np.ndarray
    """(2, t, 21, 3) float32, camera frame: x right, y down, z away, metres"""
    keypoints_known: np.ndarray
    """(2, t) bool"""
    sleeves: np.ndarray
    """(2, t, h, w) bool, visible pixels of each sleeve"""
    contact_known: np.ndarray
    """(2, t) bool, whether `contact` was annotated"""

    def save(self, folder: Path) -> None:
        """Write `truth.npz`; masks are packed bits along the width."""
        folder.mkdir(parents=True, exist_ok=True)
        packed = {name: np.packbits(getattr(self, name), axis=-1) for name in MASKS}
        arrays = {name: getattr(self, name) for name in ARRAYS}
        np.savez_compressed(folder / TRUTH, **packed, **arrays, size=np.array(self.hands.shape[2:]), viewpoint=self.viewpoint)

    @staticmethod
    def load(folder: Path) -> ClipTruth:
        """Read `truth.npz` of a clip's folder. FileNotFoundError for a folder without it."""
        with np.load(folder / TRUTH) as file:
            width = int(file["size"][1])
            masks = {name: np.unpackbits(file[name], axis=-1, count=width).astype(bool) for name in MASKS}
            arrays = {name: file[name] for name in ARRAYS}
            arrays["contact_known"] = np.broadcast_to(arrays["contact_known"], arrays["contact"].shape)
            return ClipTruth(folder.name, str(file["viewpoint"]), **masks, **arrays)


def clips(root: Path) -> list[Path]:
    """List the folders of evaluation clips below `root`, by name."""
    return sorted(path.parent for path in root.rglob(TRUTH))
