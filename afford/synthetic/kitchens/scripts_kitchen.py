"""Standard scripts of a kitchen. Each adds one animation to a `SceneBuilder`; times are in units of animation time."""

from __future__ import annotations

import numpy as np

from afford.render.motion import Pose, PoseAt, axis_angle, pose
from afford.synthetic.kitchens.scene_builder import GripRequest, SceneBuilder, lowest_z
from afford.synthetic.kitchens.trajectories import aim_tool, carry, hover, pouring_pose, roll_grip, set_down_pose, stirring_circle

GRASPABLE = ("mug", "bottle", "bowl", "kettle", "pan", "jar", "can")
ENDS = ("handle", "rim", "neck", "lid", "edge", "side", "tip", "cover")
"""Grips at one end of an object, where the convex hull of the visible part does not recover the hidden part."""


def carry_one(scene: SceneBuilder, kinds: tuple[str, ...] = GRASPABLE, words: tuple[str, ...] = ENDS) -> None:
    """Carry an object across the table with one hand, turn it a little and put it down."""
    obj, (grip,) = scene.add_object(scene.choose(kinds), scene.position(0.15, 0.0), GripRequest(scene.lead, words))
    scene.add_object(scene.choose([k for k in kinds if k != obj.model.kind]), scene.position(-0.20, 0.22))
    take, drop = scene.time_near(24), scene.time_near(94)
    scene.arm(scene.lead).grasp(obj, grip, scene.time_near(4), take, drop)
    turn = scene.mirror * scene.rng.uniform(0.1, 0.6)
    carry(
        scene, obj, take + 2, drop - 2, set_down_pose(obj, scene.position(-0.08, -0.02), turn), lift_m=scene.rng.uniform(0.10, 0.16)
    )
    scene.arm(scene.lead).retract(scene.time_near(116))
    scene.animation.narrate(take - 8, take + 14, f"pick up {obj.name}", "pick-up", obj)
    scene.animation.narrate(drop - 24, drop + 2, f"put down {obj.name}", "put-down", obj)
    scene.follow_gaze(obj, take, drop)


def carry_far(scene: SceneBuilder) -> None:
    """Carry an object that is held at one end, with strong camera parallax."""
    carry_one(scene, ("kettle", "pan", "can", "jar", "bottle"))


def carry_both(scene: SceneBuilder) -> None:
    """Lift one wide object with both hands, carry it and put it down."""
    requests = (GripRequest("left", ("rim", "edge")), GripRequest("right", ("rim", "edge")))
    obj, grips = scene.add_object(scene.choose(("bowl", "plate")), scene.position(0.08, 0.04), *requests)
    take, drop = scene.time_near(26), scene.time_near(92)
    for request, grip in zip(requests, grips, strict=True):
        scene.arm(request.side).grasp(obj, grip, scene.time_near(4), take + scene.rng.uniform(-3, 0), drop)
        scene.arm(request.side).retract(scene.time_near(115))
    carry(scene, obj, take + 2, drop - 2, set_down_pose(obj, scene.position(-0.10, 0.02), 0.2 * scene.mirror), lift_m=0.13)
    scene.animation.narrate(take - 6, take + 20, f"lift {obj.name}", "lift", obj)
    scene.animation.narrate(drop - 22, drop, f"put {obj.name}", "put", obj)
    scene.follow_gaze(obj, take, drop)


def carry_two(scene: SceneBuilder) -> None:
    """Move one object with each hand at the same time."""
    kinds = [str(k) for k in scene.rng.permutation(GRASPABLE)[:2]]
    words = ("body", "neck", "handle", "rim")
    near, (first,) = scene.add_object(kinds[0], scene.position(0.18, -0.02), GripRequest(scene.lead, words))
    far, (second,) = scene.add_object(kinds[1], scene.position(-0.20, 0.06), GripRequest(scene.support, words))
    acts = ((scene.lead, near, first, 0, (0.10, 0.20)), (scene.support, far, second, 9, (-0.16, -0.06)))
    for side, obj, grip, shift, place in acts:
        take, drop = scene.time_near(22 + shift), scene.time_near(86 + shift)
        scene.arm(side).grasp(obj, grip, scene.time_near(3 + shift), take, drop)
        scene.arm(side).retract(scene.time_near(107 + shift))
        carry(scene, obj, take + 2, drop - 2, set_down_pose(obj, scene.position(*place), scene.rng.uniform(-0.3, 0.3)), lift_m=0.12)
        scene.animation.narrate(take - 6, drop, f"move {obj.name}", "move", obj)
    scene.follow_gaze(near, scene.time_near(24), scene.time_near(90))


