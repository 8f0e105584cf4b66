"""The rows of the ablation: what each one changes, and its seeds."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any

from schemas.training import Recipe

FULL: dict[str, Any] = {"variant": "small", "hypotheses": 3, "text": True, "decoders": 2, "target": "affordance",
                        "data": "stills"}  # fmt: skip
ROWS: dict[str, dict[str, Any]] = {
    "full": {},
    "no_text": {"text": False},
    "clip": {"variant": "clip"},
    "k1": {"hypotheses": 1},
    "lisa": {"hypotheses": 1, "decoders": 1, "target": "object"},
    "hotspot": {"hypotheses": 1, "decoders": 1, "text": False},
    "extracted": {"data": "extracted"},
}
"""full: the small model; no_text: it is not told the task; clip: 2HAff-CLIP; k1: one region per hand, the paper's model; lisa: one
decoder and whole objects; hotspot: one heat map, no text; extracted: labels that the extraction took from rendered videos"""


def recipes(rows: Iterable[str], seeds: int) -> tuple[Recipe, ...]:
    """Every row with seed 0, then every row with seed 1, ...: what is stopped early has something of each. ValueError for an
    unknown row.
    """
    unknown = sorted(set(rows) - ROWS.keys())
    if unknown or seeds < 1:
        raise ValueError(f"ablation: expected rows of {', '.join(ROWS)} and at least one seed, got {unknown or seeds}")
    return tuple(Recipe(name=f"{row}-{seed}", row=row, seed=seed, **FULL | ROWS[row]) for seed in range(seeds) for row in rows)
