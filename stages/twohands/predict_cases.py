"""cases + a trained model -> predictions of the model for each case.

Reads   a benchmark in ActAffordance's layout; a model: config.json and model.safetensors, as model_train writes them
Writes  predictions.parquet: probabilities of every hypothesis and hand, scores, taxonomy, chosen hands, threshold
Method  one image and its task at a time, averaged with its mirror image; a second look at the crop of small objects. `shuffled`
        prompts with the task of another case, `removed` with an empty one, to measure the effect of the text
Fails   when a case or the model cannot be read
Paper   2HandedAfforder, benchmark and ablations
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import TYPE_CHECKING, Literal

from schemas.files import FileTree
from schemas.spec import Context

if TYPE_CHECKING:
    from schemas.benchmark import Prediction

LIBRARIES = ("numpy", "opencv-python-headless", "pillow", "pyarrow", "torch", "safetensors", "transformers", "tokenizers",
             "peft", "scipy", "blake3")  # fmt: skip
THREADS = 1
MEMORY_GIB = 2.0
GPUS = "device"
GPU_SHARED = True


@dataclass(frozen=True)
class Params:
    """Parameters of the stage."""

    name: str = "small"
    """name of the method in the report; '' is the model's own"""
    text: Literal["given", "shuffled", "removed"] = "given"
    """task in the prompt: that of the case, that of another case, or an empty one"""
    hands: Literal["auto", "left", "right", "both"] = "auto"
    """returned hands; auto: selected by the taxonomy head"""
    looks: int = 2
    """2: predict again on the crop of a small object, for models that output complete objects; 1: do not"""
    mirror: bool = True
    """average the predictions of each picture and its mirror image"""
    seed: int = 0
    """seed of the shuffling"""
    device: str = "cpu"
    """cpu, or cuda for a GPU"""


def run(cases: FileTree, model: FileTree, params: Params, ctx: Context) -> FileTree:
    """Predict all cases."""
    from afford.common.files import copy_folder, empty_folder, tree
    from afford.dataset import act_affordance
    from afford.twohands.benchmark import predictions_file
    from afford.twohands.benchmark.cases import picture, prompts, task
    from afford.twohands.model.predictor import Predictor

    predictor = Predictor(copy_folder(model, "config.json", empty_folder(ctx.scratch / "model")), params.device,
                          params.mirror)
    listed = act_affordance.cases(cases)

    def rows() -> Iterator[tuple[str, Prediction]]:
        tasks = prompts([task(files) for files in listed], params.text, params.seed)
        for n, (files, prompt) in enumerate(zip(listed, tasks, strict=True)):
            yield files.where, predictor.predict(picture(files), prompt, params.hands, params.looks)
            ctx.progress(n + 1, len(listed))

    out = empty_folder(ctx.scratch / "out")
    predictions_file.write_predictions(out / predictions_file.FILE_NAME, rows())
    return tree(params.name or model.name, out)
