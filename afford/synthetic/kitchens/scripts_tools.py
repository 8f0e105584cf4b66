"""Standard choreographies of a workshop and of a desk."""

from __future__ import annotations

import numpy as np

from afford.render.motion import Pose, PoseAt, about, pose
from afford.synthetic.kitchens.cast import Cast, Want
from afford.synthetic.kitchens.moves import aim, carry, put, rolled
from afford.synthetic.kitchens.play import Thing
from afford.synthetic.kitchens.scripts_kitchen import carry_one
from afford.synthetic.things.asset import Grip

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
