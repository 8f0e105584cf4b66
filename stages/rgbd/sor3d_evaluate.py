"""Evaluate a trained SOR3D-AFF model on the validation sequences, as videos and as pictures.

Reads   FileTree of interaction_pack; files of a Trained (model/config.json, model/model.safetensors)
Writes  InteractionScores: predicted and true pixels of every affordance and the action, per sequence; some predictions to show
Method  a whole sequence, and its last frame alone without motion; the most probable label of every pixel at the model's size
Fails   when the data set has no validation split, or the files are not a model
Paper   SOR3D-AFF, evaluation
"""

from __future__ import annotations

from dataclasses import dataclass

from schemas.files import FileTree
from schemas.interaction import InteractionScores
from schemas.spec import Context

LIBRARIES = ("numpy", "torch", "safetensors", "opencv-python-headless", "blake3")
THREADS = 1
MEMORY_GIB = 1.0
GPUS = "device"
GPU_SHARED = True


@dataclass(frozen=True)
class Params:
    """Parameters of `sor3d_evaluate`."""

    split: str = "val"
    """split of the data set"""
    shown: int = 12
    """predictions that are kept for the sheet, spread over all sequences"""
    mirror: bool = True
    """average the predictions of each sequence and of its mirror image; the paper predicts once"""
    device: str = "cpu"
    """cpu or cuda"""


def run(dataset: FileTree, model: FileTree, params: Params, ctx: Context) -> InteractionScores:
    """Evaluate every sequence of the split."""
    from afford.common.files import copy_folder, empty_folder
    from afford.dataset import packed_sequences
    from afford.rgbd.evaluate.evaluation import evaluate_model
    from afford.rgbd.model import checkpoint
    from afford.training.loop import deterministic

    folder = copy_folder(model, checkpoint.CONFIG, empty_folder(ctx.scratch / "model"))
    paths = packed_sequences.split_files({file.name: file.path for file in dataset.files}, params.split)
    with deterministic(THREADS, params.device.partition(":")[0]):
        trained = checkpoint.load_model(folder).to(params.device)
        return evaluate_model(model.name, trained, paths, params.shown, params.device, ctx.progress, params.mirror)
