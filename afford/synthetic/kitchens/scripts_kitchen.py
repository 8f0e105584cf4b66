"""Standard choreographies of a kitchen. Each takes a `Cast` and writes one play; times are units of `play.LENGTH`."""

from __future__ import annotations

import numpy as np

from afford.render.motion import Pose, PoseAt, about, pose
from afford.synthetic.kitchens.scene_builder import Cast, Want, floor_of
from afford.synthetic.kitchens.trajectories import aim, carry, circle, held_at, put, rolled, tilt_to_pour

GRASPABLE = ("mug", "bottle", "bowl", "kettle", "pan", "jar", "can")
ENDS = ("handle", "rim", "neck", "lid", "edge", "side", "tip", "cover")
"""Grips at one end of a thing, where no hull of what is left to see gives back what is hidden."""


def carry_one(cast: Cast, kinds: tuple[str, ...] = GRASPABLE, words: tuple[str, ...] = ENDS) -> None:
    """One hand takes a thing, carries it across the table, turns it a little and puts it down."""
    thing, (grip,) = cast.thing(cast.pick(kinds), cast.spot(0.15, 0.0), Want(cast.lead, words))
    cast.thing(cast.pick([k for k in kinds if k != thing.model.kind]), cast.spot(-0.20, 0.22))
    take, drop = cast.beat(24), cast.beat(94)
    cast.arm(cast.lead).take(thing, grip, cast.beat(4), take, drop)
    turn = cast.mirror * cast.rng.uniform(0.1, 0.6)
    carry(cast, thing, take + 2, drop - 2, put(thing, cast.spot(-0.08, -0.02), turn), lift_m=cast.rng.uniform(0.10, 0.16))
    cast.arm(cast.lead).withdraw(cast.beat(116))
    cast.play.say(take - 8, take + 14, f"pick up {thing.name}", "pick-up", thing)
    cast.play.say(drop - 24, drop + 2, f"put down {thing.name}", "put-down", thing)
    cast.watch(thing, take, drop)


def carry_far(cast: Cast) -> None:
    """As `carry_one`, with things that are held at one end."""
    carry_one(cast, ("kettle", "pan", "can", "jar", "bottle"))


def carry_both(cast: Cast) -> None:
    """Both hands lift one wide thing, carry it and put it down."""
    wants = (Want("left", ("rim", "edge")), Want("right", ("rim", "edge")))
    thing, grips = cast.thing(cast.pick(("bowl", "plate")), cast.spot(0.08, 0.04), *wants)
    take, drop = cast.beat(26), cast.beat(92)
    for want, grip in zip(wants, grips, strict=True):
        cast.arm(want.side).take(thing, grip, cast.beat(4), take + cast.rng.uniform(-3, 0), drop)
        cast.arm(want.side).withdraw(cast.beat(115))
    carry(cast, thing, take + 2, drop - 2, put(thing, cast.spot(-0.10, 0.02), 0.2 * cast.mirror), lift_m=0.13)
    cast.play.say(take - 6, take + 20, f"lift {thing.name}", "lift", thing)
    cast.play.say(drop - 22, drop, f"put {thing.name}", "put", thing)
    cast.watch(thing, take, drop)


def carry_two(cast: Cast) -> None:
    """Each hand moves its own thing at the same time."""
    kinds = [str(k) for k in cast.rng.permutation(GRASPABLE)[:2]]
    words = ("body", "neck", "handle", "rim")
    near, (first,) = cast.thing(kinds[0], cast.spot(0.18, -0.02), Want(cast.lead, words))
    far, (second,) = cast.thing(kinds[1], cast.spot(-0.20, 0.06), Want(cast.support, words))
    acts = ((cast.lead, near, first, 0, (0.10, 0.20)), (cast.support, far, second, 9, (-0.16, -0.06)))
    for side, thing, grip, shift, place in acts:
        take, drop = cast.beat(22 + shift), cast.beat(86 + shift)
        cast.arm(side).take(thing, grip, cast.beat(3 + shift), take, drop)
        cast.arm(side).withdraw(cast.beat(107 + shift))
        carry(cast, thing, take + 2, drop - 2, put(thing, cast.spot(*place), cast.rng.uniform(-0.3, 0.3)), lift_m=0.12)
        cast.play.say(take - 6, drop, f"move {thing.name}", "move", thing)
    cast.watch(near, cast.beat(24), cast.beat(90))


