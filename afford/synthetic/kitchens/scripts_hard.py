"""Choreographies that break what extraction leans on; each says so in `Play.hard`."""

from __future__ import annotations

from itertools import pairwise

import numpy as np

from afford.render.motion import about, pose
from afford.synthetic.kitchens.cast import Cast, Want
from afford.synthetic.kitchens.moves import carry, held_at, put
from afford.synthetic.kitchens.play import LENGTH
from afford.synthetic.kitchens.scripts_kitchen import GRASPABLE

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
