"""cases + a trained model -> what the model says of each case.

Reads   a benchmark in ActAffordance's layout; a model: config.json and model.safetensors, as model_train writes them
Writes  predictions.parquet: probabilities of every hypothesis and hand, scores, taxonomy, chosen hands, threshold
Method  one image and its task at a time, together with its mirror image; small things in a second look. `shuffled` gives every
        case the task of another one, `removed` an empty task: what the words are worth
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


@dataclass(frozen=True)
class Params:
    name: str = "small"
    """name of the method in the report; '' is the model's own"""
    text: Literal["given", "shuffled", "removed"] = "given"
    """the task the model is told: the case's own, that of another case, or none"""
    hands: Literal["auto", "left", "right", "both"] = "auto"
    """auto: the taxonomy head chooses which hands are returned; else these are, always"""
    looks: int = 2
    """2: a thing that fills little of the picture is looked at again in its crop, by models that tell what the thing is; 1: not"""
    mirror: bool = True
    """each picture is looked at together with its mirror image, and what is said of both averaged"""
    seed: int = 0
    """seed of the shuffling"""
    device: str = "cpu"
    """cpu, or cuda for a GPU"""


def run(cases: FileTree, model: FileTree, params: Params, ctx: Context) -> FileTree:
    """Ask the model about every case."""
    from afford.common.files import copy_folder, empty_folder, tree
    from afford.dataset import act_affordance
    from afford.twohands.benchmark import cases as cases_module
    from afford.twohands.benchmark import predictions_file
    from afford.twohands.benchmark.cases import picture, task
    from afford.twohands.model.predictor import Predictor

    predictor = Predictor(copy_folder(model, "config.json", empty_folder(ctx.scratch / "model")), params.device,
                          params.mirror)
    listed = act_affordance.cases(cases)

    def rows() -> Iterator[tuple[str, Prediction]]:
        told = cases_module.prompts([task(files) for files in listed], params.text, params.seed)
        for n, (files, said) in enumerate(zip(listed, told, strict=True)):
            yield files.where, predictor.predict(picture(files), said, params.hands, params.looks)
            ctx.progress(n + 1, len(listed))

    out = empty_folder(ctx.scratch / "out")
    predictions_file.write_predictions(out / predictions_file.FILE_NAME, rows())
    return tree(params.name or model.name, out)
