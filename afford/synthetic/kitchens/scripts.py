"""Registry of scripts by name, with the scripts of workshop and desk and the hard ones.

A script adds objects, arm motions and narrations to a `SceneBuilder`. Hard scripts violate an assumption of the extraction and
list it in `Animation.hard`.
"""

from __future__ import annotations

from collections.abc import Callable
from itertools import pairwise

import numpy as np

from afford.render.motion import Pose, PoseAt, axis_angle, pose
from afford.synthetic.assets.object_model import Grip
from afford.synthetic.kitchens import scripts_kitchen
from afford.synthetic.kitchens.animation import DURATION, SceneObject
from afford.synthetic.kitchens.scene_builder import GripRequest, SceneBuilder
from afford.synthetic.kitchens.scripts_kitchen import GRASPABLE, carry_one
from afford.synthetic.kitchens.trajectories import aim_tool, carry, hover, roll_grip, set_down_pose

DESK_THINGS = ("book", "tape", "phone", "water", "cup", "stapler")
SHOP_THINGS = ("glue", "paint", "drill", "wood", "hammer", "screwdriver")


def hammer(scene: SceneBuilder) -> None:
    """Strike a block of wood with a hammer while the other hand holds the block."""
    wood, (hold,) = scene.add_object("wood", scene.position(-0.05, 0.06), GripRequest(scene.support))
    tool, (grip,) = scene.add_object("hammer", scene.position(0.19, -0.01), GripRequest(scene.lead, ("handle_wrap",)))
    grip = roll_grip(grip, -1.0 * scene.mirror, 0.0145)
    strike_at = wood.at(0)[:3, 3] + (0.02 * scene.mirror, 0.0, float(wood.model.size[2]))
    down = aim_tool(scene, tool, np.array([-0.35 * scene.mirror, 0.93, 0.0]), np.array([scene.mirror, 0.0, 0.0]), strike_at)
    _work(scene, wood, hold, tool, grip, down, strokes(down, np.array([1.0, 0.35 * scene.mirror, 0.0]), 0.55, 3), "hammer")


def screw(scene: SceneBuilder) -> None:
    """Turn a screwdriver in a block of wood while the other hand holds the block."""
    wood, (hold,) = scene.add_object("wood", scene.position(-0.06, 0.06), GripRequest(scene.support))
    tool, (grip,) = scene.add_object("screwdriver", scene.position(0.18, 0.0), GripRequest(scene.lead, ("handle", "handle_wrap")))
    into = wood.at(0)[:3, 3] + (0.035 * scene.mirror, -0.01, 0.6 * float(wood.model.size[2]))
    down = aim_tool(scene, tool, np.array([-0.85 * scene.mirror, 0.45, -0.25]), np.array([0.0, 0.3, 1.0]), into)
    _work(scene, wood, hold, tool, grip, down, twists(down, 0.5, 4), "screw")


def _work(
    scene: SceneBuilder, piece: SceneObject, hold: Grip, tool: SceneObject, grip: Grip, ready: Pose, act: PoseAt, verb: str
) -> None:
    take, drop = scene.time_near(22), scene.time_near(96)
    first, last = scene.time_near(42), scene.time_near(78)
    start = tool.at(0)
    scene.arm(scene.lead).grasp(tool, grip, scene.time_near(3), take, drop)
    scene.arm(scene.support).grasp(piece, hold, scene.time_near(9), scene.time_near(32), scene.time_near(87))
    tool.move(take + 2, first, ready, lift_m=0.10)
    tool.track.add(first, last, act)
    tool.move(last, drop - 2, set_down_pose(tool, start[:3, 3] + (0, 0.02, 0), 0.1, start), lift_m=0.10)
    scene.arm(scene.lead).retract(scene.time_near(115))
    scene.arm(scene.support).retract(scene.time_near(107))
    scene.animation.narrate(take - 8, take + 10, f"pick up {tool.name}", "pick-up", tool)
    scene.animation.narrate(first, last, f"{verb} {piece.name} with {tool.name}", verb, piece, tool)
    scene.animation.narrate(drop - 16, drop, f"put down {tool.name}", "put-down", tool)
    scene.follow_gaze(piece, take, drop)


