"""What a model is asked about an object and a task: words of our own, an answer in JSON that answer.py reads.

AffordDex asks for one part that should not be touched, whatever the task; here all parts are asked for, and the task is told.
"""

from __future__ import annotations

import json
from collections.abc import Sequence

PROMPT = """\
The picture shows one object from these sides, row by row: {sides}.{said}
{task}

Say what the object is. Then name every part of it that has a shape of its own, and judge for each whether a bare hand
- must not touch it during this task ("negative": it cuts, burns, catches, breaks, must stay clean, or must stay free for others),
- belongs there ("positive"), or
- may touch it, but need not ("neutral").

Answer with one JSON object and nothing else:
{{"category": "what the object is, one or two words",
 "parts": [{{"part": "its name, one word",
            "role": "negative, positive or neutral",
            "looks": "its shape and place, such as: a long flat thin plate at the end",
            "reason": "why, in one sentence",
            "confidence": a number from 0 to 1,
            "task_changes": true if another task with this object would turn the role round, else false}}]}}
For "looks" use few plain words, these where they fit: {words}.
If you do not know what the object is, do not guess; answer {{"category": "unknown", "parts": []}}
"""


LOOK_WORDS = """\
long, short, tall, thin, thick, large, small, wide, flat, round, curved, bent, pointed, shallow, hollow, bar, block, plate, disc,
dish, ring, loop, hook, rod, wire, tube, cylinder, cone, ball, box, bowl, dome, vessel, wedge; at the end, at the very end, across
the end, in the middle, on top, around the top, on the side, on both sides, below, at the bottom"""
"""those of looks.py, which the embedded scorer has learned"""


def part_prompt(category: str, task: str, sides: Sequence[str]) -> str:
    """The question about an object that is said to be a `category` ('' when nobody said), for a task in words ('' for any use),
    with a picture that shows `sides`.
    """
    said = f" Somebody says that it is this: {_quote(category.replace('_', ' '))}." if category else ""
    doing = f"The task: {_quote(task)}." if task else "No task is given: think of its usual use."
    return PROMPT.format(sides=", ".join(sides), said=said, task=doing, words=LOOK_WORDS)


def _quote(text: str) -> str:
    """On one line, whatever it holds."""
    return json.dumps(text, ensure_ascii=False)