def pour(scene: SceneBuilder) -> None:
    """Pour from a vessel into another one that the other hand holds."""
    kind = scene.choose(("bottle", "kettle", "carton", "jar"))
    vessel, (grip,) = scene.add_object(kind, scene.position(0.17, 0.02), GripRequest(scene.lead, ("body", "handle")))
    cup, (hold,) = scene.add_object(
        scene.choose(("mug", "bowl")), scene.position(-0.12, 0.02), GripRequest(scene.support, ("body", "handle", "rim"))
    )
    take, drop = scene.time_near(22), scene.time_near(95)
    start, stop = scene.time_near(44), scene.time_near(74)
    scene.arm(scene.lead).grasp(vessel, grip, scene.time_near(3), take, drop)
    scene.arm(scene.support).grasp(cup, hold, scene.time_near(8), scene.time_near(28), scene.time_near(90))
    home = vessel.at(0)
    ready, poured = pouring_pose(scene, vessel, cup, 0.55), pouring_pose(scene, vessel, cup, scene.rng.uniform(1.25, 1.6))
    vessel.move(take + 2, start, ready, lift_m=0.04)
    vessel.move(start, start + 12, poured)
    vessel.track.add(start + 12, stop, hover(scene, poured, stop - start - 12))
    vessel.move(
        stop, drop - 2, set_down_pose(vessel, home[:3, 3] + scene.rng.uniform(-0.04, 0.04, 3) * (1, 1, 0), 0.0), lift_m=0.06
    )
    scene.arm(scene.lead).retract(scene.time_near(116))
    scene.arm(scene.support).retract(scene.time_near(112))
    scene.animation.narrate(take - 8, take + 12, f"pick up {vessel.name}", "pick-up", vessel)
    scene.animation.narrate(start - 4, stop + 2, f"pour from {vessel.name} into {cup.name}", "pour", vessel, cup)
    scene.animation.narrate(drop - 16, drop + 2, f"put down {vessel.name}", "put-down", vessel)
    scene.follow_gaze(cup, take, drop)


def open_jar(scene: SceneBuilder) -> None:
    """Hold a jar with one hand, and unscrew, lift off and put down its lid with the other."""
    jar, lid, (hold, twist) = scene.add_jar(scene.position(-0.02, 0.0))
    take, off, drop = scene.time_near(28), scene.time_near(62), scene.time_near(90)
    scene.arm(scene.support).grasp(jar, hold, scene.time_near(3), scene.time_near(22), scene.time_near(94))
    lead = scene.arm(scene.lead)
    lead.grasp(lid, twist, scene.time_near(8), take, drop)
    base = jar.at(0)
    lifted = set_down_pose(jar, base[:3, 3] + (0.03 * scene.mirror, -0.04, 0.07), 0.0)
    jar.move(take, take + 14, lifted)
    jar.move(scene.time_near(72), scene.time_near(88), base)
    screw = [scene.mirror * turn for turn in (-0.5, 0.35, -0.45, 0.0)]
    times = np.linspace(take + 2, off, len(screw) + 1)
    swing = np.array([0.0, *screw])
    lid.track.add(
        take,
        off,
        lambda s: (
            jar.at(take + s * (off - take))
            @ pose((0, 0, 0), axis_angle((0, 0, 1), float(np.interp(take + s * (off - take), times, swing))))
        ),
    )
    lid.move(off, drop - 1, set_down_pose(lid, scene.position(0.20, -0.02) - (0, 0, lowest_z(lid.model)), 0.3), lift_m=0.06)
    lead.retract(scene.time_near(114))
    scene.arm(scene.support).retract(scene.time_near(115))
    scene.animation.narrate(take - 4, off + 6, f"open {jar.name}", "open", jar)
    scene.animation.narrate(off, drop + 2, f"put down {lid.name}", "put-down", lid)
    scene.follow_gaze(jar, take, drop)
    scene.animation.hard = ("articulated",)


def cut(scene: SceneBuilder) -> None:
    """Chop with a knife on a board that the other hand holds in place."""
    board, (press,) = scene.add_object("board", scene.position(-0.06, 0.04), GripRequest(scene.support))
    knife, (grip,) = scene.add_object("knife", scene.position(0.19, -0.01), GripRequest(scene.lead, ("pinch",)))
    grip = roll_grip(grip, -0.65 * scene.mirror, 0.0096)
    take, drop = scene.time_near(22), scene.time_near(96)
    first, last = scene.time_near(42), scene.time_near(78)
    scene.arm(scene.lead).grasp(knife, grip, scene.time_near(3), take, drop)
    scene.arm(scene.support).grasp(board, press, scene.time_near(10), scene.time_near(32), scene.time_near(86))
    start = knife.at(0)
    blade = aim_tool(
        scene,
        knife,
        np.array([-0.35 * scene.mirror, 0.9, -0.2]),
        np.array([0.94 * scene.mirror, 0.2, 0.34]),
        board.at(0)[:3, 3] + (0.03 * scene.mirror, 0.03, float(board.model.size[2]) + 0.004),
    )
    knife.move(take + 2, first, blade, lift_m=0.06)
    knife.track.add(first, last, chop(scene, blade, strokes=4))
    knife.move(last, drop - 2, set_down_pose(knife, start[:3, 3] + (0, 0.02, 0), -0.1, start), lift_m=0.07)
    scene.arm(scene.lead).retract(scene.time_near(115))
    scene.arm(scene.support).retract(scene.time_near(106))
    scene.animation.narrate(take - 8, take + 12, f"pick up {knife.name}", "pick-up", knife)
    scene.animation.narrate(first, last, f"chop on {board.name} with {knife.name}", "chop", board, knife)
    scene.animation.narrate(drop - 16, drop, f"put down {knife.name}", "put-down", knife)
    scene.follow_gaze(board, take, drop)


