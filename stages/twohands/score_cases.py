"""predictions + cases -> all measures of each case.

Reads   a benchmark in ActAffordance's layout (docs/twohands/benchmark.md); predictions: what `predict_cases` or `baseline_cases`
        wrote, or masks of any method in the released layout
Writes  MethodScores: strict measures and the released script's own, taxonomy, reliability, sheets of best, median and worst
Method  strict measures count every case and every pixel, use the valid mode that fits best, and also score each hand; compat
        measures are those of the released script, bit for bit, including the cases that it skips
Fails   when a case cannot be read, or a folder has no predictions
Paper   2HandedAfforder, ActAffordance benchmark: IoU, precision, directed Hausdorff distance, mAP over five thresholds
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Literal

from schemas.benchmark import Case, MethodScores
from schemas.files import FileTree

if TYPE_CHECKING:
    from afford.twohands.benchmark.answers import Answer

LIBRARIES = ("numpy", "opencv-python-headless", "scipy", "pyarrow", "pillow", "scikit-image")
THREADS = 1
MEMORY_GIB = 1.5


@dataclass(frozen=True)
class Params:
    """Parameters of the stage."""

    levels: tuple[float, ...] = (0.1, 0.2, 0.3, 0.5, 0.7)
    """thresholds of mAP for a method with probabilities; folders of masks have their own"""
    level: float = 0.5
    """threshold of the strict measures for a folder with several; a method with probabilities has its own"""
    protocol: Literal["cropped", "masks"] = "cropped"
    """set of a folder of predictions without a folder `cropped` or `masks`"""
    truth: Literal["png", "toras"] = "png"
    """png: aff_*.png (or modes.json) of each case; toras: outlines of the *toras_anns.json files in the benchmark's folder"""
    swap: bool = False
    """exchange left and right, to measure the effect of telling the hands apart"""
    proposals: int = 3
    """proposals (a choice of hands and a hypothesis) that best_mode_iou uses: the most probable ones of each method"""
    calibration_floor: float = 0.05
    """least predicted probability of pixels that count for calibration"""


def run(cases: FileTree, predictions: FileTree, params: Params) -> MethodScores:
    """Score one method, named after its tree."""
    from afford.dataset import act_affordance
    from afford.twohands.benchmark import answers, case_sheets, score
    from afford.twohands.benchmark.cases import read
    from afford.twohands.benchmark.toras import of_tree

    outlines = of_tree(cases) if params.truth == "toras" else None
    method = answers.open_method(predictions, params.levels, params.level, params.protocol, params.proposals)
    listed = {files.where: files for files in act_affordance.cases(cases)}

    def answer(case: Case) -> Answer:
        found = method.answer(case)
        return found.swapped() if params.swap else found

    def fetch(case_id: str) -> tuple[Case, Answer]:
        case = read(listed[case_id], outlines)
        return case, answer(case)

    name = f"{predictions.name}_swapped" if params.swap else predictions.name
    found = (read(files, outlines) for files in listed.values())
    return score.score(name, found, method.levels, answer, params.calibration_floor,
                       lambda ids, iou: case_sheets.sheets(ids, iou, fetch))
