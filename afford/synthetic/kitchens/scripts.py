"""Every choreography by name."""

from __future__ import annotations

from collections.abc import Callable
from itertools import pairwise

import numpy as np

from afford.render.motion import Pose, PoseAt, about, pose
from afford.synthetic.assets.object_model import Grip
from afford.synthetic.kitchens import scripts_kitchen
from afford.synthetic.kitchens.animation import LENGTH, Thing
from afford.synthetic.kitchens.scene_builder import Cast, Want
from afford.synthetic.kitchens.scripts_kitchen import GRASPABLE, carry_one
from afford.synthetic.kitchens.trajectories import aim, carry, held_at, put, rolled

DESK_THINGS = ("book", "tape", "phone", "water", "cup", "stapler")
SHOP_THINGS = ("glue", "paint", "drill", "wood", "hammer", "screwdriver")


def hammer(cast: Cast) -> None:
    """A hammer strikes a block of wood that the other hand holds."""
    wood, (hold,) = cast.thing("wood", cast.spot(-0.05, 0.06), Want(cast.support))
    tool, (grip,) = cast.thing("hammer", cast.spot(0.19, -0.01), Want(cast.lead, ("handle_wrap",)))
    grip = rolled(grip, -1.0 * cast.mirror, 0.0145)
    strike_at = wood.at(0)[:3, 3] + (0.02 * cast.mirror, 0.0, float(wood.model.size[2]))
    down = aim(cast, tool, np.array([-0.35 * cast.mirror, 0.93, 0.0]), np.array([cast.mirror, 0.0, 0.0]), strike_at)
    _work(cast, wood, hold, tool, grip, down, strokes(down, np.array([1.0, 0.35 * cast.mirror, 0.0]), 0.55, 3), "hammer")


def screw(cast: Cast) -> None:
    """A screwdriver turns in a block of wood that the other hand holds."""
    wood, (hold,) = cast.thing("wood", cast.spot(-0.06, 0.06), Want(cast.support))
    tool, (grip,) = cast.thing("screwdriver", cast.spot(0.18, 0.0), Want(cast.lead, ("handle", "handle_wrap")))
    into = wood.at(0)[:3, 3] + (0.035 * cast.mirror, -0.01, 0.6 * float(wood.model.size[2]))
    down = aim(cast, tool, np.array([-0.85 * cast.mirror, 0.45, -0.25]), np.array([0.0, 0.3, 1.0]), into)
    _work(cast, wood, hold, tool, grip, down, twists(down, 0.5, 4), "screw")


def _work(cast: Cast, piece: Thing, hold: Grip, tool: Thing, grip: Grip, ready: Pose, act: PoseAt, verb: str) -> None:
    take, drop = cast.beat(22), cast.beat(96)
    first, last = cast.beat(42), cast.beat(78)
    start = tool.at(0)
    cast.arm(cast.lead).take(tool, grip, cast.beat(3), take, drop)
    cast.arm(cast.support).take(piece, hold, cast.beat(9), cast.beat(32), cast.beat(87))
    tool.move(take + 2, first, ready, lift_m=0.10)
    tool.track.add(first, last, act)
    tool.move(last, drop - 2, put(tool, start[:3, 3] + (0, 0.02, 0), 0.1, start), lift_m=0.10)
    cast.arm(cast.lead).withdraw(cast.beat(115))
    cast.arm(cast.support).withdraw(cast.beat(107))
    cast.play.say(take - 8, take + 10, f"pick up {tool.name}", "pick-up", tool)
    cast.play.say(first, last, f"{verb} {piece.name} with {tool.name}", verb, piece, tool)
    cast.play.say(drop - 16, drop, f"put down {tool.name}", "put-down", tool)
    cast.watch(piece, take, drop)


def strokes(down: Pose, axis: np.ndarray, swing_rad: float, count: int) -> PoseAt:
    """Strikes: the tool swings up about a sideways axis through its handle and comes down faster."""
    pivot = down[:3, 3] - 0.10 * down[:3, 1]

    def path(s: float) -> Pose:
        phase = (count * s) % 1.0 if s < 1 else 0.0
        up = np.sin(np.pi * phase**0.7) ** 2
        turn = about(axis, swing_rad * up)
        return pose(pivot + turn @ (down[:3, 3] - pivot) + (0, 0, 0.05 * up), turn @ down[:3, :3])

    return path