def pour(cast: Cast) -> None:
    """One hand pours from a vessel into another that the other hand holds."""
    kind = cast.pick(("bottle", "kettle", "carton", "jar"))
    vessel, (grip,) = cast.thing(kind, cast.spot(0.17, 0.02), Want(cast.lead, ("body", "handle")))
    cup, (hold,) = cast.thing(cast.pick(("mug", "bowl")), cast.spot(-0.12, 0.02), Want(cast.support, ("body", "handle", "rim")))
    take, drop = cast.beat(22), cast.beat(95)
    start, stop = cast.beat(44), cast.beat(74)
    cast.arm(cast.lead).take(vessel, grip, cast.beat(3), take, drop)
    cast.arm(cast.support).take(cup, hold, cast.beat(8), cast.beat(28), cast.beat(90))
    home = vessel.at(0)
    ready, poured = tilt_to_pour(cast, vessel, cup, 0.55), tilt_to_pour(cast, vessel, cup, cast.rng.uniform(1.25, 1.6))
    vessel.move(take + 2, start, ready, lift_m=0.04)
    vessel.move(start, start + 12, poured)
    vessel.track.add(start + 12, stop, held_at(cast, poured, stop - start - 12))
    vessel.move(stop, drop - 2, put(vessel, home[:3, 3] + cast.rng.uniform(-0.04, 0.04, 3) * (1, 1, 0), 0.0), lift_m=0.06)
    cast.arm(cast.lead).withdraw(cast.beat(116))
    cast.arm(cast.support).withdraw(cast.beat(112))
    cast.play.say(take - 8, take + 12, f"pick up {vessel.name}", "pick-up", vessel)
    cast.play.say(start - 4, stop + 2, f"pour from {vessel.name} into {cup.name}", "pour", vessel, cup)
    cast.play.say(drop - 16, drop + 2, f"put down {vessel.name}", "put-down", vessel)
    cast.watch(cup, take, drop)


def open_jar(cast: Cast) -> None:
    """One hand holds a jar, the other unscrews its lid, lifts it off and lays it down."""
    jar, lid, (hold, twist) = cast.jar(cast.spot(-0.02, 0.0))
    take, off, drop = cast.beat(28), cast.beat(62), cast.beat(90)
    cast.arm(cast.support).take(jar, hold, cast.beat(3), cast.beat(22), cast.beat(94))
    lead = cast.arm(cast.lead)
    lead.take(lid, twist, cast.beat(8), take, drop)
    base = jar.at(0)
    lifted = put(jar, base[:3, 3] + (0.03 * cast.mirror, -0.04, 0.07), 0.0)
    jar.move(take, take + 14, lifted)
    jar.move(cast.beat(72), cast.beat(88), base)
    screw = [cast.mirror * turn for turn in (-0.5, 0.35, -0.45, 0.0)]
    times = np.linspace(take + 2, off, len(screw) + 1)
    swing = np.array([0.0, *screw])
    lid.track.add(take, off, lambda s: jar.at(take + s * (off - take)) @ pose((0, 0, 0), about((0, 0, 1), float(
        np.interp(take + s * (off - take), times, swing)))))
    lid.move(off, drop - 1, put(lid, cast.spot(0.20, -0.02) - (0, 0, floor_of(lid.model)), 0.3), lift_m=0.06)
    lead.withdraw(cast.beat(114))
    cast.arm(cast.support).withdraw(cast.beat(115))
    cast.play.say(take - 4, off + 6, f"open {jar.name}", "open", jar)
    cast.play.say(off, drop + 2, f"put down {lid.name}", "put-down", lid)
    cast.watch(jar, take, drop)
    cast.play.hard = ("articulated",)


def cut(cast: Cast) -> None:
    """A knife chops on a board that the other hand keeps in place."""
    board, (press,) = cast.thing("board", cast.spot(-0.06, 0.04), Want(cast.support))
    knife, (grip,) = cast.thing("knife", cast.spot(0.19, -0.01), Want(cast.lead, ("pinch",)))
    grip = rolled(grip, -0.65 * cast.mirror, 0.0096)
    take, drop = cast.beat(22), cast.beat(96)
    first, last = cast.beat(42), cast.beat(78)
    cast.arm(cast.lead).take(knife, grip, cast.beat(3), take, drop)
    cast.arm(cast.support).take(board, press, cast.beat(10), cast.beat(32), cast.beat(86))
    start = knife.at(0)
    blade = aim(cast, knife, np.array([-0.35 * cast.mirror, 0.9, -0.2]), np.array([0.94 * cast.mirror, 0.2, 0.34]),
                board.at(0)[:3, 3] + (0.03 * cast.mirror, 0.03, float(board.model.size[2]) + 0.004))
    knife.move(take + 2, first, blade, lift_m=0.06)
    knife.track.add(first, last, chop(cast, blade, strokes=4))
    knife.move(last, drop - 2, put(knife, start[:3, 3] + (0, 0.02, 0), -0.1, start), lift_m=0.07)
    cast.arm(cast.lead).withdraw(cast.beat(115))
    cast.arm(cast.support).withdraw(cast.beat(106))
    cast.play.say(take - 8, take + 12, f"pick up {knife.name}", "pick-up", knife)
    cast.play.say(first, last, f"chop on {board.name} with {knife.name}", "chop", board, knife)
    cast.play.say(drop - 16, drop, f"put down {knife.name}", "put-down", knife)
    cast.watch(board, take, drop)


