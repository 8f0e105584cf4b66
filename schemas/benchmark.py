"""Benchmark cases, predictions of a method, and the scores of methods and of extraction stages."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

from schemas.spec import Schema, array, value
from schemas.video import SIDES

if TYPE_CHECKING:
    import numpy as np

@dataclass(frozen=True)
class Case(Schema):
    """One image with its task and every valid mode. `h w` is the grid on which masks are compared."""

    protocol: str = value("masks (the whole image) or cropped (the objects and a border)")
    video: str = value("EPIC video id, Ego4D clip, or a rendered scene")
    frame: str = value("frame number in the folder's name")
    groups: tuple[str, ...] = value("rows of the report that the case counts in: all, kitchen, shift, epic, ego4d, ...")
    task: str = value("the narration: 'pour tea from kettle'")
    verb: str = value("as annotated, '' when it is not")
    noun: str = value("as annotated, '' when it is not")
    image: np.ndarray = array("b", "uint8", "encoded bytes of inpainting.png (PNG or JPEG), hands removed, at its own size")
    modes: np.ndarray = array("m 2 h w", "bool", "true region of the (left, right) hand in each mode", encoding="rle")
    taxonomy: np.ndarray = array("m", "int8", "Taxonomy of each mode as annotated; -1 when it is not")
    objects: np.ndarray = array("2 h w", "bool", "complete object of the (left, right) hand", encoding="rle")
    notes: tuple[str, ...] = value("what is odd about the files: taxonomy disagrees, aff_left resized, ...")

    @property
    def case_id(self) -> str:
        """Id that is unique in a benchmark."""
        return f"{self.protocol}/{self.video}/{self.frame}"


@dataclass(frozen=True)
class Sheet(Schema):
    """Contact sheet of the best, the median and the worst cases of one protocol."""

    protocol: str = value("masks or cropped")
    jpeg: np.ndarray = array("b", "uint8", "JPEG bytes: prediction filled, truth outlined")


@dataclass(frozen=True)
class MethodScores(Schema):
    """Scores of one method, one row per case, so that any group of cases can be averaged and resampled."""

    name: str = value("method: small, whole_object, the name of a folder of predictions")
    case_id: tuple[str, ...] = value("n cases, by name")
    protocol: tuple[str, ...] = value("of each case")
    groups: tuple[tuple[str, ...], ...] = value("of each case")
    notes: tuple[tuple[str, ...], ...] = value("of each case")
    measure: tuple[str, ...] = value("c names of the columns of `values`")
    values: np.ndarray = array("n c", "float64", "strict measures; NaN where one does not apply")
    level: tuple[float, ...] = value("l thresholds at which the method was cut")
    compat: np.ndarray = array("n l 4", "float64", "released definitions: IoU, precision, directed and symmetric Hausdorff in px; "
                               "NaN where the released script skips the case")
    taxonomy_true: np.ndarray = array("n", "int8", "Taxonomy; of several valid ones the predicted one, else the first")
    taxonomy_found: np.ndarray = array("n", "int8", "most probable Taxonomy, -1 when the method predicts none")
    reliability: np.ndarray = array("n 3 b", "float64", "per bin of predicted probability: pixels, their summed probability, "
                                    "their summed truth (share of the modes that hold the pixel)")
    sheets: tuple[Sheet, ...] = value("one per protocol")


@dataclass(frozen=True)
class Prediction(Schema):
    """Prediction for an image: k region hypotheses per hand, their probabilities, and the taxonomy."""

    task: str = value("what is to be done: 'pour tea from kettle'")
    probability: np.ndarray = array("2 k h w", "float32", "hand (left, right), hypothesis; 0..1, at the image's own size")
    score: np.ndarray = array("2 k", "float32", "probability that this hypothesis is the one; each row sums to 1")
    taxonomy: np.ndarray = array("4", "float32", "probabilities of left, right, both_same, both_different; their sum is 1")
    hands: np.ndarray = array("2", "bool", "which hands (left, right) are returned after selection")
    threshold: float = value("a pixel belongs to the region where its probability is above this")
    answer: str = value("text that a language model generated; '' for other models", default="")
    calibration: tuple[float, float] = value("slope and offset that calibrated the logits of the model", default=(1.0, 0.0))
    present: float = value("probability that what the task names is in the image; 1 where a model does not tell", default=1.0)

    def mask(self, side: int | str) -> np.ndarray:
        """Return the top-ranked region (h, w) bool of a hand (0 or 'left', 1 or 'right'); empty when the hand is not selected."""
        hand = SIDES.index(side) if isinstance(side, str) else side
        found: np.ndarray = self.probability[hand, self.score[hand].argmax()] > self.threshold
        return found & self.hands[hand]


@dataclass(frozen=True)
class Score(Schema):
    """One measured quantity of one clip, as a sum and a count, so that means over clips weigh all items equally."""

    name: str = value("dotted name, e.g. densify.j.gap15 or baseline.nearest.j.gap15")
    total: float = value("sum over items")
    count: int = value("number of items")


@dataclass(frozen=True)
class ClipScores(Schema):
    """Scores of the extraction stages on one clip."""

    clip_id: str = value("clip")
    hard: tuple[str, ...] = value("why the clip is hard; empty for a standard clip")
    frames: int = value("number of frames of the clip")
    scores: tuple[Score, ...] = value("by name")
    sheet_jpeg: np.ndarray = array("b", "uint8", "JPEG bytes: frame, masks, inpainted, truth, complete object, affordance")
