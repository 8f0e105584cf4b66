"""3-D objects: specification, textured mesh, parts, and rendered views."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

from schemas.spec import Bundle, Schema, array, value

if TYPE_CHECKING:
    import numpy as np


@dataclass(frozen=True)
class ObjectSpec(Schema):
    """Specification of one procedural object. The same spec gives the same bytes."""

    name: str = value("id of the object, unique among its siblings, e.g. knife_03")
    category: str = value("what it is, e.g. knife; one of the categories of afford/objects")
    seed: int = value("seed of its shape and texture")
    look: str = value("mixed: a material for each region of the surface; plain: one material for all of it")
    split: str = value("train, val, seen (a trained category in a new shape) or unseen (a category that training never shows)")


@dataclass(frozen=True)
class ObjectMesh(Schema):
    """Triangle mesh with its texture."""

    name: str = value("id of the object")
    category: str = value("category, e.g. knife; '' when unknown")
    vertices: np.ndarray = array("v 3", "float32", "corners of triangles", unit="m", frame="object")
    faces: np.ndarray = array("f 3", "int32", "vertex indices, counter-clockwise seen from outside")
    uv: np.ndarray = array("f 3 2", "float32", "texture coordinates of each corner, 0..1, v upwards as in OBJ and GLB")
    texture: np.ndarray = array("a b 3", "uint8", "base colour, sRGB; (1, 1) for a single colour", encoding="zstd")


@dataclass(frozen=True)
class MeshParts(Schema):
    """Semantic parts of a mesh."""

    name: str = value("id of the object")
    names: tuple[str, ...] = value("p part names, e.g. handle, blade")
    part: np.ndarray = array("f", "int16", "index into `names` of each face, -1 where unknown")


@dataclass(frozen=True)
class PartedMesh(Bundle):
    """Mesh and its parts; each field is an artifact of its own."""

    mesh: ObjectMesh = value("its surface")
    parts: MeshParts = value("its parts; every face -1 and no names where they are not known")


@dataclass(frozen=True)
class Repair(Schema):
    """Repair of a mesh, done or impossible."""

    what: str = value("what, e.g. holes filled")
    count: int = value("how often; 1 or more")


@dataclass(frozen=True)
class MeshReport(Schema):
    """Report on the reading of a mesh."""

    name: str = value("id of the object")
    source: str = value("file that it was read from")
    unit: str = value("what the numbers of the file are taken for: m, cm, mm or inch")
    decided: str = value("source of the unit: the user, the format, or the mesh size")
    scale: float = value("what they were multiplied by", unit="m")
    repairs: tuple[Repair, ...] = value("in the order in which they were done; what was not needed is left out")
    deviation_m: float = value("largest distance of the simplified surface from the original one; 0 when not simplified", unit="m")
    watertight: bool = value("whether every edge has two faces that agree")
    bodies: int = value("connected pieces")
    size_m: tuple[float, float, float] = value("extent along x, y, z", unit="m")


@dataclass(frozen=True)
class ReadMesh(Bundle):
    """Mesh from a file; each field is an artifact of its own."""

    mesh: ObjectMesh = value("its surface, in metres and repaired")
    parts: MeshParts = value("its parts as the label file has them; every face -1 and no names where there is none")
    report: MeshReport = value("what was decided and repaired")


@dataclass(frozen=True)
class ObjectViews(Schema):
    """Views of an object from all sides, with the exact face of every pixel."""

    name: str = value("id of the object")
    views: tuple[str, ...] = value("n labels: front, back, left, right, top, bottom, then added_1, ...")
    rgb: np.ndarray = array("n h w 3", "uint8", "rendered colour", encoding="video")
    face: np.ndarray = array("n h w", "int32", "index of the face at each pixel centre, -1 beside the object", encoding="zstd")
    depth_m: np.ndarray = array("n h w", "float32", "along the optical axis, 0 beside the object", unit="m", encoding="zstd")
    K: np.ndarray = array("n 3 3", "float64", "pinhole matrices", unit="px")
    T_obj_cam: np.ndarray = array("n 4 4", "float64", "camera to object", unit="m", frame="object")
    visible_area: np.ndarray = array("f", "float32", "area of each face that can be seen from outside", unit="m^2")
    seen_area: np.ndarray = array("n", "float64", "share of the visible area seen at a good angle by the first 1..n views")