def chop(cast: Cast, down: Pose, strokes: int) -> PoseAt:
    """Short strokes that raise the blade and wander along the board."""
    side = cast.mirror

    def at(s: float) -> Pose:
        out = down.copy()
        lift = 0.5 - 0.5 * np.cos(2 * np.pi * strokes * s)
        out[:3, :3] = about((1, 0, 0), 0.22 * lift) @ down[:3, :3]
        out[:3, 3] += (-side * 0.06 * s, 0.0, 0.035 * lift)
        return out

    return at


def stir(cast: Cast) -> None:
    """A spoon or spatula stirs in a bowl or pan that the other hand holds."""
    kind = cast.pick(("bowl", "pan", "mug"))
    vessel, (hold,) = cast.thing(kind, cast.spot(-0.06, 0.04), Want(cast.support, ("rim", "handle", "body")))
    spoon, (grip,) = cast.thing(cast.pick(("spoon", "spatula")), cast.spot(0.19, 0.0), Want(cast.lead))
    take, drop = cast.beat(22), cast.beat(96)
    first, last = cast.beat(42), cast.beat(78)
    cast.arm(cast.lead).take(spoon, grip, cast.beat(3), take, drop)
    cast.arm(cast.support).take(vessel, hold, cast.beat(10), cast.beat(32), cast.beat(88))
    start = spoon.at(0)
    mouth = vessel.at(0) @ np.array([*(vessel.model.opening or (0, 0, 0.05)), 1.0])
    dip = aim(cast, spoon, np.array([-0.45 * cast.mirror, 0.6, -0.65]), np.array([0.0, 1.0, 0.3]), mouth[:3] - (0, 0, 0.02))
    spoon.move(take + 2, first, dip, lift_m=0.10)
    spoon.track.add(first, last, circle(dip, radius_m=0.022, turns=2.5 * cast.mirror))
    spoon.move(last, drop - 2, put(spoon, start[:3, 3], 0.1, start), lift_m=0.12)
    cast.arm(cast.lead).withdraw(cast.beat(115))
    cast.arm(cast.support).withdraw(cast.beat(108))
    cast.play.say(take - 8, take + 10, f"pick up {spoon.name}", "pick-up", spoon)
    cast.play.say(first - 2, last + 2, f"stir {vessel.name} with {spoon.name}", "stir", vessel, spoon)
    cast.play.say(drop - 16, drop, f"put down {spoon.name}", "put-down", spoon)
    cast.watch(vessel, take, drop)


def hand_over(cast: Cast) -> None:
    """One hand takes a thing and passes it to the other, which puts it down."""
    wants = (Want(cast.lead), Want(cast.support))
    thing, (give, get) = cast.thing(cast.pick(("mug", "bottle", "bowl", "plate")), cast.spot(0.17, 0.0), *wants)
    take, swap, drop = cast.beat(22), cast.beat(56), cast.beat(94)
    cast.arm(cast.lead).take(thing, give, cast.beat(3), take, swap + 6)
    cast.arm(cast.support).take(thing, get, swap - 22, swap, drop)
    middle = put(thing, cast.spot(0.0, -0.04) + (0, 0, 0.12), 0.0)
    thing.move(take + 2, swap - 1, middle, lift_m=0.03)
    thing.move(swap + 7, drop - 2, put(thing, cast.spot(-0.22, 0.06), 0.2 * cast.mirror), lift_m=0.03)
    cast.arm(cast.lead).withdraw(swap + 30)
    cast.arm(cast.support).withdraw(cast.beat(116))
    cast.play.say(take - 8, take + 10, f"pick up {thing.name}", "pick-up", thing)
    cast.play.say(swap - 12, swap + 10, f"pass {thing.name} to other hand", "pass", thing)
    cast.play.say(drop - 18, drop, f"put down {thing.name}", "put-down", thing)
    cast.watch(thing, take, drop)
