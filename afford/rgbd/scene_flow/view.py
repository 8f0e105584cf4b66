"""One RGB-D frame as the estimators want it, and the way from motion on the image to motion in space."""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np

from afford.common.optical_flow import identity_map


@dataclass(frozen=True)
class View:
    """A frame of a clip."""

    rgb: np.ndarray
    """(h, w, 3) uint8"""
    depth_m: np.ndarray
    """(h, w) float32 along the optical axis, m; 0 is a hole"""
    K: np.ndarray
    """(3, 3) float64, px"""

    @property
    def grey(self) -> np.ndarray:
        """(h, w) uint8."""
        return cv2.cvtColor(self.rgb, cv2.COLOR_RGB2GRAY)


def lift(flow_px: np.ndarray, depth_m: np.ndarray, change_m: np.ndarray, K: np.ndarray) -> np.ndarray:
    """Motion in space, (h, w, 3) float32 in m, of points at `depth_m` that move by `flow_px` (h, w, 2) on the image and by
    `change_m` (h, w) along the optical axis.
    """
    focal, centre = (np.array(pair, np.float32) for pair in ((K[0, 0], K[1, 1]), (K[0, 2], K[1, 2])))
    ray = (identity_map(*depth_m.shape) + flow_px - centre) / focal
    across = flow_px / focal * depth_m[..., None] + ray * change_m[..., None]
    return np.dstack([across, change_m]).astype(np.float32)


def carried(image: np.ndarray, flow_px: np.ndarray, nearest: bool = False) -> np.ndarray:
    """What `image` shows at x + flow(x), (h, w[, c]); beyond the border what is on the border."""
    where = identity_map(*flow_px.shape[:2]) + flow_px
    return cv2.remap(image, where, None, cv2.INTER_NEAREST if nearest else cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE)