def twists(down: Pose, angle_rad: float, count: int) -> PoseAt:
    """Turning to and fro about the tool's own axis."""

    def path(s: float) -> Pose:
        out = down.copy()
        out[:3, :3] = down[:3, :3] @ about((0, 1, 0), angle_rad * float(np.sin(2 * np.pi * count * s)))
        return out

    return path


def fetch_tool(cast: Cast) -> None:
    """One hand moves a tool or a pot across the bench."""
    carry_one(cast, SHOP_THINGS, ())


def fetch_item(cast: Cast) -> None:
    """One hand moves something on the desk."""
    carry_one(cast, DESK_THINGS, ())


def tidy_desk(cast: Cast) -> None:
    """Each hand moves its own thing on the desk."""
    kinds = [str(k) for k in cast.rng.permutation(DESK_THINGS)[:2]]
    near, (first,) = cast.thing(kinds[0], cast.spot(0.18, 0.0), Want(cast.lead))
    far, (second,) = cast.thing(kinds[1], cast.spot(-0.18, 0.04), Want(cast.support))
    acts = ((cast.lead, near, first, 0, (0.10, 0.20)), (cast.support, far, second, 8, (-0.14, -0.05)))
    for side, thing, grip, shift, goal in acts:
        take, drop = cast.beat(23 + shift), cast.beat(87 + shift)
        cast.arm(side).take(thing, grip, cast.beat(3 + shift), take, drop)
        cast.arm(side).withdraw(cast.beat(108 + shift))
        carry(cast, thing, take + 2, drop - 2, put(thing, cast.spot(*goal), cast.rng.uniform(-0.4, 0.4)), lift_m=0.11)
        cast.play.say(take - 6, drop, f"move {thing.name}", "move", thing)
    cast.watch(near, cast.beat(24), cast.beat(90))


FLAT_THINGS = {"kitchen": ("box", "carton", "plate"), "workshop": ("paint", "wood"), "desk": ("book", "phone")}
TAPPED = {"kitchen": GRASPABLE, "workshop": ("glue", "paint", "wood"), "desk": ("tape", "cup", "book")}
HINGED = {"kitchen": ("box",), "workshop": ("toolbox",), "desk": ("laptop", "book")}


def never_free(cast: Cast) -> None:
    """A thing is in the hand from the first frame to the last."""
    thing, (grip,) = cast.thing(cast.pick(("mug", "bottle", "pan", "bowl", "can")), cast.spot(0.10, 0.0), Want(cast.lead))
    cast.arm(cast.lead).start_holding(thing, grip, LENGTH)
    start = thing.at(0)
    start[:3, 3] += (0.0, 0.0, 0.06)
    thing.track.rest = start
    stops = np.linspace(0, LENGTH, 5)
    for first, last in pairwise(stops):
        target = put(thing, cast.spot(0.05, 0.04, 0.09) + (0, 0, cast.rng.uniform(0.03, 0.16)), cast.rng.uniform(-0.4, 0.4))
        target[:3, :3] = about((1, 0, 0), cast.rng.uniform(-0.3, 0.3)) @ target[:3, :3]
        thing.move(first, last, target)
    cast.thing("board", cast.spot(-0.22, 0.16))
    cast.play.say(2, LENGTH - 2, f"hold {thing.name}", "hold", thing)
    cast.watch(thing, 16, LENGTH - 10)
    cast.play.hard = ("never_unoccluded",)


def turn_over(cast: Cast) -> None:
    """A flat or labelled thing is taken up and turned so that other sides of it show."""
    kind = cast.pick(FLAT_THINGS[cast.setting])
    thing, (grip,) = cast.thing(kind, cast.spot(0.10, 0.0), Want(cast.lead))
    take, drop = cast.beat(24), cast.beat(96)
    cast.arm(cast.lead).take(thing, grip, cast.beat(4), take, drop)
    first = thing.at(0)
    up = cast.spot(0.04, -0.02) + (0, 0, 0.17)
    shown = pose(up, about((0, 0, 1), 0.9 * cast.mirror) @ about((1, 0, 0), 0.35) @ first[:3, :3])
    tipped = pose(shown[:3, 3] + (0, 0.03, 0.0), about((0, 1, 0), 0.9 * cast.mirror) @ about((1, 0, 0), -0.5) @ first[:3, :3])
    thing.move(take + 2, take + 24, shown, lift_m=0.03)
    thing.move(take + 24, take + 44, tipped)
    thing.track.add(take + 44, drop - 24, held_at(cast, tipped, drop - 68 - take))
    thing.move(drop - 24, drop - 2, put(thing, cast.spot(0.06, 0.04), 0.0), lift_m=0.04)
    cast.arm(cast.lead).withdraw(cast.beat(117))
    cast.play.say(take, drop, f"turn {thing.name}", "turn", thing)
    cast.watch(thing, take, drop)
    cast.play.hard = ("out_of_plane",)


