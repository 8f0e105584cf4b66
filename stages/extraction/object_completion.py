"""Complete the masks of touched objects behind hands and other objects (amodal completion).

Reads   Frames; Tracks (n t h w), visible masks; Inpainted (for backends that use the image without hands);
        files of a model (sam2)
Writes  CompleteObjects: every object that a hand ever touches, complete in every frame, with confidence
Method  `template` tracks each object and lets all frames vote on its hidden pixels; `hull` and `visible` are the baselines;
        `sam2` is learned (weights needed, GPU advised). Deterministic. A complete mask contains the visible one; its other
        pixels are behind other masks
Fails   when the inputs differ in frames or size
Paper   2HandedAfforder, object completion (SAM2 from the frame to its inpainted twin)
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

from afford.extraction.complete import Sam2
from schemas.files import FileTree
from schemas.masks import CompleteObjects, Tracks
from schemas.video import Frames, Inpainted

if TYPE_CHECKING:
    import numpy as np

LIBRARIES = ("numpy", "opencv-python-headless")
BACKEND_LIBRARIES = {"template": ("numba",), "sam2": ("torch", "transformers", "safetensors")}
THREADS = 1
MEMORY_GIB = 1.0
BACKEND_MEMORY_GIB = {"sam2": 4.0}
BACKEND_GPUS = {"sam2": "sam2.device"}
GPU_SHARED = True
TIMEOUT_S = 86400.0  # reports no progress: minutes for most clips, hours for a long one with a model on a CPU

BACKENDS = {
    "template": "afford.extraction.complete.geometric:template",
    "hull": "afford.extraction.complete.geometric:hull",
    "visible": "afford.extraction.complete.geometric:visible",
    "sam2": "afford.extraction.complete.sam2:complete",
}


@dataclass(frozen=True)
class Params:
    """Parameters of `object_completion`."""

    backend: str = "template"
    """template, hull, visible or sam2"""
    sam2: Sam2 = Sam2()
    """parameters of sam2"""


def run(frames: Frames, tracks: Tracks, inpainted: Inpainted, params: Params, weights: FileTree | None = None) -> CompleteObjects:
    """Complete every touched object. Only pixels that another entity covers are ever added to the visible mask."""
    import numpy as np

    from afford.common.registry import block, load
    from afford.extraction import layers
    from afford.models.weights import with_local_weights

    _check(frames, tracks, inpainted)
    complete, own = load(BACKENDS, params.backend), with_local_weights(block(params, params.backend), weights)
    indices = layers.touched_indices(tracks)
    masks = np.zeros((len(indices), *tracks.masks.shape[1:]), bool)
    confidence = np.zeros(masks.shape[:2], np.float32)
    for row, index in enumerate(indices):
        found = complete(frames, tracks, inpainted, index, own)
        visible = tracks.masks[index]
        masks[row] = visible | (found.masks & layers.others(tracks, index))
        whole = (masks[row] == visible).all(axis=(1, 2)) & ~_hidden_nearby(visible, layers.others(tracks, index))
        confidence[row] = np.where(whole, 1, found.confidence)
    return CompleteObjects(tracks.clip_id, tuple(tracks.entities[i] for i in indices), tracks.frame, masks, confidence)


def _hidden_nearby(visible: np.ndarray, others: np.ndarray) -> np.ndarray:
    """Frames (t,) bool in which another mask touches the visible one, so that a part may be hidden, or no pixel is visible."""
    from afford.common.masks import dilate

    touching = (dilate(visible, 3) & others).any(axis=(1, 2))
    return touching | ~visible.any(axis=(1, 2))


def _check(frames: Frames, tracks: Tracks, inpainted: Inpainted) -> None:
    sizes = {"Frames": frames.rgb.shape[:3], "Tracks": tracks.masks.shape[1:], "Inpainted": inpainted.mask.shape}
    numbers = {tuple(noun.frame.tolist()) for noun in (frames, tracks, inpainted)}
    if len(set(sizes.values())) > 1 or len(numbers) > 1:
        raise ValueError(f"object_completion of {tracks.clip_id}: expected the same frames and size everywhere, got {sizes}")
