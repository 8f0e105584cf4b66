"""Scores of trained rows -> metrics.json, scores.json, report.md and a sheet."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import NamedTuple

import cv2

from afford.common.files import write_json
from afford.common.image_files import encode_png
from afford.rgbd.evaluate import flow, page, sheet
from afford.rgbd.evaluate.figures import figures, intervals
from afford.rgbd.evaluate.recipes import WHOLE, label
from afford.training import ablation
from schemas.interaction import FlowScore, InteractionScores
from schemas.training import Recipe

Rows = dict[str, list[dict[str, float]]]
"""line of the table -> figures of each finished seed"""


class Found(NamedTuple):
    """All that a report tells of."""

    recipes: tuple[Recipe, ...]
    scores: tuple[InteractionScores, ...]
    """of those that are finished"""
    flows: tuple[FlowScore, ...]


def write(root: Path, found: Found, by_row: bool, resamples: int, seed: int) -> None:
    """Everything, into an empty folder; the sheet is of the whole model, where it is finished. By row, a table of what was planned
    is written also when nothing is finished yet. ValueError when nothing else is there to tell, or scores are of another plan.
    """
    done = {one.name: figures(one) for one in found.scores}
    planned = [recipe.name for recipe in found.recipes]
    strange = sorted(done.keys() - set(planned))
    if strange or not (done or by_row):
        raise ValueError(f"sor3d_report: expected scores of {', '.join(planned)}, got {', '.join(strange) or 'none'}")
    first = min(found.scores, key=lambda one: (not one.name.startswith(f"{WHOLE}-"), planned.index(one.name)), default=None)
    if by_row or first is None:
        rows, wanted = by_label(found.recipes, done), plan(found.recipes)
        numbers, text = ablation.metrics(rows, wanted), page.ablation(rows, wanted)
    else:
        numbers = done[first.name] | intervals(first, resamples, seed)
        text = page.model(numbers, len(first.clip))
    motion = flow.figures(found.flows)
    numbers |= motion
    write_json(root / "metrics.json", numbers)
    write_json(root / "scores.json", done)
    (root / "report.md").write_text(text + page.motion(motion), encoding="utf-8", newline="\n")
    if first is not None and first.shown:
        (root / "sheet.png").write_bytes(encode_png(cv2.cvtColor(sheet.draw(first), cv2.COLOR_RGB2BGR)).tobytes())


def by_label(recipes: tuple[Recipe, ...], done: Mapping[str, dict[str, float]]) -> Rows:
    """Figures of the finished seeds of every line that was planned."""
    return {name: [done[recipe.name] for recipe in recipes if label(recipe) == name and recipe.name in done]
            for name in dict.fromkeys(map(label, recipes))}  # fmt: skip


def plan(recipes: tuple[Recipe, ...]) -> dict[str, int]:
    """How many seeds every line was to have."""
    return {name: sum(label(recipe) == name for recipe in recipes) for name in dict.fromkeys(map(label, recipes))}
