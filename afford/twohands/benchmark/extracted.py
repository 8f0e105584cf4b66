"""AffExtract: the extraction itself as a method, where a data set holds the very frames of the benchmark.

Whole images only: a crop of the benchmark does not say where in the image it lies. Wide frames are padded at the top to a square
when the case is square, as 2HandedAfforder pads them.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np

from afford.dataset import load, masks
from afford.twohands.benchmark.baselines import Baseline, said
from afford.twohands.benchmark.cases import Size, resize_mask
from schemas.benchmark import Case, Prediction

REGIONS = ("mask_left_rle", "mask_right_rle")
COLUMNS = ("video", "frame", "height", "width", "taxonomy", *REGIONS)


def extraction(dataset: Path | None) -> Baseline:
    """What was extracted from each frame, found by video and frame number. ValueError without a data set."""
    if dataset is None:
        raise ValueError("extraction: expected a data set of the benchmark's videos, got none; extract them with `run dataset`")
    rows = {(row["video"], row["frame"]): row for split in load.splits(dataset) for row in load.rows(dataset, split, COLUMNS)}

    def answer(case: Case) -> Prediction | None:
        row = rows.get((case.video, int(case.frame))) if case.protocol == "masks" and case.frame.isdigit() else None
        if row is None:
            return None
        found = masks.decode_rle([row[name] for name in REGIONS], row["height"], row["width"])
        planes = np.stack([place(mask, (case.modes.shape[2], case.modes.shape[3])) for mask in found])
        return said(case.task, planes, np.array([mask.any() for mask in found]), np.eye(4)[row["taxonomy"]])

    return answer


def place(mask: np.ndarray, size: Size) -> np.ndarray:
    """(h, w) bool on the grid of a case."""
    height, width = mask.shape
    if size[0] == size[1] and width > height:
        mask = np.pad(mask, ((width - height, 0), (0, 0)))
    return resize_mask(mask, size)
