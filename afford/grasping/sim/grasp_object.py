"""Physics model of an object from a mesh and its parts: convex hulls, mass, inertia and surface points.

Convex decomposition: the least convex piece is cut in two by a plane until every piece is convex enough. A piece never spans two
parts. Pieces are open surfaces, which is enough: the hull of a solid cut by a plane is the hull of its cut surface. The concavity
of a piece is measured in metres: how far the surface of its hull stands out of the whole body (compare CoACD, arXiv 2205.02961).
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
import trimesh
from scipy.spatial import ConvexHull
from trimesh.intersections import slice_faces_plane

from afford.common.geometry import farthest_point_sampling, sample_surface
from afford.surface.meshes.nearest import NearestSurface
from schemas.grasp import GraspObject
from schemas.mesh import MeshParts, ObjectMesh

UNNAMED = "unnamed"
SURPLUS = 4
"""points drawn for each point kept, for even spacing"""


def grasp_object(mesh: ObjectMesh, parts: MeshParts, density_kg_m3: float, tolerance_m: float, hulls: int, hull_corners: int,
                 points: int, seed: int) -> GraspObject:  # fmt: skip
    """Build the object; ValueError when it has no faces, no volume, or more parts than hulls."""
    if not len(mesh.faces):
        raise ValueError(f"{mesh.name}: expected a mesh with faces, got an empty one; read or build it again")
    vertices, names, part = mesh.vertices.astype(np.float64), *_named(parts)
    solid = trimesh.Trimesh(vertices, mesh.faces, process=False)
    pieces = convex_decomposition(solid, part, tolerance_m, hulls)
    shapes = [simplified_corners(piece, hull_corners) for piece in pieces]
    mass, com, inertia = _mass([solid] if solid.is_volume else [trimesh.convex.convex_hull(s) for s in shapes], density_kg_m3)
    if not mass > 0:
        raise ValueError(f"{mesh.name}: expected a mesh with a volume, got {mass / density_kg_m3} m3; give it a thickness")
    place, face = _points(solid, points, seed)
    return GraspObject(
        name=mesh.name, category=mesh.category, parts=names, corners=np.concatenate(shapes),
        hull_start=np.cumsum([0, *map(len, shapes)]).astype(np.int32),
        hull_part=np.array([piece.part for piece in pieces], np.int16), mass_kg=mass, com_m=com, inertia_kgm2=inertia,
        closed=bool(solid.is_volume), points=place, normals=solid.face_normals[face].astype(np.float32),
        point_part=part[face].astype(np.int16), size_m=np.ptp(vertices, axis=0),
        stand_out_m=np.array([piece.stand_out_m for piece in pieces]))  # fmt: skip


def _named(parts: MeshParts) -> tuple[tuple[str, ...], np.ndarray]:
    """Return names of parts and the part of each face; faces without a part form a part of their own."""
    if (parts.part >= 0).all():
        return parts.names, parts.part
    return (*parts.names, UNNAMED), np.where(parts.part < 0, len(parts.names), parts.part)


def _mass(solids: Sequence[trimesh.Trimesh], density_kg_m3: float) -> tuple[float, np.ndarray, np.ndarray]:
    """Compute mass, centre of mass and the inertia about it, for several closed bodies together."""
    mass = np.array([body.volume * density_kg_m3 for body in solids])
    centres = np.array([body.center_mass for body in solids])
    com = mass @ centres / max(mass.sum(), 1e-30)
    arms = centres - com
    steiner = np.einsum("k,kij->ij", mass, np.eye(3) * (arms**2).sum(1)[:, None, None] - arms[:, :, None] * arms[:, None])
    inertia = sum((body.moment_inertia * density_kg_m3 for body in solids), np.zeros((3, 3))) + steiner
    return float(mass.sum()), com, 0.5 * (inertia + inertia.T)


def _points(solid: trimesh.Trimesh, count: int, seed: int) -> tuple[np.ndarray, np.ndarray]:
    drawn, face = sample_surface(solid.vertices, solid.faces, solid.area_faces, SURPLUS * count, np.random.default_rng(seed))
    kept = farthest_point_sampling(drawn, count)
    return drawn[kept], face[kept]


OFFSETS = (0.2, 0.35, 0.5, 0.65, 0.8)
"""cuts to try, as shares of the piece's extent"""
THIN_M = 2e-4
"""flatter pieces are thickened to this"""
RAYS = np.array([[0.44, 0.62, 0.65], [-0.71, 0.29, 0.64], [0.13, -0.83, -0.54]])
"""directions that are parallel to no edge of usual objects"""
PROBES = 200
"""points on a hull that are measured against the body"""
DIGITS = 9
EXACT_M = 1e-4
"""hull corners that stand out of the hull of the others by less are dropped"""