def open_hinged(cast: Cast) -> None:
    """One hand holds a box, a toolbox or a book, the other swings its lid open and shut."""
    kind = cast.pick(HINGED[cast.setting])
    thing, (hold, lift) = cast.hinged(kind, cast.spot(0.0, 0.06))
    take, let = cast.beat(28), cast.beat(94)
    cast.arm(cast.support).take(thing, hold, cast.beat(4), cast.beat(22), cast.beat(98))
    cast.arm(cast.lead).take(thing, lift, cast.beat(8), take, let)
    joint = thing.model.joint
    wide = joint.low + cast.rng.uniform(0.32, 0.5) * (joint.high - joint.low) if joint else 0.0
    thing.open(take + 2, take + 26, wide)
    thing.open(let - 26, let - 3, 0.0)
    cast.arm(cast.lead).withdraw(cast.beat(116))
    cast.arm(cast.support).withdraw(cast.beat(117))
    cast.play.say(take - 6, take + 28, f"open {thing.name}", "open", thing)
    cast.play.say(let - 28, let, f"close {thing.name}", "close", thing)
    cast.watch(thing, take, let)
    cast.play.hard = ("articulated",)


def dart(cast: Cast) -> None:
    """While one hand carries a thing, the other darts in and out between two key frames to tap another."""
    names = [str(k) for k in cast.rng.permutation(TAPPED[cast.setting])[:2]]
    thing, (grip,) = cast.thing(names[0], cast.spot(0.16, 0.02), Want(cast.lead))
    target, (tap,) = cast.thing(names[1], cast.spot(-0.14, -0.08), Want(cast.support))
    take, drop = cast.beat(24), cast.beat(94)
    cast.arm(cast.lead).take(thing, grip, cast.beat(4), take, drop)
    carry(cast, thing, take + 2, drop - 2, put(thing, cast.spot(0.10, 0.18), 0.3), lift_m=0.12)
    cast.arm(cast.lead).withdraw(cast.beat(116))
    for number in (2, 4):
        key = number * cast.key_gap
        cast.arm(cast.support).take(target, tap, key - 2.5, key + 0.48 * cast.key_gap, key + 0.58 * cast.key_gap)
        cast.arm(cast.support).withdraw(key + cast.key_gap + 2.5)
        cast.play.say(key, key + cast.key_gap, f"tap {target.name}", "tap", target)
    cast.play.say(take, drop, f"move {thing.name}", "move", thing)
    cast.watch(thing, take, drop)
    cast.play.hard = ("enter_leave_between_keys",)


SCRIPTS: dict[str, Callable[[Cast], None]] = {
    "carry": scripts_kitchen.carry_one,
    "carry_both": scripts_kitchen.carry_both,
    "carry_two": scripts_kitchen.carry_two,
    "parallax": scripts_kitchen.carry_far,
    "pour": scripts_kitchen.pour,
    "open_jar": scripts_kitchen.open_jar,
    "cut": scripts_kitchen.cut,
    "stir": scripts_kitchen.stir,
    "hand_over": scripts_kitchen.hand_over,
    "hammer": hammer,
    "screw": screw,
    "fetch_tool": fetch_tool,
    "fetch_item": fetch_item,
    "tidy_desk": tidy_desk,
    "never_free": never_free,
    "turn_over": turn_over,
    "open_hinged": open_hinged,
    "dart": dart,
}
STRONG_PARALLAX = ("parallax",)


def script(name: str) -> Callable[[Cast], None]:
    """The choreography of this name; ValueError lists the names."""
    if name not in SCRIPTS:
        raise ValueError(f"SceneSpec.script: unknown script {name!r}; choose one of {', '.join(sorted(SCRIPTS))}")
    return SCRIPTS[name]
