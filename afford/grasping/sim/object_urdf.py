"""A graspable object as a URDF with one mesh for each hull, for engines that read files."""

from __future__ import annotations

import xml.etree.ElementTree as Xml
from pathlib import Path

import numpy as np
import trimesh

from schemas.grasp import GraspObject


def save(body: GraspObject, folder: Path) -> Path:
    """Write `object.urdf` and its hulls; mass and inertia are those of the object, about its centre of mass."""
    robot = Xml.Element("robot", name="object")
    link = Xml.SubElement(robot, "link", name="object")
    inertial = Xml.SubElement(link, "inertial")
    Xml.SubElement(inertial, "origin", xyz=_words(body.com_m), rpy="0 0 0")
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


def _words(numbers: np.ndarray) -> str:
    return " ".join(repr(float(number)) for number in numbers)