def strokes(down: Pose, axis: np.ndarray, swing_rad: float, count: int) -> PoseAt:
    """Return a striking motion: the tool swings up about a sideways axis through its handle and comes down faster."""
    pivot = down[:3, 3] - 0.10 * down[:3, 1]

    def path(s: float) -> Pose:
        phase = (count * s) % 1.0 if s < 1 else 0.0
        up = np.sin(np.pi * phase**0.7) ** 2
        turn = axis_angle(axis, swing_rad * up)
        return pose(pivot + turn @ (down[:3, 3] - pivot) + (0, 0, 0.05 * up), turn @ down[:3, :3])

    return path


def twists(down: Pose, angle_rad: float, count: int) -> PoseAt:
    """Return an oscillating rotation about the tool's own axis."""

    def path(s: float) -> Pose:
        out = down.copy()
        out[:3, :3] = down[:3, :3] @ axis_angle((0, 1, 0), angle_rad * float(np.sin(2 * np.pi * count * s)))
        return out

    return path


def fetch_tool(scene: SceneBuilder) -> None:
    """Move a tool or a pot across the bench with one hand."""
    carry_one(scene, SHOP_THINGS, ())


def fetch_item(scene: SceneBuilder) -> None:
    """Move an object on the desk with one hand."""
    carry_one(scene, DESK_THINGS, ())


def tidy_desk(scene: SceneBuilder) -> None:
    """Move one object with each hand on the desk."""
    kinds = [str(k) for k in scene.rng.permutation(DESK_THINGS)[:2]]
    near, (first,) = scene.add_object(kinds[0], scene.position(0.18, 0.0), GripRequest(scene.lead))
    far, (second,) = scene.add_object(kinds[1], scene.position(-0.18, 0.04), GripRequest(scene.support))
    acts = ((scene.lead, near, first, 0, (0.10, 0.20)), (scene.support, far, second, 8, (-0.14, -0.05)))
    for side, obj, grip, shift, goal in acts:
        take, drop = scene.time_near(23 + shift), scene.time_near(87 + shift)
        scene.arm(side).grasp(obj, grip, scene.time_near(3 + shift), take, drop)
        scene.arm(side).retract(scene.time_near(108 + shift))
        carry(scene, obj, take + 2, drop - 2, set_down_pose(obj, scene.position(*goal), scene.rng.uniform(-0.4, 0.4)), lift_m=0.11)
        scene.animation.narrate(take - 6, drop, f"move {obj.name}", "move", obj)
    scene.follow_gaze(near, scene.time_near(24), scene.time_near(90))


FLAT_THINGS = {"kitchen": ("box", "carton", "plate"), "workshop": ("paint", "wood"), "desk": ("book", "phone")}
TAPPED = {"kitchen": GRASPABLE, "workshop": ("glue", "paint", "wood"), "desk": ("tape", "cup", "book")}
HINGED = {"kitchen": ("box",), "workshop": ("toolbox",), "desk": ("laptop", "book")}


def never_free(scene: SceneBuilder) -> None:
    """Hold an object from the first frame to the last, so that it is never unoccluded."""
    obj, (grip,) = scene.add_object(
        scene.choose(("mug", "bottle", "pan", "bowl", "can")), scene.position(0.10, 0.0), GripRequest(scene.lead)
    )
    scene.arm(scene.lead).hold_from_start(obj, grip, DURATION)
    start = obj.at(0)
    start[:3, 3] += (0.0, 0.0, 0.06)
    obj.track.rest = start
    stops = np.linspace(0, DURATION, 5)
    for first, last in pairwise(stops):
        target = set_down_pose(
            obj, scene.position(0.05, 0.04, 0.09) + (0, 0, scene.rng.uniform(0.03, 0.16)), scene.rng.uniform(-0.4, 0.4)
        )
        target[:3, :3] = axis_angle((1, 0, 0), scene.rng.uniform(-0.3, 0.3)) @ target[:3, :3]
        obj.move(first, last, target)
    scene.add_object("board", scene.position(-0.22, 0.16))
    scene.animation.narrate(2, DURATION - 2, f"hold {obj.name}", "hold", obj)
    scene.follow_gaze(obj, 16, DURATION - 10)
    scene.animation.hard = ("never_unoccluded",)


