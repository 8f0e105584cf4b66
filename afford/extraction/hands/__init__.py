"""Where hands are in pictures, what they touch and where sleeves are: the question that the backends of `hand_detect` answer, each
picture alone."""

from __future__ import annotations

from typing import Any, Protocol

import numpy as np

from schemas.files import FileTree

LEFT, RIGHT, TOUCHED, SLEEVE = range(4)
"""what the last axis of an answer stands for"""


class Find(Protocol):
    """A backend. What is known of time, of the clip's own colours and of motion comes after it."""

    def __call__(self, rgb: np.ndarray, params: Any, weights: FileTree | None = None) -> np.ndarray:
        """Pictures (n, h, w, 3) uint8 -> (n, h, w, 4) float32, 0..1: how likely a pixel is left hand, right hand, touched object,
        sleeve.

        `params` is stages.extraction.hand_detect.Params; `weights` are the files of the finder, as the stage was given them.
        """
        ...
