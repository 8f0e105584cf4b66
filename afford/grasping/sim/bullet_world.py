"""A world in PyBullet, through afford.common.bullet.Client.

Motors are velocity constraints with a limited impulse and speed; a gear holds a coupled joint to its driver. The object is one
body, a compound of hulls; the part of a contact is that of the hull whose surface is nearest. A wrist that takes forces receives
them, less drag, at every solver step.
"""

from __future__ import annotations

import tempfile
import xml.etree.ElementTree as Xml
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import trimesh
from scipy.spatial import ConvexHull

from afford.common.bullet import Client
from afford.common.geometry import quaternion_inverse, quaternion_matrix, quaternion_product
from afford.grasping.hand.export import save_hand as save_hand
from afford.grasping.hand.kinematics import commanded_columns, commanded_joints, moving_joints
from afford.grasping.sim.engine import State, finite_vector, solver_steps
from afford.grasping.sim.scene import Physics, Scene, finger_of_link, hold_command, scene_limits
from schemas.grasp import GraspObject

GEAR_NM = 100.0
"""torque limit of a coupling, above that of any finger motor"""
GEAR_ERP = 0.5
EVERYTHING = (1, -1)
"""collision group and mask of bodies that move"""
TABLE_M = (2.0, 2.0, 0.05)


@dataclass(frozen=True, eq=False)
class Saved:
    """Saved state of a world."""

    number: int
    force: np.ndarray
    steps_left: int
    state: State
    efforts: np.ndarray | None
    """of a wrist that takes forces"""


