"""Record the frame-by-frame predictions of a trained model on RGB-D interactions, with a sheet of each.

Reads   FileTree of interaction_pack (sequences with their scene flow); FileTree of a model of sor3d_train
Writes  FileTree of <name>.mcap (docs/recordings.md) and <name>.png for each of some sequences: frames, motion, depth, affordances,
        attention, truth
Method  the prediction of frame i is that of the sequence of frames 1 to i; media time from the rate of the sequence
Fails   when the data set lacks the split, or the model is of another kind
Paper   SOR3D-AFF: attention maps, confidence above 0.75
"""

from __future__ import annotations

from dataclasses import dataclass

from schemas.files import FileTree
from schemas.spec import Context

LIBRARIES = ("numpy", "torch", "safetensors", "opencv-python-headless", "pillow", "matplotlib", "mcap", "mcap-protobuf-support",
             "foxglove-schemas-protobuf", "protobuf", "zstandard", "blake3")  # fmt: skip
THREADS = 1
MEMORY_GIB = 1.0
GPUS = "device"
GPU_SHARED = True


@dataclass(frozen=True)
class Params:
    """Parameters of `interaction_record`."""

    split: str = "val"
    """split of the data set"""
    shown: int = 9
    """number of recorded sequences, spread over the split; 0 for all"""
    rate_hz: float = 10.0
    """frames per second; packed sequences do not store it"""
    threshold: float = 0.75
    """probability above which an affordance counts as confident"""
    device: str = "cpu"
    """cpu, or cuda for a GPU"""


def run(dataset: FileTree, model: FileTree, params: Params, ctx: Context) -> FileTree:
    """Predict every frame of each sequence, and write both files."""
    from afford.common.drawing import write_page
    from afford.common.files import copy_folder, empty_folder, tree
    from afford.dataset import packed_sequences
    from afford.recording.interactions import interaction_strips, record_interaction
    from afford.recording.mcap_files import write_recording
    from afford.recording.provenance import of_files
    from afford.rgbd.model.model_inputs import fit_to_model
    from afford.rgbd.model.predictor import Predictor
    from afford.rgbd.train.job import spread_evenly

    if params.rate_hz <= 0 or params.shown < 0:
        raise ValueError(f"interaction_record: expected rate_hz above 0 and shown of 0 or more, got {params}")
    predictor = Predictor(copy_folder(model, "config.json", empty_folder(ctx.scratch / "model")), params.device)
    part = packed_sequences.split_files({file.name: file.path for file in dataset.files}, params.split)
    chosen, root = spread_evenly(part, params.shown or len(part)), empty_folder(ctx.scratch / "recorded")
    for n, path in enumerate(chosen, 1):
        shown = fit_to_model(packed_sequences.read_sequence(path, "3d"), predictor.config.size_px)
        found = predictor.every_frame(predictor.inputs_of(packed_sequences.read_sequence(path, predictor.config.flow)))
        out = root / f"{shown.name}.mcap"
        recording = record_interaction(shown, found, params.rate_hz, params.threshold)
        write_recording(out, of_files(of_files(recording, "interaction_pack", dataset), "model_train", model))
        write_page(out.with_suffix(".png"), interaction_strips(out))
        ctx.progress(n, len(chosen))
    return tree(model.name, root)