def turn_over(scene: SceneBuilder) -> None:
    """Pick up a flat or labelled object and rotate it out of the image plane."""
    kind = scene.choose(FLAT_THINGS[scene.setting])
    obj, (grip,) = scene.add_object(kind, scene.position(0.10, 0.0), GripRequest(scene.lead))
    take, drop = scene.time_near(24), scene.time_near(96)
    scene.arm(scene.lead).grasp(obj, grip, scene.time_near(4), take, drop)
    first = obj.at(0)
    up = scene.position(0.04, -0.02) + (0, 0, 0.17)
    shown = pose(up, axis_angle((0, 0, 1), 0.9 * scene.mirror) @ axis_angle((1, 0, 0), 0.35) @ first[:3, :3])
    tilt = axis_angle((0, 1, 0), 0.9 * scene.mirror) @ axis_angle((1, 0, 0), -0.5)
    tipped = pose(shown[:3, 3] + (0, 0.03, 0.0), tilt @ first[:3, :3])
    obj.move(take + 2, take + 24, shown, lift_m=0.03)
    obj.move(take + 24, take + 44, tipped)
    obj.track.add(take + 44, drop - 24, hover(scene, tipped, drop - 68 - take))
    obj.move(drop - 24, drop - 2, set_down_pose(obj, scene.position(0.06, 0.04), 0.0), lift_m=0.04)
    scene.arm(scene.lead).retract(scene.time_near(117))
    scene.animation.narrate(take, drop, f"turn {obj.name}", "turn", obj)
    scene.follow_gaze(obj, take, drop)
    scene.animation.hard = ("out_of_plane",)


def open_hinged(scene: SceneBuilder) -> None:
    """Hold a box, toolbox, laptop or book with one hand, and open and close its lid with the other."""
    kind = scene.choose(HINGED[scene.setting])
    obj, (hold, lift) = scene.add_hinged(kind, scene.position(0.0, 0.06))
    take, let = scene.time_near(28), scene.time_near(94)
    scene.arm(scene.support).grasp(obj, hold, scene.time_near(4), scene.time_near(22), scene.time_near(98))
    scene.arm(scene.lead).grasp(obj, lift, scene.time_near(8), take, let)
    joint = obj.model.joint
    wide = joint.low + scene.rng.uniform(0.32, 0.5) * (joint.high - joint.low) if joint else 0.0
    obj.open(take + 2, take + 26, wide)
    obj.open(let - 26, let - 3, 0.0)
    scene.arm(scene.lead).retract(scene.time_near(116))
    scene.arm(scene.support).retract(scene.time_near(117))
    scene.animation.narrate(take - 6, take + 28, f"open {obj.name}", "open", obj)
    scene.animation.narrate(let - 28, let, f"close {obj.name}", "close", obj)
    scene.follow_gaze(obj, take, let)
    scene.animation.hard = ("articulated",)


def dart(scene: SceneBuilder) -> None:
    """Carry an object with one hand while the other enters and leaves between two key frames to tap another object."""
    names = [str(k) for k in scene.rng.permutation(TAPPED[scene.setting])[:2]]
    obj, (grip,) = scene.add_object(names[0], scene.position(0.16, 0.02), GripRequest(scene.lead))
    target, (tap,) = scene.add_object(names[1], scene.position(-0.14, -0.08), GripRequest(scene.support))
    take, drop = scene.time_near(24), scene.time_near(94)
    scene.arm(scene.lead).grasp(obj, grip, scene.time_near(4), take, drop)
    carry(scene, obj, take + 2, drop - 2, set_down_pose(obj, scene.position(0.10, 0.18), 0.3), lift_m=0.12)
    scene.arm(scene.lead).retract(scene.time_near(116))
    for number in (2, 4):
        key = number * scene.key_gap
        scene.arm(scene.support).grasp(target, tap, key - 2.5, key + 0.48 * scene.key_gap, key + 0.58 * scene.key_gap)
        scene.arm(scene.support).retract(key + scene.key_gap + 2.5)
        scene.animation.narrate(key, key + scene.key_gap, f"tap {target.name}", "tap", target)
    scene.animation.narrate(take, drop, f"move {obj.name}", "move", obj)
    scene.follow_gaze(obj, take, drop)
    scene.animation.hard = ("enter_leave_between_keys",)


SCRIPTS: dict[str, Callable[[SceneBuilder], None]] = {
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


def script(name: str) -> Callable[[SceneBuilder], None]:
    """Return the script of a name. Raises ValueError with the known names."""
    if name not in SCRIPTS:
        raise ValueError(f"SceneSpec.script: unknown script {name!r}; choose one of {', '.join(sorted(SCRIPTS))}")
    return SCRIPTS[name]
