"""A task and a thing as a narration has them: 'cut bread' and knife are 'cut bread with knife'."""

from __future__ import annotations

ANY = "use"
"""what is done where nobody says"""


def in_words(task: str, category: str) -> str:
    """The task, with the thing where its words do not name it; what a model of narrations is asked."""
    thing = category.replace("_", " ")
    if not thing or f" {thing} " in f" {task} ":
        return task or ANY
    return f"{task} with {thing}" if task else f"{ANY} {thing}"
