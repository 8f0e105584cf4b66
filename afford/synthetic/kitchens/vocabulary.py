"""EPIC-KITCHENS-100 verb and noun classes of the synthetic clips: a small part of the public tables, with EPIC's ids and keys.

Nouns outside EPIC's table (most workshop and desk objects) get a new id above EPIC's last one, and a row of their own in the
noun file of the clip.
"""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class WordClass:
    """One row of a class file; `instances` are the words of this class that are used here (EPIC lists more)."""

    id: int
    key: str
    instances: tuple[str, ...]
    category: str


VERBS = (
    WordClass(0, "take", ("take", "pick-up", "grab"), "retrieve"),
    WordClass(1, "put", ("put", "put-down", "place"), "leave"),
    WordClass(2, "wash", ("wash", "clean", "wipe"), "clean"),
    WordClass(3, "open", ("open",), "access"),
    WordClass(4, "close", ("close",), "block"),
    WordClass(7, "cut", ("cut", "chop", "slice"), "split"),
    WordClass(9, "pour", ("pour", "pour-into"), "merge"),
    WordClass(10, "mix", ("mix", "stir"), "merge"),
    WordClass(11, "move", ("move", "pass"), "transition"),
    WordClass(15, "shake", ("shake",), "manipulate"),
    WordClass(21, "press", ("press", "push"), "manipulate"),
    WordClass(23, "turn", ("turn", "rotate"), "manipulate"),
    WordClass(24, "check", ("check", "inspect"), "monitor"),
    WordClass(32, "pat", ("pat", "tap"), "sense"),
    WordClass(33, "lift", ("lift",), "retrieve"),
    WordClass(34, "hold", ("hold",), "manipulate"),
    WordClass(64, "attach", ("attach", "staple"), "merge"),
    WordClass(71, "unscrew", ("unscrew",), "access"),
    WordClass(78, "screw", ("screw", "tighten"), "manipulate"),
    WordClass(89, "carry", ("carry",), "transition"),
    WordClass(97, "hammer", ("hammer",), "manipulate"),
)

NOUNS = (
    WordClass(1, "spoon", ("spoon",), "cutlery"),
    WordClass(2, "plate", ("plate",), "crockery"),
    WordClass(4, "knife", ("knife",), "cutlery"),
    WordClass(5, "pan", ("pan",), "cookware"),
    WordClass(6, "lid", ("lid",), "containers"),
    WordClass(7, "bowl", ("bowl",), "crockery"),
    WordClass(9, "sponge", ("sponge",), "cleaning equipment and material"),
    WordClass(10, "glass", ("glass",), "crockery"),
    WordClass(13, "cup", ("cup", "mug", "pen cup"), "crockery"),
    WordClass(14, "fork", ("fork",), "cutlery"),
    WordClass(15, "bottle", ("bottle", "bottle:water"), "containers"),
    WordClass(17, "cloth", ("cloth",), "cleaning equipment and material"),
    WordClass(18, "board:chopping", ("board:chopping", "board", "block"), "utensils"),
    WordClass(20, "spatula", ("spatula",), "utensils"),
    WordClass(23, "box", ("box", "box:cereal"), "containers"),
    WordClass(26, "package", ("package", "carton"), "containers"),
    WordClass(29, "pot", ("pot",), "cookware"),
    WordClass(40, "jar", ("jar",), "containers"),
    WordClass(44, "kettle", ("kettle",), "appliances"),
    WordClass(49, "paper", ("paper",), "materials"),
    WordClass(61, "can", ("can", "tin"), "containers"),
    WordClass(66, "jug", ("jug",), "crockery"),
    WordClass(79, "scissors", ("scissors",), "utensils"),
    WordClass(97, "ladle", ("ladle",), "utensils"),
    WordClass(103, "brush", ("brush",), "cleaning equipment and material"),
    WordClass(140, "book", ("book",), "other"),
    WordClass(165, "phone", ("phone",), "appliances"),
    WordClass(180, "cellar:salt", ("cellar:salt", "mill:pepper"), "containers"),
    WordClass(218, "whisk", ("whisk",), "utensils"),
    WordClass(291, "pen", ("pen",), "utensils"),
    WordClass(296, "tape", ("tape",), "utensils"),
    WordClass(300, "hand:left", ("hand:left",), "hand"),
    WordClass(301, "hand:right", ("hand:right",), "hand"),
)

FIRST_NEW_NOUN = 306
NEW_NOUNS = ("hammer", "screwdriver", "drill", "wrench", "pliers", "saw", "toolbox", "glue", "wood", "paint",
             "stapler", "laptop", "notebook", "pencil", "case")


def verb_class(word: str) -> WordClass:
    """Return the class of a narrated verb. Raises KeyError with the verb."""
    return _find(VERBS, word, "verb")


def noun_class(word: str) -> WordClass:
    """Return the class of a narrated noun. A noun outside EPIC's table has a class of its own above EPIC's last id."""
    if word in NEW_NOUNS:
        return WordClass(FIRST_NEW_NOUN + NEW_NOUNS.index(word), word, (word,), "other")
    return _find(NOUNS, word, "noun")


def _find(classes: tuple[WordClass, ...], word: str, kind: str) -> WordClass:
    for entry in classes:
        if word == entry.key or word in entry.instances:
            return entry
    raise KeyError(f"afford/synthetic/kitchens/vocabulary.py: the {kind} {word!r} has no class; add a row for it")