class BulletWorld:
    """PyBullet world; see afford.grasping.sim.engine.World."""

    def __init__(self, scene: Scene, seen: bool = False) -> None:
        """`seen`: load the visual meshes of the hand, for rendering."""
        self.scene, self.client = scene, Client()
        hand, physics = scene.hand, scene.physics
        _settings(self.client, scene)
        with tempfile.TemporaryDirectory() as folder:
            self.table = _table(self.client, physics)
            self.object = _object(self.client, scene, Path(folder))
            self.hand = _hand(self.client, scene, Path(folder), seen)
        number = _numbers(self.client, self.hand)
        moves, motors = moving_joints(hand.joints), commanded_joints(hand.joints)
        self._joints, self._motors = ([number[hand.joints.name[k]] for k in some] for some in (moves, motors))
        self._seen = [number[hand.joints.name[k - 1]] for k in (*hand.fingers.tip_link.tolist(), hand.palm)]
        self._of_motor = commanded_columns(hand.joints)
        self._limits = scene_limits(scene)
        turns = np.array([hand.joints.role[k] != "wrist" for k in motors])
        self._efforts = (hand.joints.effort[motors] * np.where(turns, physics.effort_scale, 1.0)).tolist()
        self._speeds = hand.joints.velocity[motors].tolist()
        of_link = finger_of_link(hand)
        self._finger = {-1: int(of_link[0]), **{number[name]: int(of_link[k + 1]) for k, name in enumerate(hand.joints.name)}}
        self._planes = [ConvexHull(hull).equations for hull in scene.body.hulls()]
        self._inertial = np.array(self.client.getDynamicsInfo(self.object, -1)[4])
        self._wrench = _Wrench(self.client, scene, self.hand, self._motors[:6], self.object) if scene.wrist == "wrench" else None
        self._force, self._left = np.zeros(3), 0
        self._fresh = int(self.client.saveState())

    def reset(self, q: np.ndarray, body: np.ndarray) -> State:
        """Reset to rest, joints at q, motors holding them."""
        q, pose = finite_vector("reset, q", q, len(self._joints)), finite_vector("reset, body", body, 7)
        self._forget()
        self.client.restoreState(stateId=self._fresh)
        for joint, value in zip(self._joints, q.tolist(), strict=True):
            self.client.resetJointState(self.hand, joint, value, 0.0)
        centre = pose[:3] + quaternion_matrix(pose[3:]) @ self.scene.body.com_m
        turn = quaternion_product(pose[3:], self._inertial)
        self.client.resetBasePositionAndOrientation(self.object, centre.tolist(), turn.tolist())
        self.client.resetBaseVelocity(self.object, (0, 0, 0), (0, 0, 0))
        self._force, self._left = np.zeros(3), 0
        self._command(hold_command(self.scene, q))
        self.client.performCollisionDetection()
        return self.state()

    def step(self, u: np.ndarray, control_s: float) -> State:
        """Advance while the motors follow u, clipped to the limits of their joints."""
        u, count = finite_vector("step, u", u, len(self._motors)), solver_steps(control_s, self.scene.physics.rate_hz)
        self._command(u.clip(*self._limits.T))
        for _ in range(count):
            if self._left:
                self._shove()
            if self._wrench:
                self._wrench.apply()
            self.client.stepSimulation()
        return self.state()

    def push(self, force: np.ndarray, duration_s: float) -> None:
        """Apply a force to the object for a time."""
        self._force, self._left = finite_vector("push, force", force, 3), round(duration_s * self.scene.physics.rate_hz)

    def state(self) -> State:
        """Return the state; positions are current, forces are those of the last solver step."""
        hand, joints = self.scene.hand, self.client.getJointStates(self.hand, self._joints)
        q, qd, torque = (np.array([row[column] for row in joints]) for column in (0, 1, 3))
        links = [(np.array(row[4]), row[5]) for row in self.client.getLinkStates(self.hand, self._seen, computeForwardKinematics=1)]
        body = self._body()
        velocity, spin = self.client.getBaseVelocity(self.object)
        force, deepest, count = self._touching(body)
        torque = torque[self._of_motor]
        torque[:6] = torque[:6] if self._wrench is None else self._wrench.efforts
        return State(
            q=q, qd=qd, torque=torque, palm=np.concatenate(links[-1]), body=body,
            tips=np.array([place + quaternion_matrix(turn) @ tip
                           for (place, turn), tip in zip(links, hand.fingers.tip_m, strict=False)]),
            velocity=np.array(velocity), spin=np.array(spin), force=force, penetration_m=deepest, contacts=count)  # fmt: skip

    def save(self) -> Saved:
        """Save all that the next step depends on; the engine keeps it until the world is closed.

        The engine's cache of near shapes is not part of it, so the world drops that cache now, as `restore` does.
        """
        efforts = self._wrench.efforts if self._wrench else None
        token = Saved(int(self.client.saveState()), self._force, self._left, self.state(), efforts)
        self.restore(token)
        return token

    def restore(self, token: Saved) -> State:
        """Restore a saved state."""
        self._forget()
        self.client.restoreState(stateId=token.number)
        self.client.performCollisionDetection()
        self.client.restoreState(stateId=token.number)  # contact points are restored only where pairs exist
        self._force, self._left = token.force, token.steps_left
        if self._wrench and token.efforts is not None:
            self._wrench.efforts = token.efforts
        return token.state

    def close(self) -> None:
        """Disconnect."""
        self.client.close()

    def _forget(self) -> None:
        """Reset the broad phase: cached pairs of near shapes, and the axes from which the narrow phase starts, are dropped."""
        for link in range(self.client.getNumJoints(self.hand)):
            self.client.setCollisionFilterGroupMask(self.hand, link, *EVERYTHING)
        self.client.setCollisionFilterGroupMask(self.object, -1, *EVERYTHING)

    def _command(self, targets: np.ndarray) -> None:
        wrist = 0 if self._wrench is None else 6
        if self._wrench:
            self._wrench.efforts = targets[:6].copy()
        gain = 1.0 / (self.scene.physics.rate_hz * self.scene.physics.response_s)
        follow, mode = self.client.setJointMotorControl2, self.client.POSITION_CONTROL
        motors = list(zip(self._motors, targets.tolist(), self._efforts, self._speeds, strict=True))
        for joint, target, effort, speed in motors[wrist:]:
            follow(self.hand, joint, mode, target, force=effort, positionGain=gain, velocityGain=1.0, maxVelocity=speed)

    def _shove(self) -> None:
        centre = self.client.getBasePositionAndOrientation(self.object)[0]
        self.client.applyExternalForce(self.object, -1, self._force.tolist(), centre, self.client.WORLD_FRAME)
        self._left -= 1

    def _body(self) -> np.ndarray:
        """Return the (7,) pose of the object's frame; the engine stores that of the principal axes."""
        centre, turn = self.client.getBasePositionAndOrientation(self.object)
        own = quaternion_product(np.array(turn), quaternion_inverse(self._inertial))
        return np.concatenate([np.array(centre) - quaternion_matrix(own) @ self.scene.body.com_m, own])

    def _touching(self, body: np.ndarray) -> tuple[np.ndarray, float, int]:
        """Measure contacts of the hand with the object.

        (fingers + 1, parts) newtons, depth of the deepest contact, number of contacts.
        """
        force = np.zeros((len(self.scene.hand.fingers.name) + 1, len(self.scene.body.parts)))
        found = [c for c in self.client.getContactPoints(self.hand, self.object) if c[8] <= 0 or c[9] > 0]
        if not found:
            return force, 0.0, 0
        spots = (np.array([c[6] for c in found]) - body[:3]) @ quaternion_matrix(body[3:])
        distance = np.abs([(spots @ planes[:, :3].T + planes[:, 3]).max(axis=1) for planes in self._planes])
        parts = self.scene.body.hull_part[distance.argmin(axis=0)]
        np.add.at(force, ([self._finger[c[3]] for c in found], parts), [c[9] for c in found])
        return force, max(0.0, -min(c[8] for c in found)), len(found)