@dataclass(frozen=True, eq=False)
class Piece:
    """Triangles of one part and their convex hull."""

    part: int
    vertices: np.ndarray
    """(v, 3)"""
    faces: np.ndarray
    """(f, 3)"""
    hull: ConvexHull
    stand_out_m: float
    """95th percentile over the surface of the hull"""


def convex_decomposition(solid: trimesh.Trimesh, part: np.ndarray, tolerance_m: float, most: int) -> list[Piece]:
    """Decompose a mesh, whose faces (f,) have parts, into pieces ordered by part.

    Hulls stand out of the body by `tolerance_m` at most, unless there would be more than `most`. ValueError when the object has
    more parts than `most`.
    """
    present = np.unique(part)
    if len(present) > most:
        raise ValueError(f"object_solids.hulls: expected at least the {len(present)} parts of the object, got {most}")
    measure = _measure(solid)
    pieces = [_piece(int(p), solid.vertices, solid.faces[part == p], measure) for p in present]
    whole: set[int] = set()
    while len(pieces) < most:
        order = [k for k in range(len(pieces)) if pieces[k].stand_out_m > tolerance_m and id(pieces[k]) not in whole]
        if not order:
            break
        worst = max(order, key=lambda k: pieces[k].stand_out_m)
        halves = _cut(pieces[worst], measure)
        if halves:
            pieces[worst : worst + 1] = halves
        else:
            whole.add(id(pieces[worst]))
    return pieces


def simplified_corners(piece: Piece, most: int) -> np.ndarray:
    """Simplify a hull to at most `most` corners, (k, 3).

    Each next corner is the farthest from the hull of those before it. Results are rounded to a nanometre, because sums of linear
    algebra differ below that with memory alignment.
    """
    points = piece.hull.points[piece.hull.vertices]
    ends = [int(points[:, axis].argmin()) for axis in range(3)] + [int(points[:, axis].argmax()) for axis in range(3)]
    taken = list(dict.fromkeys((*ends, *_spread(points))))
    hull = ConvexHull(points[taken])
    while len(taken) < min(most, len(points)):
        out = (points @ hull.equations[:, :3].T + hull.equations[:, 3]).max(axis=1)
        if out.max() < EXACT_M:
            break
        taken.append(int(out.argmax()))
        hull = ConvexHull(points[taken])
    kept: np.ndarray = hull.points[hull.vertices].round(DIGITS) + 0.0
    return kept


def _spread(points: np.ndarray) -> list[int]:
    """Choose four corners that span a volume, so that the first hull has one."""
    a = int((points @ (1.0, 0.7, 0.4)).argmin())
    b = int(np.linalg.norm(points - points[a], axis=1).argmax())
    side = np.cross(points - points[a], points[b] - points[a])
    c = int(np.linalg.norm(side, axis=1).argmax())
    return [a, b, c, int(np.abs((points - points[a]) @ side[c]).argmax())]


def inside(solid: trimesh.Trimesh, points: np.ndarray) -> np.ndarray:
    """Test (n, 3) points for being inside a body, (n,) bool: two of three rays must cross the surface an odd number of times.

    trimesh's `contains` is not used, because it draws a direction from numpy's global random state.
    """
    odd = np.zeros(len(points), int)
    for direction in RAYS:
        _, ray = solid.ray.intersects_id(points, np.tile(direction, (len(points), 1)), multiple_hits=True)
        odd += np.bincount(ray, minlength=len(points)) % 2
    found: np.ndarray = odd >= 2
    return found


