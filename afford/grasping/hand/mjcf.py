"""Read the Shadow Hand's MJCF into a kinematic tree, through MuJoCo's own compiler, which resolves defaults and includes.

The tree keeps bodies, hinges with limits, inertia, collision primitives (group 4), visual meshes (group 1), the motors' torque
limits, fingertip sites, and the pairs of links that may touch. In the MJCF, a tendon of 0.00705 q0 - 0.00805 q1 within +-0.001
couples the last two joints of each finger. The tree uses q0 = q1, which respects both limits (docs/grasping/hand.md).
"""

from __future__ import annotations

import mujoco
import numpy as np
from scipy.spatial.transform import Rotation

from afford.common.errors import SourceError
from afford.grasping.hand.tree import Coupling, Joint, Link, Shape, Tree, ordered
from schemas.files import FileTree

PREFIX = "robot0:"
MOUNT = "robot0:hand mount"
COLLIDES, SEEN = 4, 1
VELOCITY_RAD_S = 4.0
"""MJCF has no velocity limit; this is the limit of the fastest joints in the maker's own URDF"""
WORLD = """<mujoco><compiler angle="radian"/><include file="shared.xml"/><asset><include file="shared_asset.xml"/></asset>
<worldbody><include file="robot.xml"/></worldbody></mujoco>"""


def compile_hand(files: FileTree) -> mujoco.MjModel:
    """Compile the hand alone with MuJoCo; SourceError when MuJoCo rejects it."""
    try:
        return mujoco.MjModel.from_xml_string(WORLD, {f.name.rpartition("/")[2]: f.path.read_bytes() for f in files.files})
    except ValueError as error:
        raise SourceError(files.name, "an MJCF that MuJoCo compiles", str(error).replace("\n", " "),
                          "install gymnasium-robotics again") from error


def read(files: FileTree) -> Tree:
    """Read the hand from the forearm on; names of links and joints lose their prefix."""
    model = compile_hand(files)
    bodies = [b for b in range(1, model.nbody) if model.body(b).name != MOUNT]
    joints = [_joint(model, b) for b in bodies if model.body(int(model.body_parentid[b])).name not in ("world", MOUNT)]
    pairs = {tuple(_name(model.body(int(model.geom_bodyid[g]))) for g in (model.pair_geom1[p], model.pair_geom2[p]))
             for p in range(model.npair)}  # fmt: skip
    tips = {_name(model.body(int(model.site_bodyid[s]))): model.site_pos[s].copy() for s in range(model.nsite)
            if model.site(s).name.startswith(f"{PREFIX}S_")}
    return ordered(Tree(files.name, tuple(_link(model, b) for b in bodies), tuple(joints), _meshes(model), tips,
                        tuple(sorted(pairs))))  # type: ignore[arg-type]  # pairs of two


def _name(view: object) -> str:
    return str(view.name).removeprefix(PREFIX)  # type: ignore[attr-defined]  # MuJoCo's views have no common type


def _pose(place: np.ndarray, wxyz: np.ndarray) -> np.ndarray:
    T = np.eye(4)
    T[:3, :3] = Rotation.from_quat(wxyz, scalar_first=True).as_matrix()
    T[:3, 3] = place
    return T


def _link(model: mujoco.MjModel, body: int) -> Link:
    geoms = [g for g in range(model.ngeom) if model.geom_bodyid[g] == body]
    shapes = {group: tuple(_shape(model, g) for g in geoms if model.geom_group[g] == group) for group in (COLLIDES, SEEN)}
    seen = [g for g in geoms if model.geom_group[g] == SEEN and model.geom_matid[g] >= 0]
    more = {"rgb": tuple(map(float, np.round(model.mat_rgba[model.geom_matid[seen[0]], :3], 4)))} if seen else {}
    return Link(_name(model.body(body)), float(model.body_mass[body]), _pose(model.body_ipos[body], model.body_iquat[body]),
                np.diag(model.body_inertia[body]), shapes[COLLIDES], shapes[SEEN], **more)  # type: ignore[arg-type]  # three


