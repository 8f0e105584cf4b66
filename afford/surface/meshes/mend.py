"""Read an object completely: read, infer the unit, repair, simplify, texture, label.

Faces are reduced by quadric edge collapse (Garland and Heckbert 1997). The category comes from the words of the object's name. The
unit is the stated one, or the only unit in which the object has the size of a hand-held thing.
"""

from __future__ import annotations

import re
from collections.abc import Iterable
from dataclasses import dataclass

import fast_simplification
import numpy as np

from afford.common.errors import SourceError
from afford.surface.meshes.charts import unwrap
from afford.surface.meshes.nearest import NearestSurface
from afford.surface.meshes.net import EditMesh, MeshError, bodies, edit_mesh, watertight
from afford.surface.meshes.parts import read_labels
from afford.surface.meshes.read import read_surface
from afford.surface.meshes.repair import Counts, RepairLimits, drop_empty, drop_repeated, repair
from afford.surface.meshes.surface import main_file
from afford.surface.meshes.texture import BAKED_PX, FaceColours, bake_colours, bake_texture, face_colours
from schemas.files import FileTree
from schemas.mesh import MeshParts, MeshReport, ObjectMesh, ReadMesh, Repair


@dataclass(frozen=True)
class MeshSettings:
    """Settings of mesh_read."""

    unit: str
    categories: tuple[str, ...]
    texture_px: int
    faces: int
    limits: RepairLimits


@dataclass(frozen=True, eq=False)
class FinishedMesh:
    """Textured mesh with the part of each face."""

    vertices: np.ndarray
    faces: np.ndarray
    uv: np.ndarray
    texture: np.ndarray
    part: np.ndarray
    deviation_m: float = 0.0


