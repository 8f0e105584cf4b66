"""Load a two-hand model as a function from image and task to the union of both hands' regions."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np

from afford.common.files import copy_folder, empty_folder
from afford.common.text import as_narration
from afford.twohands.model.predictor import Predictor
from schemas.files import FileTree


def load_region_predictor(model: FileTree, category: str, scratch: Path) -> Callable[[np.ndarray, str], np.ndarray]:
    """Return a function from an image (h, w, 3) of an object of `category` and a task to a region (h, w) bool.

    The region is the union of the regions of both hands, also where the model does not see the object, which is there.
    """
    predictor = Predictor(copy_folder(model, "config.json", empty_folder(scratch)), always=True)

    def ask(rgb: np.ndarray, task: str) -> np.ndarray:
        found = predictor.predict(rgb, as_narration(task, category))
        return found.mask(0) | found.mask(1)

    return ask
