"""Evaluate a trained model on single pictures with affordance labels.

Reads   StaticSet (static_read: UMD, IIT-AFF), or InteractionClips, of which the last frames are used; FileTree of a model of
        sor3d_train or boxes_train
Writes  FileTree: metrics.json (iou, f, fw, by class; closed.*: only classes of the set may be predicted), report.md (with the
        pictures that could not be read), sheet.png (a row for each of a few pictures: truth, most likely class, regions of a
        confidence above 0.75, attention)
Method  the middle square of every picture, at the model's size; probabilities are enlarged to the grid of the labels
Fails   when the split has no picture, or no picture has an affordance
Paper   SOR3D-AFF: static images of its own data, UMD and IIT-AFF; AffordanceNet (Do, Nguyen and Reid 2018) for comparison
"""

from __future__ import annotations

from dataclasses import dataclass

from afford.rgbd.model.config import BoxesParams
from schemas.files import FileTree
from schemas.interaction import InteractionClip, StaticSet
from schemas.spec import Context

LIBRARIES = ("numpy", "torch", "safetensors", "opencv-python-headless", "pillow", "matplotlib", "blake3")
THREADS = 1
MEMORY_GIB = 1.5
GPUS = "device"
GPU_SHARED = True

BACKENDS = {
    "sor3d": "afford.rgbd.model.predictor:picture_predictor",
    "boxes": "afford.rgbd.model.detector:picture_predictor",
}


@dataclass(frozen=True)
class Params:
    """Parameters of `static_evaluate`."""

    backend: str = "sor3d"
    """kind of the model: sor3d or boxes"""
    name: str = "static"
    """name of the set in the report"""
    split: str = ""
    """train, val or test; '' for every picture"""
    threshold: float = 0.75
    """confidence above which the sheet shows a region"""
    shown: int = 12
    """pictures in the sheet, spread evenly"""
    device: str = "cpu"
    """cpu, or cuda for a GPU"""
    boxes: BoxesParams = BoxesParams()
    """parameters of boxes"""


def run(samples: StaticSet | tuple[InteractionClip, ...], model: FileTree, params: Params, ctx: Context) -> FileTree:
    """Evaluate the model on every picture of the split."""
    import numpy as np

    from afford.common.files import copy_folder, empty_folder, tree
    from afford.common.registry import block, load
    from afford.rgbd.evaluate.static_sets import ScoredPicture, SetScores, write
    from afford.rgbd.model.predictor import last_picture

    given = samples if isinstance(samples, StaticSet) else StaticSet(tuple(last_picture(one) for one in samples), ())
    pictures = [one for one in given.samples if params.split in ("", one.split)]
    if not pictures or params.shown < 1:
        raise ValueError(f"static_evaluate: expected pictures of the split {params.split!r} and shown of 1 or more, got "
                         f"{len(pictures)} of {len(given.samples)} and {params.shown}")
    folder = copy_folder(model, "config.json", empty_folder(ctx.scratch / "model"))
    predict = load(BACKENDS, params.backend)(folder, params.device, block(params, params.backend))
    scores, shown = SetScores.of(pictures), []
    chosen = set(np.linspace(0, len(pictures) - 1, min(params.shown, len(pictures))).astype(int).tolist())
    for n, picture in enumerate(pictures):
        one = ScoredPicture(picture, predict(picture))
        scores.add(one)
        shown += [one] if n in chosen else []
        ctx.progress(n + 1, len(pictures))
    root = empty_folder(ctx.scratch / "static")
    return tree(params.name, write(root, params.name, scores, len(pictures), shown, params.threshold, given.refused))
