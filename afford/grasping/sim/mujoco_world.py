"""A world in MuJoCo. Only this module and the reader of MJCF import mujoco.

MuJoCo reads the hand's URDF itself and turns `<mimic>` into equality constraints. Motors are overdamped position servos: force = k
(target - q) - k response_s qd, clipped at the motor's effort. Newton's solver, elliptic cones, implicit damping. A wrist that
takes forces has plain motors, no weight, and drag as joint damping.
"""

from __future__ import annotations

from dataclasses import dataclass

import mujoco
import numpy as np

from afford.common.geometry import cross
from afford.grasping.hand.export import mesh_files as files_of
from afford.grasping.hand.kinematics import commanded_joints, moving_joints, points_on_links
from afford.grasping.sim.engine import DivergedError, State, finite_vector, solver_steps
from afford.grasping.sim.scene import Scene, finger_of_link, hold_command, scene_limits
from schemas.grasp import GraspObject
from schemas.hand import HandModel

HAND, OBJECT, TABLE = 1, 2, 4
YIELD_RAD, YIELD_M = 0.1, 0.02
"""distance from its target at which a motor reaches its full effort"""
CONTACT_SOLIMP = (0.95, 0.99, 0.001, 0.5, 2.0)
ARMATURE_KGM2 = 3e-4
"""of finger motors; a URDF cannot state it, and light links tremble at their limits without it"""
COUPLING_SOLIMP = (0.99, 0.999, 0.001, 0.5, 2.0)
IMPRATIO = 3.0
"""stiffness of friction relative to the normal direction; held objects creep at lower values"""
STATE = mujoco.mjtState.mjSTATE_INTEGRATION
LOST = (mujoco.mjtWarning.mjWARN_BADQPOS, mujoco.mjtWarning.mjWARN_BADQVEL, mujoco.mjtWarning.mjWARN_BADQACC)
"""warnings after which MuJoCo has reset itself"""
FASTEST = 100.0
"""speed limit after a step, rad/s and m/s, as in Bullet; an unloaded joint at full effort would exceed all bounds"""
FINER = 8
"""smaller steps that replace a diverging step"""


@dataclass(frozen=True, eq=False)
class Saved:
    """Saved state of a world."""

    numbers: np.ndarray
    force: np.ndarray
    steps_left: int
    state: State


