"""What is not known, like the nearest that is."""

from __future__ import annotations

import cv2
import numpy as np


def fill_nearest(image: np.ndarray, known: np.ndarray) -> np.ndarray:
    """The image (h, w, c), where it is not known (h, w) bool, like its nearest known pixel."""
    _, label = cv2.distanceTransformWithLabels((~known).astype(np.uint8), cv2.DIST_L2, 5, labelType=cv2.DIST_LABEL_PIXEL)
    by_label = np.zeros((int(label.max()) + 1, image.shape[2]), image.dtype)
    by_label[label[known]] = image[known]
    return by_label[label]
