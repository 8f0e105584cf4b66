"""What can be asked of the objects on a table: verb, sentence, and which parts of what the hands take. A literal catalogue."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

from afford.synthetic.stills.table_layout import Placed

HOLD: dict[str, tuple[str, ...]] = {
    "mug": ("body", "handle", "rim"), "bottle": ("body", "neck"), "water": ("body",), "kettle": ("handle",),
    "pan": ("handle",), "jar": ("body",), "box": ("side",), "carton": ("body",), "can": ("body", "rim"), "toolbox": ("handle",),
    "glue": ("body",), "paint": ("body", "rim"), "stapler": ("body",), "book": ("edge",), "laptop": ("edge",),
    "cup": ("body", "rim"), "phone": ("edge", "side"), "screwdriver": ("handle",), "bowl": ("edge",), "plate": ("edge",),
    "tape": ("rim", "body"), "wood": ("body",), "drill": ("handle",),
    "glass": ("body", "rim"), "grinder": ("body",),
}  # fmt: skip
"""Parts by which a obj is taken up; kinds that are not named: any part."""
WIDE: dict[str, tuple[str, ...]] = {
    "bowl": ("edge",), "plate": ("edge",), "board": ("edge",), "box": ("side",), "toolbox": ("body",), "laptop": ("side",),
    "book": ("side",), "wood": ("body",), "pan": ("handle",), "pot": ("handle",),
}  # fmt: skip
"""Kinds that two hands carry where there is room on both sides, and where they take them."""
OTHER_END = {"pan": ("pan rim",)}
"""Where the second hand takes a obj that the first one has by its handle."""
TAKE = (("pick-up", "pick up {}"), ("take", "take {}"), ("take", "take the {}"), ("grab", "grab {}"))
PUT = (("put-down", "put down {}"), ("put", "put {} away"), ("place", "place {}"))
MOVE = (("move", "move {}"), ("move", "move {} aside"))
LIFT = (("lift", "lift {}"), ("carry", "carry {}"), ("hold", "hold {}"))


@dataclass(frozen=True)
class Task:
    """Something to do. `parts` of the first obj are taken by one hand; `support` are the parts that the other hand takes, of
    the second obj when there is one, else of the first. Without `must`, one hand does where two have no room, and then it
    takes `alone` (None: `parts`).
    """

    verb: str
    text: str
    objects: tuple[Placed, ...]
    parts: tuple[str, ...]
    support: tuple[str, ...] | None = None
    must: bool = True
    alone: tuple[str, ...] | None = None

    @property
    def kinds(self) -> tuple[str, ...]:
        """Kinds of the objects."""
        return tuple(obj.model.kind for obj in self.objects)


@dataclass(frozen=True)
class ToolUse:
    """A row of the catalogue: `kinds` do it alone, or to one of `targets`. '{0}' is the obj, '{1}' the target."""

    verb: str
    texts: tuple[str, ...]
    kinds: tuple[str, ...]
    parts: tuple[str, ...] = ()
    support: tuple[str, ...] | None = None
    targets: tuple[str, ...] = ()
    must: bool = True


POURED = ("bottle", "carton", "water", "jar", "can", "kettle", "jug")
USES = (
    ToolUse("shake", ("shake {0}",), ("bottle", "jar", "carton", "can", "water", "glue"), ("body",)),
    ToolUse("check", ("check {0}", "inspect {0}"), ("can", "jar", "carton", "phone", "book"), ("body", "edge")),
    ToolUse("open", ("open {0}", "open the {0}"), ("jar",), ("lid",), ("body",)),
    ToolUse("close", ("close {0}",), ("jar",), ("lid",), ("body",)),
    ToolUse("open", ("open {0}",), ("bottle",), ("neck",), ("body",)),
    ToolUse("open", ("open {0}",), ("water",), ("lid",), ("body",)),
    ToolUse("open", ("open {0}", "open the {0}"), ("box",), ("flap",), ("side",), must=False),
    ToolUse("close", ("close {0}",), ("box",), ("flap",), ("side",), must=False),
    ToolUse("open", ("open {0}",), ("kettle",), ("lid",), ("handle",), must=False),
    ToolUse("open", ("open {0}",), ("toolbox",), ("lid",)),
    ToolUse("open", ("open {0}",), ("book",), ("cover",)),
    ToolUse("open", ("open {0}",), ("laptop",), ("screen",)),
    ToolUse("open", ("open {0}",), ("glue",), ("tip",), ("body",)),
    ToolUse("press", ("press {0}", "push {0}"), ("stapler",), ("arm",)),
    ToolUse("tighten", ("tighten with {0}",), ("wrench",), ("handle",)),
    ToolUse("turn", ("turn {0}",), ("grinder",), ("head",), ("body",)),
    ToolUse("pour", ("pour from {0}",), POURED, ("body", "handle")),
    ToolUse("pour", ("pour from {0} into {1}", "pour {0} into {1}"), POURED, ("body", "handle"), ("body", "handle"),
        ("mug", "cup", "glass"), must=False),
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


def tasks_for(objects: Sequence[Placed], names: dict[int, str]) -> Iterator[Task]:
    """Everything that can be asked of the objects of a layout; `names` says how a person calls each, by number."""
    for obj in objects:
        yield from _alone(obj, names[obj.number])
    for use in USES:
        for obj in objects:
            if obj.model.kind in use.kinds:
                yield from _used(use, obj, objects, names)


def _alone(obj: Placed, name: str) -> Iterator[Task]:
    """Taking, putting, moving and lifting: what every obj is for."""
    kind = obj.model.kind
    hold = HOLD.get(kind, ())
    for verb, text in (*TAKE, *PUT):
        yield Task(verb, text.format(name), (obj,), hold)
    wide = WIDE.get(kind)
    for verb, text in (*MOVE, *LIFT):
        if wide:
            yield Task(verb, text.format(name), (obj,), wide, OTHER_END.get(kind, wide), must=False, alone=hold)
        else:
            yield Task(verb, text.format(name), (obj,), hold)


def _used(use: ToolUse, obj: Placed, objects: Sequence[Placed], names: dict[int, str]) -> Iterator[Task]:
    targets = [other for other in objects if other.model.kind in use.targets and other is not obj]
    parts = use.parts or HOLD.get(obj.model.kind, ())
    for text in use.texts:
        if not use.targets:
            yield Task(use.verb, text.format(names[obj.number]), (obj,), parts, use.support, use.must)
        for other in targets:
            words = text.format(names[obj.number], names[other.number])
            yield Task(use.verb, words, (obj, other), parts, use.support, use.must)
