"""The card of a trained finder of hands: what it learned from, how well it does, and its limits."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence

from afford.training.state import TrainingState
from schemas.scene import HandLessons


def text(lessons: Sequence[HandLessons], state: TrainingState) -> str:
    """The whole card, Markdown."""
    found = {point.name: point.value for point in state.points if point.step == state.best_step}
    rooms = Counter(one.split for one in lessons)
    pictures = {split: sum(len(one.pictures) for one in lessons if one.split == split) for split in rooms}
    parts = {"hands": "iou", "touched things": "touched_iou", "sleeves": "sleeve_iou"}
    scores = "IoU " + ", ".join(f"{found['val.' + name]:.3f} of {what}" for what, name in parts.items())
    sides = f"the side of {found['val.sides']:.3f} of the hands' pixels"
    return f"""# Finder of hands

Learned from {pictures["train"]} rendered pictures of {rooms["train"]} rooms, each in many disguises, and was judged by
{pictures["val"]} of {rooms["val"]} others. Kept after step {state.best_step}: {scores};
{sides} is right, on disguised pictures. These figures chose the step, so they flatter.

It has never seen a real hand. Skin counts up to the sleeve, with gloves and watches. It takes the person to be on the near side,
looks at each picture by itself, and knows no other people's hands: whatever looks like a hand is one of the person's own.
"""