class _Wrench:
    """Forces on the gantry's joints, and the weight of the object."""

    def __init__(self, client: Client, scene: Scene, hand: int, joints: list[int], body: int) -> None:
        self.client, self.hand, self.joints, self.object = client, hand, joints, body
        self.efforts = np.zeros(6)
        self._weight = (0.0, 0.0, -scene.physics.gravity_m_s2 * float(client.getDynamicsInfo(body, -1)[0]))
        moves = sum(client.getJointInfo(hand, k)[3] >= 0 for k in range(client.getNumJoints(hand)))
        inertia = np.array(client.calculateMassMatrix(hand, [0.0] * moves))
        self._drag = scene.physics.drag_1_s * inertia.diagonal()[:6]
        self._slowed = 1.0 + scene.physics.drag_1_s / scene.physics.rate_hz
        for joint in joints:
            client.setJointMotorControl2(hand, joint, client.VELOCITY_CONTROL, force=0.0)

    def apply(self) -> None:
        """Apply the forces for one solver step.

        Drag uses the speed after the step and the inertia at q = 0, so that it does not overshoot.
        """
        speed = np.array([row[1] for row in self.client.getJointStates(self.hand, self.joints)])
        forces = (self.efforts - self._drag * speed) / self._slowed
        self.client.setJointMotorControlArray(self.hand, self.joints, self.client.TORQUE_CONTROL, forces=forces.tolist())
        centre = self.client.getBasePositionAndOrientation(self.object)[0]
        self.client.applyExternalForce(self.object, -1, self._weight, centre, self.client.WORLD_FRAME)


def _settings(client: Client, scene: Scene) -> None:
    """Set up the engine; with a weightless hand, gravity is 0 and the object's weight is applied at every step."""
    physics = scene.physics
    client.setTimeStep(1.0 / physics.rate_hz)
    client.setGravity(0.0, 0.0, 0.0 if scene.wrist == "wrench" else -physics.gravity_m_s2)
    client.setPhysicsEngineParameter(numSolverIterations=physics.iterations, deterministicOverlappingPairs=1)


def _table(client: Client, physics: Physics) -> int:
    shape = client.createCollisionShape(client.GEOM_BOX, halfExtents=TABLE_M)
    table = int(client.createMultiBody(0.0, shape, basePosition=(0.0, 0.0, -TABLE_M[2])))
    client.changeDynamics(table, -1, lateralFriction=physics.table_friction)
    return table


