"""The tasks that a model is told, true or not."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np


def tasks(given: Sequence[str], text: str, seed: int) -> list[str]:
    """`given`, `shuffled` or `removed` tasks, one per case. ValueError for another word."""
    if text == "given":
        return list(given)
    if text == "removed":
        return [""] * len(given)
    if text == "shuffled":
        return shuffled(given, seed)
    raise ValueError(f"text: expected given, shuffled or removed, got {text!r}")


def shuffled(given: Sequence[str], seed: int) -> list[str]:
    """Every case gets a task of another wording, drawn by seed among the cases that have one. ValueError when all are alike."""
    if len(set(given)) < 2:
        raise ValueError("text shuffled: expected cases with at least two different tasks, got one; nothing can be exchanged")
    rng = np.random.default_rng(seed)
    words = np.array(given, dtype=object)
    return [str(rng.choice(words[words != own])) for own in given]
