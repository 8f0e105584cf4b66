"""Measure structure, accuracy and simulation cost of the Shadow Hand; writes docs/grasping/hand.md.

    PYTHONPATH=. python benchmarks/bench_hand.py

The marked parts of that page are generated.
"""

from __future__ import annotations

import tempfile
import time
from pathlib import Path

import mujoco
import numpy as np
import pybullet

from afford.grasping.hand.assets import shadow_files
from afford.grasping.hand.export import save_hand
from afford.grasping.hand.kinematics import forward_kinematics, jacobian, joint_limits, moving_joints
from benchmarks.pages import ROOT, into
from schemas.hand import HandModel
from stages.grasping import hand_model

PAGE = ROOT / "docs" / "grasping" / "hand.md"
SETTLE, STEPS, REPEATS = 120, 600, 3
BENT = {"J0": 1.2, "J1": 1.2, "J2": 1.2}
THUMB = {"THJ4": 1.0, "THJ3": 0.8, "THJ0": -0.4}
ROD_RADIUS_M, ROD_M = 0.018, (0.0, -0.032, 0.105)


def main() -> None:
    """Measure, then write."""
    hand = hand_model.run(shadow_files(), hand_model.Params())
    into(PAGE, "joints", Path(__file__).name, joint_table(hand))
    into(PAGE, "exactness", Path(__file__).name, exactness(hand))
    with tempfile.TemporaryDirectory() as folder:
        into(PAGE, "cost", Path(__file__).name, costs(Path(folder)))
        into(PAGE, "overlaps", Path(__file__).name, overlaps(hand, Path(folder)))


def joint_table(hand: HandModel) -> str:
    """One row for each joint."""
    joints = hand.joints
    rows = ["| joint | role | parent -> child | axis | lower | upper | effort |", "|---|---|---|---|--:|--:|--:|"]
    for k, name in enumerate(joints.name):
        role = joints.role[k] if joints.driver[k] < 0 else f"= {joints.ratio[k]:g} x {joints.name[joints.driver[k]]}"
        axis = " ".join(f"{number:.3g}" for number in joints.axis[k])
        rows.append(f"| {name} | {role} | {hand.links[joints.parent[k]]} -> {hand.links[joints.child[k]]} | {axis} | "
                    f"{joints.lower[k]:.3f} | {joints.upper[k]:.3f} | {joints.effort[k]:g} |")
    return "\n".join(rows) + "\n"


def exactness(hand: HandModel) -> str:
    """Largest difference from MuJoCo over 1000 configurations, and how long kinematics takes."""
    robot = next(file.path for file in shadow_files().files if file.name == "hand/robot.xml")
    model = mujoco.MjModel.from_xml_path(str(robot.with_name("reach.xml")))
    low, high = joint_limits(hand.joints).T
    q = np.random.default_rng(0).uniform(low, high, (1000, len(low)))
    start = time.process_time()
    T = forward_kinematics(hand.joints, q)
    middle = time.process_time()
    jacobian(hand.joints, T, hand.fingers.tip_link, hand.fingers.tip_m)
    forward_us, jacobian_us = (1000 * (b - a) for a, b in ((start, middle), (middle, time.process_time())))
    T = np.linalg.inv(T[:, hand.palm])[:, None] @ T[:, hand.palm :]
    far = max(_difference(model, hand, row, found) for row, found in zip(q, T, strict=True))
    return (f"Places of all links against MuJoCo, 1000 random configurations: at most {far:.0e} m. A configuration takes "
            f"{forward_us:.0f} µs forward and {jacobian_us:.0f} µs for the Jacobian of five fingertips, in batches of 1000.\n")


def _difference(model: mujoco.MjModel, hand: HandModel, q: np.ndarray, T_palm: np.ndarray) -> float:
    data = mujoco.MjData(model)
    for k, value in zip(moving_joints(hand.joints), q, strict=True):
        if hand.joints.role[k] != "wrist":
            data.joint(f"robot0:{hand.joints.name[k]}").qpos = value
    mujoco.mj_kinematics(model, data)
    palm = data.body("robot0:palm")
    places = np.array([data.body(f"robot0:{link}").xpos for link in hand.links[hand.palm :]])
    return float(np.abs((places - palm.xpos) @ palm.xmat.reshape(3, 3) - T_palm[:, :3, 3]).max())


