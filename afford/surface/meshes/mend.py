"""The files of an object -> its mesh, parts and report: reading, scaling, repairing, simplifying and painting in a row."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from afford.common.errors import SourceError
from afford.surface.meshes.bake import bake_texture
from afford.surface.meshes.category import category_of
from afford.surface.meshes.charts import unwrap
from afford.surface.meshes.errors import MeshError
from afford.surface.meshes.files import main_file
from afford.surface.meshes.nearest import NearestSurface
from afford.surface.meshes.net import EditMesh, bodies, watertight
from afford.surface.meshes.paint import BAKED_PX, FaceColours, bake_colours, face_colours
from afford.surface.meshes.parts import read_labels
from afford.surface.meshes.read import read_surface
from afford.surface.meshes.repair import Counts, RepairLimits, repair
from afford.surface.meshes.simplify import simplify
from afford.surface.meshes.units import METRES, infer_unit
from schemas.files import FileTree
from schemas.mesh import MeshParts, MeshReport, ObjectMesh, ReadMesh, Repair


@dataclass(frozen=True)
class MeshSettings:
    """What the user wants of a mesh."""

    unit: str
    categories: tuple[str, ...]
    texture_px: int
    faces: int
    limits: RepairLimits


@dataclass(frozen=True, eq=False)
class FinishedMesh:
    """A mesh with its look and the part of each face."""

    vertices: np.ndarray
    faces: np.ndarray
    uv: np.ndarray
    texture: np.ndarray
    part: np.ndarray
    deviation_m: float = 0.0


def read_repaired(files: FileTree, wishes: MeshSettings) -> ReadMesh:
    """Everything about one object; SourceError names its file."""
    source = main_file(files).name
    surface = read_surface(files)
    labels = read_labels(files, source, surface)
    used = surface.vertices[np.unique(surface.faces)]
    unit = infer_unit(float(np.linalg.norm(np.ptp(used, axis=0))), wishes.unit, surface.unit, source)
    try:
        net, counts = repair(surface.vertices * METRES[unit], surface.faces, wishes.limits)
        seen, halved = face_colours(surface, net.corner, wishes.texture_px)
        done = (*surface.notes, *counts, *((("images halved", halved),) if halved else ()))
        piece, simplified = _simplify_painted(net, seen, labels.part[net.corner[:, 0] // 3], wishes)
    except MeshError as error:
        raise SourceError(source, error.expected, error.got, error.fix) from error
    category = labels.category or category_of(files.name, wishes.categories)
    decided = "the user" if wishes.unit != "auto" else "the format" if surface.unit else "its size"
    report = _report(files.name, source, (unit, decided), (*done, *simplified), piece)
    mesh = ObjectMesh(files.name, category, piece.vertices.astype(np.float32), piece.faces.astype(np.int32),
                      np.ascontiguousarray(piece.uv, np.float32), np.ascontiguousarray(piece.texture))
    return ReadMesh(mesh, MeshParts(files.name, labels.names, piece.part.astype(np.int16)), report)


def _simplify_painted(net: EditMesh, seen: FaceColours, part: np.ndarray, wishes: MeshSettings) -> tuple[FinishedMesh, Counts]:
    """The painted mesh, simplified when it has too many faces."""
    if len(net.faces) <= wishes.faces:
        uv, texture = bake_colours(net.vertices, net.faces, seen, wishes.texture_px)
        return FinishedMesh(net.vertices, net.faces, uv, texture, part), ()
    vertices, faces = simplify(net.vertices, net.faces, wishes.faces)
    nearest = NearestSurface(net.vertices, net.faces)
    face, _, away = nearest(np.concatenate([vertices[faces].mean(axis=1), vertices]))
    middle = face[: len(faces)]
    plain = seen.texture.shape[:2] == (1, 1) and not seen.cornered.any()
    side = min(wishes.texture_px, BAKED_PX)
    uv = np.full((len(faces), 3, 2), 0.5, np.float32) if plain else unwrap(vertices, faces, side)
    texture = seen.texture if plain else bake_texture(uv, side, _painter(vertices[faces], nearest, seen))
    piece = FinishedMesh(vertices, faces, uv, texture, part[middle], float(away.max()))
    return piece, (("faces taken out by simplifying", len(net.faces) - len(faces)),)


def _painter(tri: np.ndarray, nearest: NearestSurface, seen: FaceColours):  # type: ignore[no-untyped-def]  # a ColourAt
    """Colours of places on new triangles (f, 3, 3): those of the nearest places of the old surface."""
    def colour_at(face: np.ndarray, bary: np.ndarray) -> np.ndarray:
        old, there, _ = nearest(np.einsum("nk,nkc->nc", bary, tri[face]))
        return seen.at(old, there)

    return colour_at


def _report(name: str, source: str, unit: tuple[str, str], done: Counts, piece: FinishedMesh) -> MeshReport:
    size = np.ptp(piece.vertices, axis=0)
    return MeshReport(name, source, *unit, METRES[unit[0]], tuple(Repair(what, int(count)) for what, count in done),
                      piece.deviation_m, watertight(piece.faces), int(bodies(piece.faces).max()) + 1,
                      (float(size[0]), float(size[1]), float(size[2])))