def read_repaired(files: FileTree, settings: MeshSettings) -> ReadMesh:
    """Read one object with parts and report; SourceError gives the file."""
    source = main_file(files).name
    surface = read_surface(files)
    labels = read_labels(files, source, surface)
    used = surface.vertices[np.unique(surface.faces)]
    unit = infer_unit(float(np.linalg.norm(np.ptp(used, axis=0))), settings.unit, surface.unit, source)
    try:
        net, counts = repair(surface.vertices * METRES[unit], surface.faces, settings.limits)
        seen, halved = face_colours(surface, net.corner, settings.texture_px)
        done = (*surface.notes, *counts, *((("images halved", halved),) if halved else ()))
        piece, simplified = _simplify_painted(net, seen, labels.part[net.corner[:, 0] // 3], settings)
    except MeshError as error:
        raise SourceError(source, error.expected, error.got, error.fix) from error
    category = labels.category or category_of(files.name, settings.categories)
    decided = "the user" if settings.unit != "auto" else "the format" if surface.unit else "its size"
    report = _report(files.name, source, (unit, decided), (*done, *simplified), piece)
    mesh = ObjectMesh(files.name, category, piece.vertices.astype(np.float32), piece.faces.astype(np.int32),
                      np.ascontiguousarray(piece.uv, np.float32), np.ascontiguousarray(piece.texture))
    return ReadMesh(mesh, MeshParts(files.name, labels.names, piece.part.astype(np.int16)), report)


def _simplify_painted(net: EditMesh, seen: FaceColours, part: np.ndarray, settings: MeshSettings) -> tuple[FinishedMesh, Counts]:
    """Texture the mesh, simplified if it has too many faces."""
    if len(net.faces) <= settings.faces:
        uv, texture = bake_colours(net.vertices, net.faces, seen, settings.texture_px)
        return FinishedMesh(net.vertices, net.faces, uv, texture, part), ()
    vertices, faces = simplify(net.vertices, net.faces, settings.faces)
    nearest = NearestSurface(net.vertices, net.faces)
    face, _, away = nearest(np.concatenate([vertices[faces].mean(axis=1), vertices]))
    middle = face[: len(faces)]
    plain = seen.texture.shape[:2] == (1, 1) and not seen.cornered.any()
    side = min(settings.texture_px, BAKED_PX)
    uv = np.full((len(faces), 3, 2), 0.5, np.float32) if plain else unwrap(vertices, faces, side)
    texture = seen.texture if plain else bake_texture(uv, side, _painter(vertices[faces], nearest, seen))
    piece = FinishedMesh(vertices, faces, uv, texture, part[middle], float(away.max()))
    return piece, (("faces taken out by simplifying", len(net.faces) - len(faces)),)


def _painter(tri: np.ndarray, nearest: NearestSurface, seen: FaceColours):  # type: ignore[no-untyped-def]  # a ColourAt
    """Return the colours on new triangles (f, 3, 3): those of the nearest points of the original surface."""
    def colour_at(face: np.ndarray, bary: np.ndarray) -> np.ndarray:
        old, there, _ = nearest(np.einsum("nk,nkc->nc", bary, tri[face]))
        return seen.at(old, there)

    return colour_at


def _report(name: str, source: str, unit: tuple[str, str], done: Counts, piece: FinishedMesh) -> MeshReport:
    size = np.ptp(piece.vertices, axis=0)
    return MeshReport(name, source, *unit, METRES[unit[0]], tuple(Repair(what, int(count)) for what, count in done),
                      piece.deviation_m, watertight(piece.faces), int(bodies(piece.faces).max()) + 1,
                      (float(size[0]), float(size[1]), float(size[2])))


def simplify(vertices: np.ndarray, faces: np.ndarray, count: int) -> tuple[np.ndarray, np.ndarray]:
    """Reduce to about `count` faces: (v, 3) float64, (f, 3) int64. MeshError for a surface that cannot be reduced."""
    size = np.linalg.norm(np.ptp(vertices, axis=0))
    points, triangles = fast_simplification.simplify(np.ascontiguousarray(vertices / size), np.ascontiguousarray(faces, np.int32),
                                                     target_count=count)
    net, _ = drop_empty(edit_mesh(np.asarray(points, np.float64) * size, np.asarray(triangles, np.int64)))
    net, _ = drop_repeated(net)
    if not 0 < len(net.faces) <= 1.1 * count:
        raise MeshError(f"a surface that {count} faces can show", f"one that keeps {len(net.faces)} of {len(faces)}",
                    "it is in too many pieces: simplify it by hand, drop more dust, or raise max_faces")
    net = net.compact()
    return net.vertices, net.faces


def name_words(name: str) -> list[str]:
    """Split a file name into lower-case words: '025_phillipsScrewdriver' -> phillips, screwdriver."""
    spaced = re.sub(r"(?<=[a-z])(?=[A-Z])", " ", name)
    return [word.lower() for word in re.findall(r"[A-Za-z]+", spaced)]


def category_of(name: str, categories: Iterable[str]) -> str:
    """Find the category in the words of a name, '' without a match.

    The last match counts ('kettle_brush' is a brush), and the longest of those that end there.
    """
    given = name_words(name)
    best = (0, 0, "")
    for category in categories:
        wanted = name_words(category)
        for k in range(len(given) - len(wanted) + 1):
            if wanted and given[k : k + len(wanted)] == wanted:
                best = max(best, (k + len(wanted), len(wanted), category))
    return best[2]


METRES = {"m": 1.0, "cm": 0.01, "mm": 0.001, "inch": 0.0254}
SMALLEST_M, LARGEST_M = 0.02, 2.0
"""range of the diagonal of hand-held objects"""


def infer_unit(diagonal: float, unit: str, stated: str, name: str) -> str:
    """Return the unit of a mesh whose bounding box has this diagonal.

    `unit` is the user's choice ('auto' for none), `stated` the unit of the format ('' for none). Without either, the unit is metres
    if that gives a hand-held size, otherwise the only unit that does. Raises SourceError when no unit fits, or several do.
    """
    if unit != "auto":
        if unit not in METRES:
            raise ValueError(f"unit: expected auto, {', '.join(METRES)}, got {unit!r}")
        return unit
    fits = [word for word, metres in METRES.items() if SMALLEST_M <= diagonal * metres <= LARGEST_M]
    if stated in fits or (not stated and "m" in fits):
        return stated or "m"
    if not stated and len(fits) == 1:
        return fits[0]
    sizes = ", ".join(f"{diagonal * METRES[word]:.3g} m if in {word}" for word in fits or METRES)
    raise SourceError(name, f"a diagonal of {SMALLEST_M:g} to {LARGEST_M:g} m in {stated or 'one unit only'}",
                      f"{diagonal:.6g} ({sizes})", f"say which with unit = {', '.join(fits or METRES)}")
