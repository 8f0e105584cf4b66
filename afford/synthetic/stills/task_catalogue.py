"""What can be asked of the things on a table: verb, sentence, and which parts of what the hands take. A literal catalogue."""

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
"""Parts by which a thing is taken up; kinds that are not named: any part."""
WIDE: dict[str, tuple[str, ...]] = {
    "bowl": ("edge",), "plate": ("edge",), "board": ("edge",), "box": ("side",), "toolbox": ("body",), "laptop": ("side",),
    "book": ("side",), "wood": ("body",), "pan": ("handle",), "pot": ("handle",),
}  # fmt: skip
"""Kinds that two hands carry where there is room on both sides, and where they take them."""
OTHER_END = {"pan": ("pan rim",)}
"""Where the second hand takes a thing that the first one has by its handle."""
TAKE = (("pick-up", "pick up {}"), ("take", "take {}"), ("take", "take the {}"), ("grab", "grab {}"))
PUT = (("put-down", "put down {}"), ("put", "put {} away"), ("place", "place {}"))
MOVE = (("move", "move {}"), ("move", "move {} aside"))
LIFT = (("lift", "lift {}"), ("carry", "carry {}"), ("hold", "hold {}"))


@dataclass(frozen=True)
class Task:
    """Something to do. `parts` of the first thing are taken by one hand; `support` are the parts that the other hand takes, of
    the second thing when there is one, else of the first. Without `must`, one hand does where two have no room, and then it
    takes `alone` (None: `parts`).
    """

    verb: str
    text: str
    things: tuple[Placed, ...]
    parts: tuple[str, ...]
    support: tuple[str, ...] | None = None
    must: bool = True
    alone: tuple[str, ...] | None = None

    @property
    def kinds(self) -> tuple[str, ...]:
        """Kinds of the things."""
        return tuple(thing.model.kind for thing in self.things)


@dataclass(frozen=True)
class ToolUse:
    """A row of the catalogue: `kinds` do it alone, or to one of `targets`. '{0}' is the thing, '{1}' the target."""

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


def tasks_for(things: Sequence[Placed], names: dict[int, str]) -> Iterator[Task]:
    """Everything that can be asked of the things of a layout; `names` says how a person calls each, by number."""
    for thing in things:
        yield from _alone(thing, names[thing.number])
    for use in USES:
        for thing in things:
            if thing.model.kind in use.kinds:
                yield from _used(use, thing, things, names)


def _alone(thing: Placed, name: str) -> Iterator[Task]:
    """Taking, putting, moving and lifting: what every thing is for."""
    kind = thing.model.kind
    hold = HOLD.get(kind, ())
    for verb, text in (*TAKE, *PUT):
        yield Task(verb, text.format(name), (thing,), hold)
    wide = WIDE.get(kind)
    for verb, text in (*MOVE, *LIFT):
        if wide:
            yield Task(verb, text.format(name), (thing,), wide, OTHER_END.get(kind, wide), must=False, alone=hold)
        else:
            yield Task(verb, text.format(name), (thing,), hold)


def _used(use: ToolUse, thing: Placed, things: Sequence[Placed], names: dict[int, str]) -> Iterator[Task]:
    targets = [other for other in things if other.model.kind in use.targets and other is not thing]
    parts = use.parts or HOLD.get(thing.model.kind, ())
    for text in use.texts:
        if not use.targets:
            yield Task(use.verb, text.format(names[thing.number]), (thing,), parts, use.support, use.must)
        for other in targets:
            words = text.format(names[thing.number], names[other.number])
            yield Task(use.verb, words, (thing, other), parts, use.support, use.must)
