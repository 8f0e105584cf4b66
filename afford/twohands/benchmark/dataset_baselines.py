"""Baselines that are made from a data set: the mean mask of a class, and the extraction itself.

For a case of the masks set, the mean mask is over the whole images of the training split; for a crop, over crops to the objects
with a border. A class that training lacks is replaced by that of the noun alone, then by the mean over all samples. The mean is
scaled so that a cut at 0.5 has the mean area of the class.

The extraction covers whole images only, because a crop of the benchmark does not say where in the image it was. Wide frames are
padded at the top to a square when the case is square, as in 2HandedAfforder.
"""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import cv2
import numpy as np

from afford.common.masks import BORDER, box
from afford.dataset import load, masks
from afford.dataset.table_schema import MASKS
from afford.twohands.benchmark.baselines import Baseline, one_hypothesis
from afford.twohands.benchmark.cases import Size, resize_mask
from schemas.affordance import TAKES
from schemas.benchmark import Case, Prediction

GRID = 64
"""side of the grid on which masks are averaged"""
CLASS_COLUMNS = ("verb", "noun", "height", "width", "taxonomy", *(f"{name}_rle" for name in MASKS))
Key = tuple[str, str, str]
"""protocol, verb, noun; '' for any"""


class Mean:
    """Running mean of the masks and taxonomies of one class."""

    def __init__(self) -> None:
        self._sum = np.zeros((2, GRID, GRID))
        self._count = np.zeros(2)
        self._taxonomy = np.zeros(4)

    def add(self, planes: np.ndarray, taxonomy: int) -> None:
        """Add a sample with shares of pixels (2, GRID, GRID)."""
        self._sum += planes
        self._count += TAKES[taxonomy]
        self._taxonomy[taxonomy] += 1

    def prediction(self, case: Case) -> Prediction:
        """Return the mean at the size of a case."""
        height, width = case.modes.shape[2:]
        mean = self._sum / np.maximum(self._count, 1)[:, None, None]
        scaled = np.stack([_scaled(plane) for plane in mean]).astype(np.float32)
        planes = np.stack([cv2.resize(plane, (width, height), interpolation=cv2.INTER_LINEAR) for plane in scaled])
        share = self._taxonomy / self._taxonomy.sum()
        return one_hypothesis(case.task, planes, np.array(TAKES[int(share.argmax())]), share)


def class_mean(dataset: Path | None) -> Baseline:
    """Mean mask of a class: where hands were in the training split for this verb and noun. ValueError without a data set."""
    if dataset is None:
        raise ValueError("class_mean: expected a data set with a train split, got none; give the one that the model learns from")
    means: dict[Key, Mean] = defaultdict(Mean)
    for row in load.rows(dataset, "train", CLASS_COLUMNS):
        verb, noun = row["verb"].lower(), row["noun"].lower()
        for protocol, planes in _planes(row):
            for key in ((protocol, verb, noun), (protocol, "", noun), (protocol, "", "")):
                means[key].add(planes, row["taxonomy"])
    return lambda case: _best(means, case).prediction(case)


def _best(means: dict[Key, Mean], case: Case) -> Mean:
    verb, noun = case.verb.lower(), case.noun.lower()
    keys = ((case.protocol, verb, noun), (case.protocol, "", noun), (case.protocol, "", ""))
    return next(means[key] for key in keys if key in means)


def _planes(row: dict[str, Any]) -> Iterator[tuple[str, np.ndarray]]:
    """Affordances of a sample on the grid: of the whole image, and of its crop."""
    planes = masks.decode_rle([row[f"{name}_rle"] for name in MASKS], row["height"], row["width"])
    objects = planes[2] | planes[3] | planes[0] | planes[1]
    border = round(BORDER * max(objects.shape))
    for protocol, part in (("masks", planes[:2]), ("cropped", planes[:2, *box(objects, border)])):
        yield protocol, np.stack([cv2.resize(mask.astype(np.float32), (GRID, GRID), interpolation=cv2.INTER_AREA) for mask in part])


def _scaled(plane: np.ndarray) -> np.ndarray:
    """Scale a plane so that a cut at 0.5 keeps its mean area; values are at most 1."""
    pixels = round(plane.sum())
    if pixels < 1:
        return plane
    level = np.sort(plane, axis=None)[-pixels]
    return np.minimum(plane / (2 * level), 1.0) if level > 0 else plane


REGIONS = ("mask_left_rle", "mask_right_rle")
EXTRACTED_COLUMNS = ("video", "frame", "height", "width", "taxonomy", *REGIONS)


def extraction(dataset: Path | None) -> Baseline:
    """AffExtract: the masks that the extraction took from the same frame, by video and number. ValueError without a data set."""
    if dataset is None:
        raise ValueError("extraction: expected a data set of the benchmark's videos, got none; extract them with `run dataset`")
    rows = {(row["video"], row["frame"]): row
            for split in load.splits(dataset) for row in load.rows(dataset, split, EXTRACTED_COLUMNS)}

    def answer(case: Case) -> Prediction | None:
        row = rows.get((case.video, int(case.frame))) if case.protocol == "masks" and case.frame.isdigit() else None
        if row is None:
            return None
        found = masks.decode_rle([row[name] for name in REGIONS], row["height"], row["width"])
        planes = np.stack([to_case_grid(mask, (case.modes.shape[2], case.modes.shape[3])) for mask in found])
        return one_hypothesis(case.task, planes, np.array([mask.any() for mask in found]), np.eye(4)[row["taxonomy"]])

    return answer


def to_case_grid(mask: np.ndarray, size: Size) -> np.ndarray:
    """Resize a mask to the grid of a case: (h, w) bool."""
    height, width = mask.shape
    if size[0] == size[1] and width > height:
        mask = np.pad(mask, ((width - height, 0), (0, 0)))
    return resize_mask(mask, size)
