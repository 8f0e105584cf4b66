"""Motion of what an RGB-D camera sees, in space and on the image."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

from schemas.spec import Schema, array, value

if TYPE_CHECKING:
    import numpy as np


@dataclass(frozen=True)
class SceneFlow(Schema):
    """Motion of the surface seen in frame i of a clip until frame i + 1; s is one less than the clip's frames. Never NaN."""

    name: str = value("the clip")
    flow_m: np.ndarray = array("s h w 3", "float16", "motion in space", unit="m per frame",
                               frame="camera: x right, y down, z forward", encoding="zstd")
    flow_px: np.ndarray = array("s h w 2", "float16", "motion on the image, x then y", unit="px per frame", encoding="zstd")
    colour: np.ndarray = array("s h w 3", "uint8", "flow_m, each axis normalised to 0..255", encoding="zstd")
    colour_px: np.ndarray = array("s h w 3", "uint8", "flow_px likewise; the third axis says no motion", encoding="zstd")
    still: np.ndarray = array("6", "uint8", "what no motion looks like: in colour, then in colour_px")
