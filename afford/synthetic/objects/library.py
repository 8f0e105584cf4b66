"""Library of procedural objects: one closed mesh per object, with the part of every face.

The parts of a category are united by exact booleans (manifold3d), so the mesh has no inner faces. The texture is applied from
an independent random stream.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from manifold3d import Error, Manifold, OpType

from afford.synthetic.objects import cutting, household, tableware, vessels, workshop
from afford.synthetic.objects.solid_shapes import Solid
from afford.synthetic.objects.texture import texture_surface
from schemas.mesh import MeshParts, ObjectMesh, ObjectSpec, PartedMesh

SPECK_M3 = 1e-15
"""Largest volume of a flat speck that rounding leaves beside the body, m^3."""

SIMPLER_M = 2e-5
"""Surface displacement up to which slivers of the union are collapsed, metres."""

THIN_M = 2e-6
"""Minimum height of a triangle, metres."""


@dataclass(frozen=True, eq=False)
class LabelledMesh:
    """Closed mesh: vertices (v, 3) float64 in metres, faces (f, 3) int32, part (f,) int16 index into `names`."""

    vertices: np.ndarray
    faces: np.ndarray
    part: np.ndarray
    names: tuple[str, ...]


def unite_parts(solids: Sequence[Solid], edge_m: float, max_faces: int) -> LabelledMesh:
    """Unite solids into one mesh with no edge longer than `edge_m`, or coarser where that exceeds `max_faces`.

    The middle of the footprint becomes the origin and the lowest point z = 0. Each face belongs to one part. Raises ValueError
    when the solids do not form one body.
    """
    own = [(solid.part, solid.shape.as_original()) for solid in solids]
    whole = Manifold.batch_boolean([shape for _, shape in own], OpType.Add).simplify(SIMPLER_M)
    bodies = [body for body in whole.decompose() if abs(body.volume()) > SPECK_M3]
    if whole.status() != Error.NoError or len(bodies) != 1:
        found = f"{len(bodies)} ({whole.status().name})"
        raise ValueError(f"parts {', '.join(part for part, _ in own)}: expected one body, got {found}")
    names = tuple(dict.fromkeys(part for part, _ in own))
    number = {shape.original_id(): names.index(part) for part, shape in own}
    return _labelled(_refined(bodies[0], edge_m, max_faces), names, number)


def _refined(whole: Manifold, edge_m: float, max_faces: int) -> Manifold:
    """Split edges to a length, or to a longer one that keeps the number of faces below the limit."""
    if whole.num_tri() > max_faces:
        raise ValueError(f"object_build.max_faces: expected at least {whole.num_tri()} for this object, got {max_faces}")
    while (fine := _split(whole, edge_m)).num_tri() > max_faces:
        edge_m *= 1.12
    return fine


def _split(whole: Manifold, edge_m: float) -> Manifold:
    """Split edges to a length, in three rounds, since a round leaves edges inside faces that may be twice as long."""
    for _ in range(3):
        whole = whole.refine_to_length(edge_m)
    return whole


def _labelled(whole: Manifold, names: tuple[str, ...], number: dict[int, int]) -> LabelledMesh:
    mesh = whole.to_mesh64()
    points = np.array(mesh.vert_properties[:, :3], np.float64)
    low, high = points.min(axis=0), points.max(axis=0)
    points -= [(low[0] + high[0]) / 2, (low[1] + high[1]) / 2, low[2]]
    faces = np.array(mesh.tri_verts, np.int32)
    lengths = np.diff(np.asarray(mesh.run_index)) // 3
    part = np.repeat([number[run] for run in mesh.run_original_id], lengths).astype(np.int16)
    return LabelledMesh(_fix_slivers(points, faces), faces, part, names)


def _fix_slivers(points: np.ndarray, faces: np.ndarray) -> np.ndarray:
    """Move the apexes of sliver triangles by micrometres, in reproducible directions, until no sliver is left."""
    moved, rng = points.copy(), np.random.default_rng(0)
    for _ in range(100):
        height, top = _heights(moved, faces)
        low = np.unique(top[height < THIN_M])
        if not len(low):
            return moved
        moved[low] += 2 * THIN_M * rng.normal(size=(len(low), 3))
    raise ValueError(f"union of {len(faces)} faces: expected triangles {THIN_M} m high, got {len(low)} thinner ones")


def _heights(points: np.ndarray, faces: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return the height (f,) over the longest edge, in metres, and the vertex (f,) opposite to that edge."""
    tri = points[faces]
    double = np.linalg.norm(np.cross(tri[:, 1] - tri[:, 0], tri[:, 2] - tri[:, 0]), axis=1)
    edge = np.linalg.norm(np.roll(tri, -1, axis=1) - np.roll(tri, 1, axis=1), axis=2)
    return double / edge.max(axis=1), faces[np.arange(len(faces)), edge.argmax(axis=1)]


BUILDERS: dict[str, Callable[[np.random.Generator], tuple[Solid, ...]]] = {
    **cutting.BUILDERS,
    **workshop.BUILDERS,
    **vessels.BUILDERS,
    **household.BUILDERS,
    **tableware.BUILDERS,
}


def build_shape(category: str, seed: int, edge_m: float = 0.006, max_faces: int = 16_000) -> LabelledMesh:
    """Build the mesh of a category, with the part of every face. Raises ValueError with the known categories."""
    if category not in BUILDERS:
        raise ValueError(f"ObjectSpec.category: expected one of {', '.join(sorted(BUILDERS))}, got {category!r}")
    return unite_parts(BUILDERS[category](np.random.default_rng([seed, 0])), edge_m, max_faces)


def build_object(spec: ObjectSpec, edge_m: float, max_faces: int, atlas_px: int) -> PartedMesh:
    """Build the textured object of a spec. Its texture does not depend on its parts."""
    made = build_shape(spec.category, spec.seed, edge_m, max_faces)
    look = texture_surface(made.vertices, made.faces, spec.look, atlas_px, np.random.default_rng([spec.seed, 1]))
    mesh = ObjectMesh(spec.name, spec.category, look.vertices.astype(np.float32), look.faces, look.uv, look.texture)
    return PartedMesh(mesh, MeshParts(spec.name, made.names, made.part[look.source]))
