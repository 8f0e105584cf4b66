"""a trained model of SOR3D-AFF on the sequences of validation -> what it got right, of videos and of pictures.

Reads   FileTree that interaction_pack wrote; files of a Trained (model/config.json, model/model.safetensors)
Writes  InteractionScores: pixels found and true of every affordance and the action, sequence by sequence; some answers to look at
Method  a sequence whole, and its last frame alone, in which nothing moves; the most probable label of every pixel at the size of
        the model
Fails   when the data set has no validation part, or the files are no model
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


@dataclass(frozen=True)
class Params:
    split: str = "val"
    """which part of the data set"""
    shown: int = 12
    """answers that are kept to look at, spread over all sequences"""
    mirror: bool = True
    """each is asked about twice, as it is and mirrored, and what is said is the mean; the paper asks once"""
    device: str = "cpu"
    """cpu or cuda"""


def run(dataset: FileTree, model: FileTree, params: Params, ctx: Context) -> InteractionScores:
    """Ask about every sequence of the part."""
    from afford.common.files import copy_folder, empty_folder
    from afford.dataset import packed_sequences
    from afford.rgbd.evaluate.evaluation import evaluate_model
    from afford.rgbd.model import checkpoint
    from afford.training.loop import deterministic

    folder = copy_folder(model, checkpoint.CONFIG, empty_folder(ctx.scratch / "model"))
    paths = packed_sequences.split_files({file.name: file.path for file in dataset.files}, params.split)
    with deterministic(THREADS, params.device):
        trained = checkpoint.load_model(folder).to(params.device)
        return evaluate_model(model.name, trained, paths, params.shown, params.device, ctx.progress, params.mirror)