def _shape(model: mujoco.MjModel, geom: int) -> Shape:
    """Convert a geom to a shape.

    MuJoCo stores half sizes, and moves a mesh to its principal axes; the pose of the geom undoes that.
    """
    kind, size = int(model.geom_type[geom]), model.geom_size[geom]
    T = _pose(model.geom_pos[geom], model.geom_quat[geom])
    if kind == mujoco.mjtGeom.mjGEOM_MESH:
        return Shape("mesh", (), T, _file(model, int(model.geom_dataid[geom])))
    if kind == mujoco.mjtGeom.mjGEOM_BOX:
        return Shape("box", tuple(2 * float(half) for half in size), T)
    if kind == mujoco.mjtGeom.mjGEOM_CAPSULE:
        return Shape("capsule", (float(size[0]), 2 * float(size[1])), T)
    raise SourceError(_name(model.geom(geom)), "a box, capsule or mesh", f"geom type {kind}", "use the hand of gymnasium-robotics")


def _file(model: mujoco.MjModel, mesh: int) -> str:
    return f"meshes/{_name(model.mesh(mesh))}.obj"


def _meshes(model: mujoco.MjModel) -> dict[str, tuple[np.ndarray, np.ndarray]]:
    out = {}
    for mesh in range(model.nmesh):
        v, n = model.mesh_vertadr[mesh], model.mesh_vertnum[mesh]
        f, m = model.mesh_faceadr[mesh], model.mesh_facenum[mesh]
        out[_file(model, mesh)] = (model.mesh_vert[v : v + n].astype(np.float32), model.mesh_face[f : f + m].astype(np.int32))
    return out


def _joint(model: mujoco.MjModel, body: int) -> Joint:
    """Convert the single hinge of a body, which lies at the body's origin."""
    j = int(model.body_jntadr[body])
    parent, child = _name(model.body(int(model.body_parentid[body]))), _name(model.body(body))
    T = _pose(model.body_pos[body], model.body_quat[body])
    if j < 0:
        return Joint(f"{child}_fixed", "fixed", parent, child, T)
    if model.body_jntnum[body] != 1 or model.jnt_type[j] != mujoco.mjtJoint.mjJNT_HINGE or model.jnt_pos[j].any():
        raise SourceError(child, "one hinge at its origin", "other joints", "use the hand of gymnasium-robotics")
    driver, dof = _driver(model, j), int(model.jnt_dofadr[j])
    effort = _effort(model, j if driver is None else driver)
    lower, upper = map(float, model.jnt_range[j])
    coupling = None if driver is None else Coupling(_name(model.joint(driver)))
    x, y, z = map(float, model.jnt_axis[j])
    return Joint(_name(model.joint(j)), "revolute", parent, child, T, (x, y, z), lower, upper, effort, VELOCITY_RAD_S,
                 float(model.dof_damping[dof]), float(model.dof_frictionloss[dof]), coupling)


def _driver(model: mujoco.MjModel, joint: int) -> int | None:
    """Find the motorised joint to which a tendon of two opposite coefficients ties a joint.

    None for a joint that has a motor.
    """
    if _motors(model, joint):
        return None
    for tendon in range(model.ntendon):
        at, count = int(model.tendon_adr[tendon]), int(model.tendon_num[tendon])
        tied, pull = list(model.wrap_objid[at : at + count]), model.wrap_prm[at : at + count]
        if joint in tied and count == 2 and pull[0] * pull[1] < 0:
            return int(tied[1 - tied.index(joint)])
    raise SourceError(_name(model.joint(joint)), "a motor or a tendon that couples it", "neither",
                      "use the hand of gymnasium-robotics")


def _motors(model: mujoco.MjModel, joint: int) -> list[int]:
    return [a for a in range(model.nu) if model.actuator_trnid[a, 0] == joint]


def _effort(model: mujoco.MjModel, joint: int) -> float:
    return float(model.actuator_forcerange[_motors(model, joint)[0], 1])