class MujocoWorld:
    """MuJoCo world; see afford.grasping.sim.engine.World."""

    def __init__(self, scene: Scene) -> None:
        self.scene = scene
        self.model: mujoco.MjModel = compiled(scene)
        self._data = mujoco.MjData(self.model)
        at = layout(self.model, scene)
        self._q, self._qd, self._motors, self._links, self._object = at.q, at.qd, at.motors, at.links, at.object
        self._free, self._finger, self._part = at.free, at.finger, at.part
        self._limits = scene_limits(scene)
        self._force, self._left = np.zeros(3), 0
        self._before = np.empty(mujoco.mj_stateSize(self.model, STATE))
        self._speed, self._fastest = self._data.qvel, np.full(self.model.nv, FASTEST)
        self._slowest = -self._fastest
        self._lost = tuple(self._data.warning[kind] for kind in LOST)
        self._took = self._data.solver_niter
        self._pushed = self._data.xfrc_applied[self._object, :3]

    def reset(self, q: np.ndarray, body: np.ndarray) -> State:
        """Reset to rest, joints at q, motors holding them."""
        q, pose = finite_vector("reset, q", q, len(self._q)), finite_vector("reset, body", body, 7)
        mujoco.mj_resetData(self.model, self._data)
        self._data.qpos[self._q] = q
        self._data.qpos[self._free[0] :][:7] = pose[[0, 1, 2, 6, 3, 4, 5]]
        self._data.ctrl[self._motors] = hold_command(self.scene, q)
        self._force, self._left = np.zeros(3), 0
        mujoco.mj_forward(self.model, self._data)
        return self.state()

    def step(self, u: np.ndarray, control_s: float) -> State:
        """Advance while the motors follow u, clipped to the limits of their joints."""
        u, count = finite_vector("step, u", u, len(self._motors)), solver_steps(control_s, self.scene.physics.rate_hz)
        self._data.ctrl[self._motors] = u.clip(*self._limits.T)
        for _ in range(count):
            self._pushed[:] = self._force if self._left else 0.0
            self._left = max(0, self._left - 1)
            self._advance()
        mujoco.mj_kinematics(self.model, self._data)
        return self.state()

    def _advance(self) -> None:
        """Run one solver step, and retry it when it diverges.

        Newton on a sparse Jacobian takes half the time, but about once in many thousand steps it fails where contacts slide. That
        step is retried with a dense Jacobian, and if it diverges again, in smaller steps.
        """
        mujoco.mj_getState(self.model, self._data, self._before, STATE)
        if self._moved() and max(self._took[: max(1, self._data.nisland)].tolist()) < self.scene.physics.iterations:
            return
        self.model.opt.jacobian = mujoco.mjtJacobian.mjJAC_DENSE
        done = self._again() or self._again(FINER)
        self.model.opt.jacobian = mujoco.mjtJacobian.mjJAC_SPARSE
        if not done:
            raise DivergedError(f"{self.scene.body.name}: MuJoCo diverged and reset itself; more iterations than "
                                f"{self.scene.physics.iterations} or a rate above {self.scene.physics.rate_hz} Hz are needed")

    def _again(self, parts: int = 1) -> bool:
        """Retry the step in equal parts."""
        for warning in self._lost:
            warning.number = 0
        mujoco.mj_setState(self.model, self._data, self._before, STATE)
        self.model.opt.timestep = 1.0 / self.scene.physics.rate_hz / parts
        done = all(self._moved() for _ in range(parts))
        self.model.opt.timestep = 1.0 / self.scene.physics.rate_hz
        return done

    def _moved(self) -> bool:
        """Run mj_step; false when MuJoCo reset itself."""
        mujoco.mj_step(self.model, self._data)
        np.minimum(self._speed, self._fastest, out=self._speed)
        np.maximum(self._speed, self._slowest, out=self._speed)
        position, speed, acceleration = self._lost
        return not (position.number or speed.number or acceleration.number)

    def push(self, force: np.ndarray, duration_s: float) -> None:
        """Apply a force to the object for a time."""
        self._force, self._left = finite_vector("push, force", force, 3), round(duration_s * self.scene.physics.rate_hz)

    def state(self) -> State:
        """Return the state; positions are current, forces are those of the last solver step."""
        d, hand = self._data, self.scene.hand
        T = np.zeros((1, len(self._links), 4, 4))
        T[0, :, :3, :3], T[0, :, :3, 3] = d.xmat[self._links].reshape(-1, 3, 3), d.xpos[self._links]
        at, dof = self._free
        R = d.xmat[self._object].reshape(3, 3)
        spin = R @ d.qvel[dof + 3 : dof + 6]
        force, deepest, count = self._touching()
        return State(
            q=d.qpos[self._q], qd=d.qvel[self._qd], torque=d.actuator_force[self._motors],
            tips=points_on_links(T, hand.fingers.tip_link, hand.fingers.tip_m)[0], palm=self._pose(int(self._links[hand.palm])),
            body=d.qpos[at + np.array([0, 1, 2, 4, 5, 6, 3])],
            velocity=d.qvel[dof : dof + 3] + cross(spin, R @ self.scene.body.com_m), spin=spin, force=force,
            penetration_m=deepest, contacts=count)  # fmt: skip

    def save(self) -> Saved:
        """Save all that the next step depends on."""
        numbers = np.empty_like(self._before)
        mujoco.mj_getState(self.model, self._data, numbers, STATE)
        return Saved(numbers, self._force, self._left, self.state())

    def restore(self, token: Saved) -> State:
        """Restore a saved state."""
        mujoco.mj_setState(self.model, self._data, token.numbers, STATE)
        mujoco.mj_kinematics(self.model, self._data)
        self._force, self._left = token.force, token.steps_left
        return token.state

    def close(self) -> None:
        """Do nothing: garbage collection frees the engine."""

    def _pose(self, body: int) -> np.ndarray:
        return np.concatenate([self._data.xpos[body], self._data.xquat[body][[1, 2, 3, 0]]])

    def _touching(self) -> tuple[np.ndarray, float, int]:
        """Measure contacts of the hand with the object.

        (fingers + 1, parts) newtons, depth of the deepest contact, number of contacts.
        """
        contact = self._data.contact
        force = np.zeros((len(self.scene.hand.fingers.name) + 1, len(self.scene.body.parts)))
        if not len(contact):
            return force, 0.0, 0
        finger, part = self._finger[contact.geom].max(axis=1), self._part[contact.geom].max(axis=1)
        row = contact.efc_address
        touch = (finger >= 0) & (part >= 0) & (row >= 0)
        if not touch.any():
            return force, 0.0, 0
        np.add.at(force, (finger[touch], part[touch]), self._data.efc_force[row[touch]])
        return force, max(0.0, -float(contact.dist[touch].min())), int(touch.sum())


