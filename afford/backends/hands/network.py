"""The embedded finder: a small network that learned hands in rooms that are rendered here."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from afford.detect.finder import find as ask


def find(rgb: np.ndarray, params: Any) -> np.ndarray:
    """Reads `model`: the folder that hands_train wrote."""
    if not params.model:
        raise ValueError("backend 'network': expected the files that hands_train wrote, got none; give them as `weights`")
    return ask(rgb, Path(params.model))