def _object(client: Client, scene: Scene, folder: Path) -> int:
    """Load the object; the friction of a contact is the product of both bodies', so the object's is 1."""
    path, physics = save_object(scene.body, folder), scene.physics
    body = int(client.loadURDF(str(path), flags=client.URDF_USE_INERTIA_FROM_FILE))
    info = client.getDynamicsInfo(body, -1)
    client.changeDynamics(body, -1, mass=info[0] * physics.mass_scale,
                          localInertiaDiagonal=[physics.mass_scale * number for number in info[2]], lateralFriction=1.0,
                          spinningFriction=physics.spin_friction_m, linearDamping=0.0, angularDamping=0.0)  # fmt: skip
    client.changeDynamics(body, -1, activationState=client.ACTIVATION_STATE_DISABLE_SLEEPING)
    return body


def _hand(client: Client, scene: Scene, folder: Path, seen: bool) -> int:
    flags = client.URDF_USE_INERTIA_FROM_FILE | client.URDF_USE_SELF_COLLISION | (0 if seen else client.URDF_IGNORE_VISUAL_SHAPES)
    hand, body = scene.hand, int(client.loadURDF(str(save_hand(scene.hand, folder)), useFixedBase=True, flags=flags))
    number = _numbers(client, body)
    index = [-1, *(number[name] for name in hand.joints.name)]
    allowed = set(map(tuple, hand.contacts.tolist()))
    for b, second in enumerate(index):
        # joint damping is off: the engine adds it as a force, which is unstable on links as light as those of fingers
        client.changeDynamics(body, second, lateralFriction=scene.physics.hand_friction, linearDamping=0.0, angularDamping=0.0,
                              jointDamping=0.0)  # fmt: skip
        for a, first in enumerate(index[:b]):
            client.setCollisionFilterPair(body, body, first, second, int((a, b) in allowed))
    for k, driver in enumerate(hand.joints.driver):
        if driver >= 0:
            _gear(client, scene, body, index[driver + 1], index[k + 1], k)
    return body


def _gear(client: Client, scene: Scene, body: int, driver: int, follower: int, joint: int) -> None:
    joints, zero = scene.hand.joints, (0.0, 0.0, 0.0)
    client.setJointMotorControl2(body, follower, client.VELOCITY_CONTROL, force=0.0)
    gear = client.createConstraint(body, driver, body, follower, client.JOINT_GEAR, (1.0, 0.0, 0.0), zero, zero)
    client.changeConstraint(gear, gearRatio=-float(joints.ratio[joint]), maxForce=GEAR_NM, erp=GEAR_ERP,
                            relativePositionTarget=float(joints.offset[joint]))  # fmt: skip


def _numbers(client: Client, body: int) -> dict[str, int]:
    """Map joint names to the engine's joint numbers, which are also those of the carried links."""
    return {client.getJointInfo(body, k)[1].decode(): k for k in range(client.getNumJoints(body))}


def save_object(body: GraspObject, folder: Path) -> Path:
    """Write an object as `object.urdf` with one mesh for each hull.

    Mass and inertia are those of the object, about its centre of mass.
    """
    robot = Xml.Element("robot", name="object")
    link = Xml.SubElement(robot, "link", name="object")
    inertial = Xml.SubElement(link, "inertial")
    Xml.SubElement(inertial, "origin", xyz=_decimals(body.com_m), rpy="0 0 0")
    Xml.SubElement(inertial, "mass", value=repr(body.mass_kg))
    (xx, xy, xz), (_, yy, yz), (_, _, zz) = body.inertia_kgm2.tolist()
    tensor = {"ixx": xx, "ixy": xy, "ixz": xz, "iyy": yy, "iyz": yz, "izz": zz}
    Xml.SubElement(inertial, "inertia", {key: repr(number) for key, number in tensor.items()})
    for number, hull in enumerate(body.hulls()):
        name = f"hull_{number}.obj"
        trimesh.convex.convex_hull(hull).export(folder / name, include_normals=False, digits=9)
        for shape in ("collision", "visual"):
            geometry = Xml.SubElement(Xml.SubElement(link, shape), "geometry")
            Xml.SubElement(geometry, "mesh", filename=name)
    path = folder / "object.urdf"
    path.write_text(Xml.tostring(robot, encoding="unicode"), encoding="utf-8")
    return path


def _decimals(numbers: np.ndarray) -> str:
    return " ".join(repr(float(number)) for number in numbers)
