"""The card of a trained scorer of parts: what it learned from, how well it does, and its limits."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence

from afford.training.state import TrainingState
from schemas.surface import PartLessons


def text(lessons: Sequence[PartLessons], state: TrainingState) -> str:
    """The whole card, Markdown."""
    found = {point.name: point.value for point in state.points if point.step == state.best_step}
    counts = Counter(one.split for one in lessons)
    kinds = ", ".join(sorted({one.category.replace("_", " ") for one in lessons}))
    return f"""# Scorer of parts

Learned from {counts["train"]} procedural objects, judged by {counts["val"]} of the same categories in other shapes: {kinds}.
Kept after step {state.best_step}: {found["val.right"]:.3f} of the candidates have their main part told right, and shares are off by
{found["val.error"]:.3f} on average. These figures chose the step, so they flatter.

It knows shapes, not colours: it sees brightness, outlines and normals. It learned from clean meshes; scans are rougher. Of things
that it never saw it knows what the words for a part's looks say, and no more. It says nothing about whether touching is safe.
"""
