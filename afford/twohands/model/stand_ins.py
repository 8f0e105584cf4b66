"""Words that a model was not trained with, read as others: their base form, or a word for a thing of like form and use.

A model reads an unknown word by its letters, which is no better than noise. A cup is held like a mug, so `lift cup` is read as
`lift mug` by a model that knows mugs.
"""

from __future__ import annotations

from functools import cache
from typing import NamedTuple

from afford.models.word_vectors import split_words
from afford.twohands.model.class_words import base_forms
from afford.twohands.model.model_folder import ModelFolder, Vocabulary

ALIKE: dict[tuple[str, ...], str] = {
    ("mug", "glass"): "cup teacup beaker tankard",
    ("glass", "mug"): "tumbler goblet wineglass flute",
    ("jug", "pot", "mug"): "pitcher kettle teapot carafe creamer",
    ("bottle", "jar"): "flask thermos shampoo detergent ketchup vinegar spray lotion",
    ("can", "jar"): "tin soda cola beer thermos",
    ("jar", "can"): "canister glue candle",
    ("box", "carton"): "package packet parcel cereal container case book phone laptop remote stapler toolbox tape",
    ("pan", "pot"): "skillet wok griddle frypan saucepan",
    ("pot", "pan"): "casserole cooker bucket saucepan",
    ("plate", "board"): "dish saucer tray lid",
    ("bowl", "plate"): "basin colander strainer sieve",
    ("board", "plate"): "tablet",
    ("knife", "spoon"): "cleaver scissors saw razor cutter peeler dagger",
    ("spoon", "ladle"): "teaspoon tablespoon scoop",
    ("ladle", "spoon", "whisk"): "spatula turner scraper trowel shovel",
    ("fork", "spoon"): "tongs chopsticks",
    ("whisk", "brush", "ladle"): "beater mixer hammer mallet screwdriver wrench spanner pliers drill chisel roller torch",
    ("brush", "whisk"): "toothbrush paintbrush broom comb marker pen pencil",
    ("mill", "jar"): "grinder shaker",
    ("take", "grab"): "fetch get remove pull grasp collect receive bring",
    ("put", "place"): "set lay leave drop insert store return",
    ("pour",): "fill empty tip drain serve decant",
    ("stir",): "mix beat blend whip",
    ("cut",): "slice dice mince carve halve peel",
    ("wash", "clean"): "rinse scrub wipe dry",
    ("open",): "unscrew uncap unlock unpack",
    ("close",): "shut screw seal cover cap",
    ("turn",): "flip rotate twist",
    ("lift", "take"): "raise hoist",
    ("carry", "move"): "transport pass",
    ("move", "carry"): "push slide drag shift",
    ("hold",): "grip keep use",
    ("shake",): "rattle",
    ("check", "inspect"): "look read examine",
}  # fmt: skip
"""words that stand in, best first, for each of the words"""
SIDES = frozenset(("left", "right", "hand", "hands", "both"))
"""words that choose a hand; always kept"""


@cache
def stand_ins() -> dict[str, tuple[str, ...]]:
    """Word -> words that may stand in for it, best first."""
    found: dict[str, tuple[str, ...]] = {}
    for known, words in ALIKE.items():
        for word in words.split():
            found[word] = tuple(dict.fromkeys((*found.get(word, ()), *known)))
    return found


class ReadTask(NamedTuple):
    """Task as a model with a vocabulary reads it."""

    text: str
    """words of the vocabulary; unchanged where nothing else is known"""
    read_as: dict[str, str]
    """word of the task -> the one that stands in"""
    unknown: tuple[str, ...]
    """words that no other stands in for; left out of `text` when a thing is named"""


def read_task(task: str, known: Vocabulary) -> ReadTask:
    """Replace unknown words of a task by words of the vocabulary, where one stands in."""
    strange = set(known.unknown(task)) - SIDES
    if not strange:
        return ReadTask(task, {}, ())
    read_as = {word: other for word in split_words(task) if word in strange and (other := _stand_in(word, known))}
    unknown = tuple(dict.fromkeys(word for word in split_words(task) if word in strange and word not in read_as))
    words = [read_as.get(word, word) for word in split_words(task)]
    things = {part for thing in known.things for part in split_words(thing)}
    if things & set(words):
        words = [word for word in words if word not in unknown]
    return ReadTask(" ".join(words), read_as, unknown)


def unknown_words(model: ModelFolder, task: str) -> list[str] | None:
    """Words of a task that no word of a model's training stands in for; None for a model without a vocabulary."""
    return None if model.words is None else list(read_task(task, model.words).unknown)


def words_read_as(model: ModelFolder, task: str) -> dict[str, str]:
    """Word of a task -> word of a model's training that stands in for it."""
    return {} if model.words is None else read_task(task, model.words).read_as


def _stand_in(word: str, known: Vocabulary) -> str | None:
    for form in base_forms(word):
        if form in known.words:
            return form
    return next((other for form in base_forms(word) for other in stand_ins().get(form, ()) if other in known.words), None)
