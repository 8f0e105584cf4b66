"""Physics models of objects: convex decomposition, mass and inertia, surface points."""

from __future__ import annotations

from functools import cache

import numpy as np
import pytest
import trimesh
from scipy.spatial import ConvexHull

from afford.grasping.sim.grasp_object import convex_decomposition, simplified_corners
from afford.surface.meshes.nearest import NearestSurface
from schemas.grasp import GraspObject
from schemas.mesh import MeshParts, ObjectMesh, ObjectSpec
from stages.grasping import object_solids
from stages.synthetic import object_build
from tests.helpers.made_meshes import as_object

PARAMS = object_solids.Params(points=300)


@cache
def solids(category: str, params: object_solids.Params = PARAMS) -> tuple[ObjectMesh, MeshParts, GraspObject]:
    built = object_build.run(ObjectSpec(category, category, 3, "plain", "train"), object_build.Params(atlas_px=64))
    return built.mesh, built.parts, object_solids.run(built.mesh, built.parts, params)


def unlabelled(mesh: ObjectMesh) -> MeshParts:
    return MeshParts(mesh.name, (), np.full(len(mesh.faces), -1, np.int16))


@pytest.mark.parametrize("category", ["hammer", "knife", "mug"])
def test_hulls_cover_the_surface(category: str) -> None:
    """Corners of a part lie in a hull of that part, up to 2 mm of corner reduction."""
    mesh, parts, body = solids(category)
    assert body.parts == parts.names
    assert set(body.hull_part) == set(parts.part)
    assert len(body.hull_part) <= PARAMS.hulls
    assert np.diff(body.hull_start).max() <= PARAMS.hull_corners
    for part in range(len(parts.names)):
        spots = mesh.vertices[np.unique(mesh.faces[parts.part == part])]
        planes = [ConvexHull(hull).equations for hull, own in zip(body.hulls(), body.hull_part, strict=True) if own == part]
        outside = np.min([(spots @ p[:, :3].T + p[:, 3]).max(axis=1) for p in planes], axis=0)
        assert outside.max() < 0.002


def test_a_convex_body_is_one_hull() -> None:
    """A box of 4 x 6 x 10 cm is one hull of eight corners with the textbook inertia."""
    mesh = as_object(trimesh.creation.box((0.04, 0.06, 0.10)).subdivide())
    body = object_solids.run(mesh, unlabelled(mesh), PARAMS)
    assert body.parts == ("unnamed",)
    assert len(body.hull_part) == 1
    assert len(body.corners) == 8
    assert body.closed
    assert body.mass_kg == pytest.approx(0.04 * 0.06 * 0.10 * 700, rel=1e-5)
    assert np.diag(body.inertia_kgm2) == pytest.approx(body.mass_kg / 12 * np.array([0.0136, 0.0116, 0.0052]), rel=1e-5)


def test_decomposition_of_a_ring() -> None:
    """The pieces leave a rod of 80 % of the hole's radius free."""
    ring = trimesh.creation.annulus(0.04, 0.05, 0.02, sections=64)
    pieces = convex_decomposition(ring, np.zeros(len(ring.faces), int), 0.002, 24)
    assert 6 <= len(pieces) <= 24
    angle = np.linspace(0, 2 * np.pi, 40)
    rod = 0.032 * np.stack([np.cos(angle), np.sin(angle), 0 * angle], axis=1)
    for piece in pieces:
        planes = ConvexHull(simplified_corners(piece, 64)).equations
        assert (rod @ planes[:, :3].T + planes[:, 3]).max(axis=1).min() > 0


def test_surface_points() -> None:
    """Points lie on their faces, and every part has points."""
    mesh, parts, body = solids("hammer")
    face, _, away = NearestSurface(mesh.vertices, mesh.faces)(body.points.astype(float))
    assert away.max() < 1e-6
    assert np.linalg.norm(body.normals, axis=1) == pytest.approx(np.ones(300), abs=1e-5)
    assert (body.point_part == parts.part[face]).mean() > 0.98  # points on edges between parts belong to either
    assert set(body.point_part) == set(range(len(parts.names)))


def test_an_open_mesh() -> None:
    """A box without a lid has no volume; its mass is that of the hulls of its walls."""
    box = trimesh.creation.box((0.1, 0.1, 0.1))
    box.update_faces(box.face_normals[:, 2] < 0.5)
    mesh = as_object(box)
    body = object_solids.run(mesh, unlabelled(mesh), PARAMS)
    assert not body.closed
    assert 0 < body.mass_kg < 0.7
    assert np.linalg.eigvalsh(body.inertia_kgm2).min() > 0


def test_determinism() -> None:
    """Arrays agree to the bit."""
    one, two = solids("hammer")[2], solids.__wrapped__("hammer")[2]
    for name in ("corners", "hull_start", "hull_part", "inertia_kgm2", "points", "point_part", "stand_out_m"):
        assert np.array_equal(getattr(one, name), getattr(two, name)), name


def test_invalid_meshes_and_parameters() -> None:
    """Too few hulls for the parts, zero density, and an empty mesh are rejected."""
    with pytest.raises(ValueError, match="at least the 4 parts"):
        solids("hammer", object_solids.Params(hulls=2))
    with pytest.raises(ValueError, match="density_kg_m3"):
        solids("hammer", object_solids.Params(density_kg_m3=0))
    empty = ObjectMesh("nothing", "", np.zeros((0, 3), np.float32), np.zeros((0, 3), np.int32), np.zeros((0, 3, 2), np.float32),
                       np.zeros((1, 1, 3), np.uint8))  # fmt: skip
    with pytest.raises(ValueError, match="a mesh with faces"):
        object_solids.run(empty, unlabelled(empty), PARAMS)
