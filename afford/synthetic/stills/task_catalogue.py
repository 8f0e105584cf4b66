"""Catalogue of tasks: verb, sentence and the parts that each hand takes, for the objects on a table."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

from afford.synthetic.stills.table_layout import PlacedObject

HOLD: dict[str, tuple[str, ...]] = {
    "mug": ("body", "handle", "rim"), "bottle": ("body", "neck"), "water": ("body",), "kettle": ("handle",),
    "pan": ("handle",), "jar": ("body",), "box": ("side",), "carton": ("body",), "can": ("body", "rim"), "toolbox": ("handle",),
    "glue": ("body",), "paint": ("body", "rim"), "stapler": ("body",), "book": ("edge",), "laptop": ("edge",),
    "cup": ("body", "rim"), "phone": ("edge", "side"), "screwdriver": ("handle",), "bowl": ("edge",), "plate": ("edge",),
    "tape": ("rim", "body"), "wood": ("body",), "drill": ("handle",),
    "glass": ("body", "rim"), "grinder": ("body",),
}  # fmt: skip
"""Parts by which an object is picked up; any part for kinds that are not listed."""
WIDE: dict[str, tuple[str, ...]] = {
    "bowl": ("edge",), "plate": ("edge",), "board": ("edge",), "box": ("side",), "toolbox": ("body",), "laptop": ("side",),
    "book": ("side",), "wood": ("body",), "pan": ("handle",), "pot": ("handle",),
}  # fmt: skip
"""Kinds that two hands carry where both sides are free, and the parts that they take."""
OTHER_END = {"pan": ("pan rim",)}
"""Part that the second hand takes when the first hand holds the handle."""
TAKE = (("pick-up", "pick up {}"), ("take", "take {}"), ("take", "take the {}"), ("grab", "grab {}"))
PUT = (("put-down", "put down {}"), ("put", "put {} away"), ("place", "place {}"))
MOVE = (("move", "move {}"), ("move", "move {} aside"))
LIFT = (("lift", "lift {}"), ("carry", "carry {}"), ("hold", "hold {}"))


@dataclass(frozen=True)
class Task:
    """Task with the parts that each hand takes.

    `parts` of the first object are taken by one hand. `support` are the parts that the other hand takes, of the second object
    when there is one, else of the first. Without `both_required`, one hand is enough where two do not fit, and it then takes
    `one_hand_parts` (None: `parts`).
    """

    verb: str
    text: str
    objects: tuple[PlacedObject, ...]
    parts: tuple[str, ...]
    support: tuple[str, ...] | None = None
    both_required: bool = True
    one_hand_parts: tuple[str, ...] | None = None

    @property
    def kinds(self) -> tuple[str, ...]:
        """Kinds of the objects."""
        return tuple(obj.model.kind for obj in self.objects)


@dataclass(frozen=True)
class ToolUse:
    """Row of the catalogue: `kinds` are used by themselves or on one of `targets`. '{0}' is the object, '{1}' the target."""

    verb: str
    texts: tuple[str, ...]
    kinds: tuple[str, ...]
    parts: tuple[str, ...] = ()
    support: tuple[str, ...] | None = None
    targets: tuple[str, ...] = ()
    both_required: bool = True


POURED = ("bottle", "carton", "water", "jar", "can", "kettle", "jug")
TOOL_USES = (
    ToolUse("shake", ("shake {0}",), ("bottle", "jar", "carton", "can", "water", "glue"), ("body",)),
    ToolUse("check", ("check {0}", "inspect {0}"), ("can", "jar", "carton", "phone", "book"), ("body", "edge")),
    ToolUse("open", ("open {0}", "open the {0}"), ("jar",), ("lid",), ("body",)),
    ToolUse("close", ("close {0}",), ("jar",), ("lid",), ("body",)),
    ToolUse("open", ("open {0}",), ("bottle",), ("neck",), ("body",)),
    ToolUse("open", ("open {0}",), ("water",), ("lid",), ("body",)),
    ToolUse("open", ("open {0}", "open the {0}"), ("box",), ("flap",), ("side",), both_required=False),
    ToolUse("close", ("close {0}",), ("box",), ("flap",), ("side",), both_required=False),
    ToolUse("open", ("open {0}",), ("kettle",), ("lid",), ("handle",), both_required=False),
    ToolUse("open", ("open {0}",), ("toolbox",), ("lid",)),
    ToolUse("open", ("open {0}",), ("book",), ("cover",)),
    ToolUse("open", ("open {0}",), ("laptop",), ("screen",)),
    ToolUse("open", ("open {0}",), ("glue",), ("tip",), ("body",)),
    ToolUse("press", ("press {0}", "push {0}"), ("stapler",), ("arm",)),
    ToolUse("tighten", ("tighten with {0}",), ("wrench",), ("handle",)),
    ToolUse("turn", ("turn {0}",), ("grinder",), ("head",), ("body",)),
    ToolUse("pour", ("pour from {0}",), POURED, ("body", "handle")),
    ToolUse("pour", ("pour from {0} into {1}", "pour {0} into {1}"), POURED, ("body", "handle"), ("body", "handle"),
        ("mug", "cup", "glass"), both_required=False),
    ToolUse("pour", ("pour from {0} into {1}",), POURED, ("body", "handle"), None, ("bowl", "pan", "pot")),
    ToolUse("stir", ("stir {1} with {0}", "stir in {1} with {0}"), ("spoon", "spatula", "ladle", "whisk"), (),
        ("edge", "handle", "body"), ("bowl", "pan", "mug", "pot")),
    ToolUse("cut", ("cut on {1} with {0}", "chop on {1} with {0}"), ("knife",), ("handle",), ("edge",), ("board",)),
    ToolUse("put", ("put {0} on {1}", "put {0} onto {1}"), ("knife", "spoon", "can", "mug", "spatula", "fork", "glass"), (), None,
        ("board", "plate")),
    ToolUse("wash", ("wash {1} with {0}", "clean {1} with {0}"), ("brush",), ("handle",), ("edge", "body", "handle"),
        ("plate", "bowl", "pan", "mug", "glass", "pot", "board")),
    ToolUse("hammer", ("hammer {1} with {0}",), ("hammer",), ("handle",), ("body",), ("wood",)),
    ToolUse("screw", ("screw into {1} with {0}",), ("screwdriver",), ("handle",), ("body",), ("wood",)),
    ToolUse("cut", ("cut {1} with {0}",), ("saw",), ("handle",), ("body",), ("wood",)),
)  # fmt: skip


def tasks_for(objects: Sequence[PlacedObject], names: dict[int, str]) -> Iterator[Task]:
    """Enumerate the tasks of a layout; `names` maps object numbers to nouns."""
    for obj in objects:
        yield from _common_tasks(obj, names[obj.number])
    for use in TOOL_USES:
        for obj in objects:
            if obj.model.kind in use.kinds:
                yield from _use_tasks(use, obj, objects, names)


def _common_tasks(obj: PlacedObject, name: str) -> Iterator[Task]:
    """Enumerate the tasks of every object: take, put, move and lift."""
    kind = obj.model.kind
    hold = HOLD.get(kind, ())
    for verb, text in (*TAKE, *PUT):
        yield Task(verb, text.format(name), (obj,), hold)
    wide = WIDE.get(kind)
    for verb, text in (*MOVE, *LIFT):
        if wide:
            yield Task(verb, text.format(name), (obj,), wide, OTHER_END.get(kind, wide), both_required=False, one_hand_parts=hold)
        else:
            yield Task(verb, text.format(name), (obj,), hold)


def _use_tasks(use: ToolUse, obj: PlacedObject, objects: Sequence[PlacedObject], names: dict[int, str]) -> Iterator[Task]:
    targets = [other for other in objects if other.model.kind in use.targets and other is not obj]
    parts = use.parts or HOLD.get(obj.model.kind, ())
    for text in use.texts:
        if not use.targets:
            yield Task(use.verb, text.format(names[obj.number]), (obj,), parts, use.support, use.both_required)
        for other in targets:
            words = text.format(names[obj.number], names[other.number])
            yield Task(use.verb, words, (obj, other), parts, use.support, use.both_required)
