"""A narration in plain English -> verb and nouns, for tables that do not give them: 'pick up the red mug' -> pick-up, mug:red.

Only what the imperative sentences of such tables need: the first word is the verb, particles join it, the last word before a
preposition is the head of a noun. Nothing is guessed about hands.
"""

from __future__ import annotations

import re

PARTICLES = {"up", "down", "on", "off", "in", "out", "away", "over", "back", "together", "apart"}
PREPOSITIONS = {"into", "onto", "in", "on", "from", "to", "with", "of", "under", "over", "for", "at", "by", "inside", "and",
                "through", "around", "off", "out", "using", "against", "towards", "near"}
SKIPPED = {"the", "a", "an", "some", "my", "his", "her", "their", "this", "that", "both", "then"}


def verb_and_nouns(text: str) -> tuple[str, tuple[str, ...]]:
    """(verb, nouns) of a sentence, in EPIC's spelling: verb-particle, head:modifiers. ('', ()) for an empty one."""
    found = [word for word in re.findall(r"[^\W_]+(?:'[^\W_]+)?", text.lower()) if word not in SKIPPED]
    if not found:
        return "", ()
    particle = len(found) > 1 and found[1] in PARTICLES
    verb = "-".join(found[: 1 + particle])
    return verb, tuple(_noun(group) for group in _groups(found[1 + particle :]))


def _groups(found: list[str]) -> list[list[str]]:
    groups: list[list[str]] = [[]]
    for word in found:
        if word in PREPOSITIONS:
            groups.append([])
        else:
            groups[-1].append(word)
    return [group for group in groups if group]


def _noun(group: list[str]) -> str:
    return ":".join([group[-1], *group[:-1]])