def costs(folder: Path) -> str:
    """Steps a CPU second while the hand closes on a fixed rod, the best of a few runs."""
    rows = ["| capsules | self-collision | shapes | 240 Hz steps / CPU s | contacts | of the hand with itself | deepest mm |",
            "|---|---|--:|--:|--:|--:|--:|"]  # fmt: skip
    for capsules in ("capsule", "parts"):
        hand = hand_model.run(shadow_files(), hand_model.Params(capsules=capsules))
        path = save_hand(hand, folder / capsules)
        for touching in ("none", "`contacts` only", "every pair"):
            found = [_close(hand, path, touching) for _ in range(REPEATS)]
            speed = max(run[0] for run in found)
            rows.append(f"| {capsules} | {touching} | {hand.urdf.count('<collision>')} | {round(speed, -2):.0f} | {found[0][1]} | "
                        f"{found[0][2]} | {found[0][3] * 1000:.1f} |")
    return "\n".join(rows) + "\n"


def _close(hand: HandModel, path: Path, touching: str) -> tuple[float, int, int, float]:
    """Steps a CPU second, contacts, contacts of the hand with itself, depth in metres."""
    client = pybullet.connect(pybullet.DIRECT)
    try:
        pybullet.setPhysicsEngineParameter(numSolverIterations=50, deterministicOverlappingPairs=1, physicsClientId=client)
        body = _load(hand, path, touching, client)
        rod = pybullet.createCollisionShape(pybullet.GEOM_CYLINDER, radius=ROD_RADIUS_M, height=0.2, physicsClientId=client)
        along_x = pybullet.getQuaternionFromEuler([0, np.pi / 2, 0])
        pybullet.createMultiBody(0, rod, basePosition=ROD_M, baseOrientation=along_x, physicsClientId=client)
        _motors(hand, body, client)
        for _ in range(SETTLE):
            pybullet.stepSimulation(client)
        start = time.process_time()
        for _ in range(STEPS):
            pybullet.stepSimulation(client)
        speed = STEPS / (time.process_time() - start)
        contacts = pybullet.getContactPoints(physicsClientId=client)
        return speed, len(contacts), sum(c[1] == c[2] for c in contacts), -min((c[8] for c in contacts), default=0.0)
    finally:
        pybullet.disconnect(client)


def overlaps(hand: HandModel, folder: Path) -> str:
    """Pairs of links that touch at q = 0 where the engine lets every pair touch, the deepest first."""
    client = pybullet.connect(pybullet.DIRECT)
    try:
        body = _load(hand, save_hand(hand, folder / "open"), "every pair", client)
        pybullet.performCollisionDetection(physicsClientId=client)
        deep = dict[tuple[str, ...], float]()
        for contact in pybullet.getContactPoints(body, body, physicsClientId=client):
            pair = tuple(pybullet.getJointInfo(body, link, client)[12].decode() for link in sorted(contact[3:5]))
            deep[pair] = max(deep.get(pair, 0.0), -contact[8])
        deepest = sorted(deep.items(), key=lambda one: -one[1])
        rows = [f"| {a} | {b} | {1000 * depth:.0f} |" for (a, b), depth in deepest if depth > 0]
        return "\n".join(["| link | link | deep, mm |", "|---|---|--:|", *rows]) + "\n"
    finally:
        pybullet.disconnect(client)


def _load(hand: HandModel, path: Path, touching: str, client: int) -> int:
    flags = pybullet.URDF_IGNORE_VISUAL_SHAPES | (0 if touching == "none" else pybullet.URDF_USE_SELF_COLLISION)
    body: int = pybullet.loadURDF(str(path), useFixedBase=True, flags=flags, physicsClientId=client)
    if touching.startswith("`contacts`"):
        at = {pybullet.getJointInfo(body, k, client)[12].decode(): k for k in range(pybullet.getNumJoints(body, client))}
        index = [at.get(link, -1) for link in hand.links]
        allowed = set(map(tuple, hand.contacts.tolist()))
        for b in range(len(index)):
            for a in range(b):
                pybullet.setCollisionFilterPair(body, body, index[a], index[b], int((a, b) in allowed), physicsClientId=client)
    return body


def _motors(hand: HandModel, body: int, client: int) -> None:
    at = {pybullet.getJointInfo(body, k, client)[1].decode(): k for k in range(pybullet.getNumJoints(body, client))}
    for name, effort in zip(hand.joints.name, hand.joints.effort, strict=True):
        target = THUMB.get(name, 0.0 if name.startswith(("TH", "wrist")) else BENT.get(name[2:], 0.0))
        pybullet.setJointMotorControl2(body, at[name], pybullet.POSITION_CONTROL, target, force=effort, positionGain=0.2,
                                       velocityGain=1.0, physicsClientId=client)


if __name__ == "__main__":
    main()
