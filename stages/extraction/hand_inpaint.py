"""Inpaint the hands: the same frames without hands.

Reads   Frames (t h w 3); Tracks: every hand and touched object in every frame; files of a model (vidm, lama)
Writes  Inpainted: images, the mask that was replaced (hands, dilated), per-pixel source and confidence
Method  `layered` fills from other frames, background and objects by their own motion; `median` fills with background only;
        `telea` fills each frame alone; `vidm` (diffusion, GPU advised) and `lama` (one pass) are learned and need weights. All
        are deterministic on one kind of machine, and also work on a few far-apart frames
Fails   when frames and tracks differ in frames or size; when a learned backend has no weights that fit
Paper   2HandedAfforder, hand inpainting (VIDM over four frames); masks dilated 7 px at 256 there
"""

from __future__ import annotations

from dataclasses import dataclass

from afford.extraction.inpaint import LamaParams, VidmParams
from schemas.files import FileTree
from schemas.masks import Tracks
from schemas.video import Frames, Inpainted, PixelSource

LIBRARIES = ("numpy", "opencv-python-headless")
BACKEND_LIBRARIES = {"layered": ("numba",), "median": ("numba",), "vidm": ("torch", "diffusers", "safetensors"),
                     "lama": ("torch", "safetensors")}  # fmt: skip
THREADS = 1
MEMORY_GIB = 1.0
BACKEND_MEMORY_GIB = {"vidm": 4.0, "lama": 3.0}
BACKEND_GPUS = {"vidm": "vidm.device", "lama": "lama.device"}
GPU_SHARED = True
TIMEOUT_S = 86400.0  # reports no progress: minutes for most clips, hours for a long one with a model on a CPU

BACKENDS = {
    "layered": "afford.extraction.inpaint.layered:inpaint",
    "median": "afford.extraction.inpaint.layered:median",
    "telea": "afford.extraction.inpaint.layered:telea",
    "vidm": "afford.extraction.inpaint.vidm:inpaint",
    "lama": "afford.extraction.inpaint.lama:inpaint",
}


@dataclass(frozen=True)
class Params:
    """Parameters of `hand_inpaint`."""

    backend: str = "layered"
    """layered, median, telea, vidm or lama"""
    dilate_px: int = 3
    """growth of the hand masks before they are replaced, in pixels of the working size"""
    vidm: VidmParams = VidmParams()
    """parameters of vidm"""
    lama: LamaParams = LamaParams()
    """parameters of lama"""


def run(frames: Frames, tracks: Tracks, params: Params, weights: FileTree | None = None) -> Inpainted:
    """Replace the hands. Outside `mask` no pixel changes."""
    import numpy as np

    from afford.common.masks import dilate
    from afford.common.registry import block, load
    from afford.extraction import layers
    from afford.models.weights import with_local_weights

    _check(frames, tracks)
    hole = dilate(layers.hands(tracks), params.dilate_px)
    filled = load(BACKENDS, params.backend)(frames, tracks, hole, with_local_weights(block(params, params.backend), weights))
    rgb = np.where(hole[..., None], filled.rgb, frames.rgb)
    source = np.where(hole, filled.source, PixelSource.ORIGINAL).astype(np.uint8)
    confidence = np.where(hole, filled.confidence, 255).astype(np.uint8)
    return Inpainted(frames.clip_id, frames.frame, rgb, hole, source, confidence)


def _check(frames: Frames, tracks: Tracks) -> None:
    found, wanted = (tracks.frame.tolist(), tracks.masks.shape[1:]), (frames.frame.tolist(), frames.rgb.shape[:3])
    if found != wanted:
        raise ValueError(
            f"Tracks of {tracks.clip_id}: expected masks of the {len(frames.frame)} frames at {wanted[1][1:]}, got "
            f"{len(tracks.frame)} frames at {found[1][1:]}; run mask_densify on these frames"
        )