def chop(scene: SceneBuilder, down: Pose, strokes: int) -> PoseAt:
    """Return a chopping motion: short strokes that raise the blade and move along the board."""
    side = scene.mirror

    def at(s: float) -> Pose:
        out = down.copy()
        lift = 0.5 - 0.5 * np.cos(2 * np.pi * strokes * s)
        out[:3, :3] = axis_angle((1, 0, 0), 0.22 * lift) @ down[:3, :3]
        out[:3, 3] += (-side * 0.06 * s, 0.0, 0.035 * lift)
        return out

    return at


def stir(scene: SceneBuilder) -> None:
    """Stir with a spoon or spatula in a vessel that the other hand holds."""
    kind = scene.choose(("bowl", "pan", "mug"))
    vessel, (hold,) = scene.add_object(kind, scene.position(-0.06, 0.04), GripRequest(scene.support, ("rim", "handle", "body")))
    spoon, (grip,) = scene.add_object(scene.choose(("spoon", "spatula")), scene.position(0.19, 0.0), GripRequest(scene.lead))
    take, drop = scene.time_near(22), scene.time_near(96)
    first, last = scene.time_near(42), scene.time_near(78)
    scene.arm(scene.lead).grasp(spoon, grip, scene.time_near(3), take, drop)
    scene.arm(scene.support).grasp(vessel, hold, scene.time_near(10), scene.time_near(32), scene.time_near(88))
    start = spoon.at(0)
    mouth = vessel.at(0) @ np.array([*(vessel.model.opening or (0, 0, 0.05)), 1.0])
    dip = aim_tool(scene, spoon, np.array([-0.45 * scene.mirror, 0.6, -0.65]), np.array([0.0, 1.0, 0.3]), mouth[:3] - (0, 0, 0.02))
    spoon.move(take + 2, first, dip, lift_m=0.10)
    spoon.track.add(first, last, stirring_circle(dip, radius_m=0.022, turns=2.5 * scene.mirror))
    spoon.move(last, drop - 2, set_down_pose(spoon, start[:3, 3], 0.1, start), lift_m=0.12)
    scene.arm(scene.lead).retract(scene.time_near(115))
    scene.arm(scene.support).retract(scene.time_near(108))
    scene.animation.narrate(take - 8, take + 10, f"pick up {spoon.name}", "pick-up", spoon)
    scene.animation.narrate(first - 2, last + 2, f"stir {vessel.name} with {spoon.name}", "stir", vessel, spoon)
    scene.animation.narrate(drop - 16, drop, f"put down {spoon.name}", "put-down", spoon)
    scene.follow_gaze(vessel, take, drop)


def hand_over(scene: SceneBuilder) -> None:
    """Pass an object from one hand to the other, which puts it down."""
    requests = (GripRequest(scene.lead), GripRequest(scene.support))
    obj, (give, get) = scene.add_object(scene.choose(("mug", "bottle", "bowl", "plate")), scene.position(0.17, 0.0), *requests)
    take, swap, drop = scene.time_near(22), scene.time_near(56), scene.time_near(94)
    scene.arm(scene.lead).grasp(obj, give, scene.time_near(3), take, swap + 6)
    scene.arm(scene.support).grasp(obj, get, swap - 22, swap, drop)
    middle = set_down_pose(obj, scene.position(0.0, -0.04) + (0, 0, 0.12), 0.0)
    obj.move(take + 2, swap - 1, middle, lift_m=0.03)
    obj.move(swap + 7, drop - 2, set_down_pose(obj, scene.position(-0.22, 0.06), 0.2 * scene.mirror), lift_m=0.03)
    scene.arm(scene.lead).retract(swap + 30)
    scene.arm(scene.support).retract(scene.time_near(116))
    scene.animation.narrate(take - 8, take + 10, f"pick up {obj.name}", "pick-up", obj)
    scene.animation.narrate(swap - 12, swap + 10, f"pass {obj.name} to other hand", "pass", obj)
    scene.animation.narrate(drop - 18, drop, f"put down {obj.name}", "put-down", obj)
    scene.follow_gaze(obj, take, drop)