def _measure(solid: trimesh.Trimesh) -> Callable[[ConvexHull], float]:
    """Return a function that measures how far a hull stands out of a body: 95th percentile over the hull, 0 inside the body."""
    nearest = NearestSurface(solid.vertices, solid.faces)

    def stand_out_m(hull: ConvexHull) -> float:
        corner = hull.points[hull.simplices]
        area = np.linalg.norm(np.cross(corner[:, 1] - corner[:, 0], corner[:, 2] - corner[:, 0]), axis=1)
        probes = sample_surface(hull.points, hull.simplices, area, PROBES, np.random.default_rng(0))[0].astype(np.float64)
        away = np.where(inside(solid, probes), 0.0, nearest(probes)[2])
        return float(np.percentile(away, 95))

    return stand_out_m


def _piece(part: int, vertices: np.ndarray, faces: np.ndarray, measure: Callable[[ConvexHull], float]) -> Piece:
    used, index = np.unique(faces, return_inverse=True)
    own, faces = vertices[used].astype(np.float64), index.reshape(-1, 3)
    hull = ConvexHull(_thick(own))
    return Piece(part, own, faces, hull, measure(hull))


def _thick(points: np.ndarray) -> np.ndarray:
    """Return the points, doubled along the direction in which they are flat."""
    _, _, axes = np.linalg.svd(points - points.mean(0), full_matrices=len(points) < 3)
    heights = (points - points.mean(0)) @ axes[-1]
    if np.ptp(heights) > THIN_M:
        return points
    return np.concatenate([points - 0.5 * THIN_M * axes[-1], points + 0.5 * THIN_M * axes[-1]])


def _cut(piece: Piece, measure: Callable[[ConvexHull], float]) -> tuple[Piece, ...]:
    """Cut a piece in two where the hulls are smallest and roundest; () when no cut leaves two pieces."""
    own = np.linalg.svd(piece.vertices - piece.vertices.mean(0), full_matrices=False)[2]
    axes = np.concatenate([np.eye(3), own.round(DIGITS)])
    heights = piece.vertices @ axes.T
    tries = [(_bulk(piece, axis, low + share * (high - low)), k, share)
             for k, (axis, low, high) in enumerate(zip(axes, heights.min(0), heights.max(0), strict=True)) for share in OFFSETS
             if high - low > 4 * THIN_M]  # fmt: skip
    bulk, k, share = min(tries, default=(np.inf, 0, 0.0))
    if not np.isfinite(bulk):
        return ()
    origin = axes[k] * (heights[:, k].min() + share * np.ptp(heights[:, k]))
    sides = (slice_faces_plane(piece.vertices, piece.faces, sign * axes[k], origin) for sign in (1, -1))
    return tuple(_piece(piece.part, vertices, faces, measure) for vertices, faces, *_ in sides)


def _bulk(piece: Piece, axis: np.ndarray, offset: float) -> float:
    """Score a cut: the volume of each side's hull times its length, summed; infinite when a side is empty.

    Volume alone sees no gain in cutting a ring in two, which is the way to cut it in four.
    """
    height = piece.vertices @ axis - offset
    edges = np.concatenate([piece.faces[:, [0, 1]], piece.faces[:, [1, 2]], piece.faces[:, [2, 0]]])
    a, b = edges[(height[edges[:, 0]] < 0) & (height[edges[:, 1]] > 0)].T
    share = (height[a] / (height[a] - height[b]))[:, None]
    seam = piece.vertices[a] + share * (piece.vertices[b] - piece.vertices[a])
    sides = [np.concatenate([piece.vertices[keep], seam]) for keep in (height >= 0, height <= 0)]
    if min(map(len, sides)) < 4 or not len(seam):
        return float("inf")
    return float(sum(ConvexHull(_thick(side)).volume * np.linalg.norm(np.ptp(side, axis=0)) for side in sides))
