"""cases -> predictions of a baseline without a network.

Reads   a benchmark in ActAffordance's layout; a data set of dataset_pack (an empty tree for a baseline without data)
Writes  predictions.parquet, as predict_cases does
Method  whole_object and object_box are oracles (they see the annotated objects); centre is a Gaussian; class_mean is the mean
        mask in the training split for the same verb and noun; extraction is the frame in a data set made from its video
Fails   when a baseline that needs a data set gets none
Paper   2HandedAfforder, benchmark: AffExtract; the others are ours
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import TYPE_CHECKING

from schemas.files import FileTree
from schemas.spec import Context

if TYPE_CHECKING:
    from schemas.benchmark import Prediction

LIBRARIES = ("numpy", "opencv-python-headless", "pillow", "pyarrow", "blake3")
BACKEND_LIBRARIES = {"class_mean": ("pycocotools",), "extraction": ("pycocotools",)}
THREADS = 1
MEMORY_GIB = 1.0

BACKENDS = {
    "whole_object": "afford.twohands.benchmark.baselines:whole_object",
    "object_box": "afford.twohands.benchmark.baselines:object_box",
    "centre": "afford.twohands.benchmark.baselines:centre",
    "class_mean": "afford.twohands.benchmark.dataset_baselines:class_mean",
    "extraction": "afford.twohands.benchmark.dataset_baselines:extraction",
}


@dataclass(frozen=True)
class Params:
    """Parameters of the stage."""

    backend: str = "whole_object"
    """whole_object, object_box, centre, class_mean or extraction; also its name in the report"""


def run(cases: FileTree, dataset: FileTree, params: Params, ctx: Context) -> FileTree:
    """Predict all cases; a case without a prediction gets no row."""
    from afford.common.files import copy_folder, empty_folder, tree
    from afford.common.registry import load
    from afford.dataset import act_affordance
    from afford.twohands.benchmark import predictions_file
    from afford.twohands.benchmark.cases import read

    root = copy_folder(dataset, "manifest.json", empty_folder(ctx.scratch / "dataset")) if dataset.files else None
    answer = load(BACKENDS, params.backend)(root)
    listed = act_affordance.cases(cases)

    def rows() -> Iterator[tuple[str, Prediction]]:
        for n, files in enumerate(listed):
            prediction = answer(read(files))
            if prediction is not None:
                yield files.where, prediction
            ctx.progress(n + 1, len(listed))

    out = empty_folder(ctx.scratch / "out")
    predictions_file.write_predictions(out / predictions_file.FILE_NAME, rows())
    return tree(params.backend, out)
