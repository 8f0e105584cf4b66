"""an RGB-D sequence, its scene flow, a trained model -> what the model says frame by frame, as a recording and a sheet.

Reads   InteractionClip; SceneFlow of it; FileTree of a model: what model_train (backend sor3d) writes
Writes  FileTree of <name>.mcap (docs/recordings.md) and <name>.png: frames, motion, depth, affordances, attention, truth
Method  frame i is answered as the end of the sequence of frames 1 to i; media time from the rate of the sequence
Fails   when the flow is that of another sequence, or the model is of another kind
Paper   SOR3D-AFF: attention maps, confidence above 0.75
"""

from __future__ import annotations

from dataclasses import dataclass

from schemas.context import Context
from schemas.files import FileTree
from schemas.interaction import InteractionClip
from schemas.scene_flow import SceneFlow

LIBRARIES = ("numpy", "torch", "safetensors", "opencv-python-headless", "pillow", "matplotlib", "mcap", "mcap-protobuf-support",
             "foxglove-schemas-protobuf", "protobuf", "zstandard", "blake3")  # fmt: skip
THREADS = 1
MEMORY_GIB = 1.0


@dataclass(frozen=True)
class Params:
    threshold: float = 0.75
    """probability above which an affordance counts as confident"""
    device: str = "cpu"
    """cpu, or cuda for a GPU"""


def run(clip: InteractionClip, flow: SceneFlow, model: FileTree, params: Params, ctx: Context) -> FileTree:
    """Ask the model about every frame, and write both files."""
    from afford.benchmark import folder
    from afford.dataset.files import empty_folder, tree
    from afford.models.sor3d.predictor import Predictor, sequence_of
    from afford.recording.files import write
    from afford.recording.interaction_strips import strips_of
    from afford.recording.of_interaction import record
    from afford.recording.provenance import of_interaction
    from afford.recording.tiles import write_page
    from afford.training.sequence_batches import fitted

    predictor = Predictor(folder.unfold(model, "config.json", empty_folder(ctx.scratch / "model")), params.device)
    found = predictor.every_frame(predictor.seen(clip, flow))
    shown = fitted(sequence_of(clip, flow, "3d"), predictor.config.size_px)
    root = empty_folder(ctx.scratch / "recorded")
    path = root / f"{clip.name}.mcap"
    write(path, of_interaction(record(shown, found, clip.rate_hz, params.threshold), clip, flow, model))
    write_page(root / f"{clip.name}.png", strips_of(path))
    return tree(clip.name, root)