@dataclass(frozen=True, eq=False)
class Layout:
    """Indices of a scene's quantities in its MuJoCo model."""

    q: np.ndarray
    """(d,) of qpos: the joints of the hand that move"""
    qd: np.ndarray
    """(d,) of qvel"""
    motors: np.ndarray
    """(m,) of ctrl"""
    links: np.ndarray
    """(l,) bodies of the hand's links"""
    object: int
    """body of the object"""
    free: tuple[int, int]
    """of the object's joint: first of seven in qpos, first of six in qvel"""
    finger: np.ndarray
    """(g,) finger of each geom, -1 for geoms that are not part of the hand"""
    part: np.ndarray
    """(g,) part of each geom, -1 for geoms that are not part of the object"""


def layout(model: mujoco.MjModel, scene: Scene) -> Layout:
    """Find the indices in the model of a scene, as `compiled` builds it."""
    joints, names = scene.hand.joints, scene.hand.joints.name
    moves, motors = ([names[k] for k in some] for some in (moving_joints(joints), commanded_joints(joints)))
    free = model.joint("object")
    return Layout(
        np.array([int(model.joint(name).qposadr[0]) for name in moves]),
        np.array([int(model.joint(name).dofadr[0]) for name in moves]), np.array([model.actuator(name).id for name in motors]),
        np.array([model.body(name).id for name in scene.hand.links]), int(model.body("object").id),
        (int(free.qposadr[0]), int(free.dofadr[0])), *_owners(model, scene.hand, scene.body))  # fmt: skip


def compiled(scene: Scene) -> mujoco.MjModel:
    """Compile the model of a scene."""
    physics = scene.physics
    spec = mujoco.MjSpec.from_string(scene.hand.urdf, assets=files_of(scene.hand))
    spec.compiler.fusestatic = False
    spec.option.timestep, spec.option.gravity = 1.0 / physics.rate_hz, (0.0, 0.0, -physics.gravity_m_s2)
    spec.option.integrator, spec.option.cone = mujoco.mjtIntegrator.mjINT_IMPLICITFAST, mujoco.mjtCone.mjCONE_ELLIPTIC
    spec.option.iterations, spec.option.impratio = physics.iterations, IMPRATIO
    spec.option.jacobian = mujoco.mjtJacobian.mjJAC_SPARSE
    _hand(spec, scene)
    _table(spec, scene)
    _object(spec, scene)
    model = spec.compile()
    if scene.wrist == "wrench":
        _drag(model, scene)
    return model


def _hand(spec: mujoco.MjSpec, scene: Scene) -> None:
    """Set up the hand: contacts, couplings and motors.

    Shapes touch the object and the table, and each other for the pairs that the hand lists. Every joint with a motor gets an
    actuator.
    """
    hand, stiff = scene.hand, (2.0 / scene.physics.rate_hz, 1.0)
    for equality in spec.equalities:
        equality.solref[:], equality.solimp[:] = stiff, COUPLING_SOLIMP
    for link in hand.links:
        for number, geom in enumerate(spec.body(link).geoms):
            geom.name, geom.contype, geom.conaffinity = f"{link}/{number}", HAND, 0
            _rub(geom, scene, scene.physics.hand_friction, priority=2)
    for a, b in hand.contacts:
        for one in spec.body(hand.links[a]).geoms:
            for other in spec.body(hand.links[b]).geoms:
                spec.add_pair(geomname1=one.name, geomname2=other.name, condim=3, solref=stiff)
    for name, role in zip(hand.joints.name, hand.joints.role, strict=True):
        if role in ("actuated", "coupled"):
            spec.joint(name).armature = ARMATURE_KGM2
            spec.joint(name).frictionloss = 0.0  # a constraint for each joint at each step, for a thousandth of a motor's torque
    if scene.wrist == "wrench":
        for link in hand.links:
            spec.body(link).gravcomp = 1.0
    for k in commanded_joints(hand.joints):
        _motor(spec, scene, int(k))


