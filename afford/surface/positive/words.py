"""A task and a thing as a narration has them: 'cut bread' and knife are 'cut bread with knife'."""

from __future__ import annotations

DEFAULT_VERB = "use"
"""what is done where nobody says"""


def as_narration(task: str, category: str) -> str:
    """The task, with the thing where its words do not name it; what a model of narrations is asked."""
    thing = category.replace("_", " ")
    if not thing or f" {thing} " in f" {task} ":
        return task or DEFAULT_VERB
    return f"{task} with {thing}" if task else f"{DEFAULT_VERB} {thing}"
