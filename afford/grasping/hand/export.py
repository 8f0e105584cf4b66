"""Export a robot hand: its kinematic tree as URDF text, its meshes as OBJ files.

Every number is written so that it is read back to the same bits.
"""

from __future__ import annotations

import xml.etree.ElementTree as Xml
from collections.abc import Iterable
from pathlib import Path

import numpy as np
from scipy.spatial.transform import Rotation

from afford.grasping.hand.tree import Joint, Link, Shape, Tree
from schemas.hand import HandMesh, HandModel

UP, DOWN = 0.5, -0.5


def urdf_text(tree: Tree) -> str:
    """Write the whole hand as URDF.

    Capsules become `<capsule>`, which MuJoCo, PyBullet, Drake and newer ROS read; see `split_capsule`.
    """
    robot = Xml.Element("robot", name=tree.name)
    for link in tree.links:
        _link(robot, link)
    for joint in tree.joints:
        _joint(robot, joint)
    Xml.indent(robot)
    return Xml.tostring(robot, encoding="unicode") + "\n"


def split_capsule(shape: Shape) -> tuple[Shape, ...]:
    """Split a capsule into a cylinder and two spheres, for standard URDF; return any other shape unchanged."""
    if shape.kind != "capsule":
        return (shape,)
    radius, length = shape.size_m
    ends = (Shape("sphere", (radius,), shape.T_link_shape @ _along(side * length)) for side in (DOWN, UP))
    return (Shape("cylinder", shape.size_m, shape.T_link_shape), *ends)


def _along(z_m: float) -> np.ndarray:
    T = np.eye(4)
    T[2, 3] = z_m
    return T


def _link(robot: Xml.Element, link: Link) -> None:
    out = Xml.SubElement(robot, "link", name=link.name)
    if link.mass_kg > 0:
        inertial = Xml.SubElement(out, "inertial")
        _origin(inertial, link.T_link_inertia)
        Xml.SubElement(inertial, "mass", value=_words([link.mass_kg]))
        (xx, xy, xz), (_, yy, yz), (_, _, zz) = link.inertia_kgm2
        tensor = {"ixx": xx, "ixy": xy, "ixz": xz, "iyy": yy, "iyz": yz, "izz": zz}
        Xml.SubElement(inertial, "inertia", {key: _words([number]) for key, number in tensor.items()})
    for shape in link.visuals:
        material = Xml.SubElement(_shape(out, "visual", shape), "material", name=f"{link.name}_colour")
        Xml.SubElement(material, "color", rgba=_words([*link.rgb, 1.0]))
    for shape in link.collisions:
        _shape(out, "collision", shape)


def _shape(link: Xml.Element, where: str, shape: Shape) -> Xml.Element:
    out = Xml.SubElement(link, where)
    _origin(out, shape.T_link_shape)
    geometry = Xml.SubElement(out, "geometry")
    if shape.kind == "mesh":
        Xml.SubElement(geometry, "mesh", filename=shape.mesh)
    elif shape.kind == "box":
        Xml.SubElement(geometry, "box", size=_words(shape.size_m))
    else:
        sizes = zip(("radius", "length"), shape.size_m, strict=False)
        Xml.SubElement(geometry, shape.kind, {key: _words([number]) for key, number in sizes})
    return out


def _joint(robot: Xml.Element, joint: Joint) -> None:
    out = Xml.SubElement(robot, "joint", name=joint.name, type=joint.kind)
    _origin(out, joint.T_parent_joint)
    Xml.SubElement(out, "parent", link=joint.parent)
    Xml.SubElement(out, "child", link=joint.child)
    if joint.kind == "fixed":
        return
    Xml.SubElement(out, "axis", xyz=_words(joint.axis))
    limits = {"lower": joint.lower, "upper": joint.upper, "effort": joint.effort, "velocity": joint.velocity}
    Xml.SubElement(out, "limit", {key: _words([number]) for key, number in limits.items()})
    Xml.SubElement(out, "dynamics", damping=_words([joint.damping]), friction=_words([joint.friction]))
    if joint.coupling is not None:
        Xml.SubElement(out, "mimic", joint=joint.coupling.driver, multiplier=_words([joint.coupling.ratio]),
                       offset=_words([joint.coupling.offset]))


def _origin(element: Xml.Element, T: np.ndarray) -> None:
    rpy = Rotation.from_matrix(T[:3, :3]).as_euler("xyz", suppress_warnings=True)
    Xml.SubElement(element, "origin", xyz=_words(T[:3, 3]), rpy=_words(rpy))


def _words(numbers: Iterable[float]) -> str:
    """Format numbers as the shortest decimals that give the same doubles, without minus zero."""
    return " ".join(repr(float(number) + 0.0) for number in numbers)


def mesh_files(hand: HandModel) -> dict[str, bytes]:
    """Return the meshes that the URDF names, by file name without folder, for engines that read from memory."""
    return {mesh.file.rpartition("/")[2]: _obj(mesh).encode() for mesh in hand.meshes}


def save_hand(hand: HandModel, folder: Path) -> Path:
    """Write `<name>.urdf` and its meshes to a folder and return the path of the URDF; the same hand gives the same bytes."""
    folder.mkdir(parents=True, exist_ok=True)
    for mesh in hand.meshes:
        path = folder / mesh.file
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(_obj(mesh), encoding="utf-8", newline="\n")
    path = folder / f"{hand.name}.urdf"
    path.write_text(hand.urdf, encoding="utf-8", newline="\n")
    return path


def _obj(mesh: HandMesh) -> str:
    """Format a mesh as OBJ with one normal per face, so that edges stay sharp."""
    corners = mesh.vertices.astype(np.float64)[mesh.faces]
    normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    normals /= np.maximum(np.linalg.norm(normals, axis=1, keepdims=True), 1e-30)
    lines = [f"v {x:.9g} {y:.9g} {z:.9g}" for x, y, z in mesh.vertices.tolist()]
    lines += [f"vn {x:.6f} {y:.6f} {z:.6f}" for x, y, z in normals.tolist()]
    lines += [f"f {a}//{k} {b}//{k} {c}//{k}" for k, (a, b, c) in enumerate((mesh.faces + 1).tolist(), 1)]
    return "\n".join(lines) + "\n"