def _drag(model: mujoco.MjModel, scene: Scene) -> None:
    """Set the drag of the gantry's joints: the rate times the inertia that each joint carries at q = 0."""
    data, inertia = mujoco.MjData(model), np.empty((model.nv, model.nv))
    data.qpos[:] = model.qpos0
    mujoco.mj_forward(model, data)
    mujoco.mj_fullM(model, data, inertia)
    for k in commanded_joints(scene.hand.joints)[:6]:
        dof = int(model.joint(scene.hand.joints.name[k]).dofadr[0])
        model.dof_damping[dof] = scene.physics.drag_1_s * inertia[dof, dof]


def _motor(spec: mujoco.MjSpec, scene: Scene, joint: int) -> None:
    joints, physics = scene.hand.joints, scene.physics
    scale = 1.0 if joints.role[joint] == "wrist" else physics.effort_scale
    effort = float(joints.effort[joint]) * scale
    gain = effort / (YIELD_M if joints.kind[joint] == "prismatic" else YIELD_RAD)
    spec.joint(joints.name[joint]).actfrclimited = mujoco.mjtLimited.mjLIMITED_FALSE  # the motor has the limit
    motor = spec.add_actuator(name=joints.name[joint], target=joints.name[joint], trntype=mujoco.mjtTrn.mjTRN_JOINT)
    if joints.role[joint] == "wrist" and scene.wrist == "wrench":
        motor.set_to_motor()
    else:
        motor.set_to_position(kp=gain, kv=gain * physics.response_s)
    motor.forcelimited, motor.forcerange = mujoco.mjtLimited.mjLIMITED_TRUE, (-effort, effort)


def _rub(geom: mujoco.MjsGeom, scene: Scene, friction: float, priority: int) -> None:
    geom.condim, geom.friction, geom.priority = 4, (friction, scene.physics.spin_friction_m, 0.0), priority
    geom.solref, geom.solimp = (2.0 / scene.physics.rate_hz, 1.0), CONTACT_SOLIMP


def _table(spec: mujoco.MjSpec, scene: Scene) -> None:
    top = spec.worldbody.add_geom(name="table", type=mujoco.mjtGeom.mjGEOM_PLANE, size=(2, 2, 0.1), contype=TABLE,
                                  conaffinity=HAND | OBJECT)  # fmt: skip
    _rub(top, scene, scene.physics.table_friction, priority=1)


def _object(spec: mujoco.MjSpec, scene: Scene) -> None:
    """Add the object with one geom for each hull."""
    found, scale = scene.body, scene.physics.mass_scale
    (xx, xy, xz), (_, yy, yz), (_, _, zz) = found.inertia_kgm2 * scale
    body = spec.worldbody.add_body(name="object", mass=found.mass_kg * scale, ipos=found.com_m,
                                   fullinertia=(xx, yy, zz, xy, xz, yz), explicitinertial=True)  # fmt: skip
    body.add_freejoint(name="object")
    for number, hull in enumerate(found.hulls()):
        spec.add_mesh(name=f"hull/{number}", uservert=hull.reshape(-1), inertia=mujoco.mjtMeshInertia.mjMESH_INERTIA_SHELL)
        geom = body.add_geom(name=f"hull/{number}", type=mujoco.mjtGeom.mjGEOM_MESH, meshname=f"hull/{number}", contype=OBJECT,
                             conaffinity=HAND)  # fmt: skip
        _rub(geom, scene, scene.physics.table_friction, priority=0)


def _owners(model: mujoco.MjModel, hand: HandModel, body: GraspObject) -> tuple[np.ndarray, np.ndarray]:
    """Return (g,) finger and (g,) part of each geom, -1 for other geoms."""
    finger, part = np.full(model.ngeom, -1), np.full(model.ngeom, -1)
    of_link = finger_of_link(hand)
    for link, name in enumerate(hand.links):
        finger[model.geom_bodyid == model.body(name).id] = of_link[link]
    for number, owner in enumerate(body.hull_part):
        part[model.geom(f"hull/{number}").id] = owner
    return finger, part
