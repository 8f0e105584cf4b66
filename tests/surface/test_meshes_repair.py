"""Mesh repair: faults are fixed and counted, valid meshes stay, corner attributes are carried."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
import trimesh

from afford.common.errors import SourceError
from afford.render.solids import grid_faces
from afford.surface.meshes.charts import unwrap
from afford.surface.meshes.mend import read_repaired
from afford.surface.meshes.nearest import NearestSurface
from afford.surface.meshes.net import bodies, watertight
from afford.surface.meshes.orient import winding_number
from afford.surface.meshes.repair import Counts, repair
from afford.surface.meshes.texture import rasterise, sample_texture
from tests.helpers.mesh_files import LIMITS, box, checks, mended, places, planar_uv, tree, wishes, write_image, write_obj


def count(done: Counts, what: str) -> int:
    return dict(done).get(what, 0)


def volume(vertices: np.ndarray, faces: np.ndarray) -> float:
    return float(trimesh.Trimesh(vertices, faces, process=False).volume)


def test_valid_mesh_is_unchanged() -> None:
    """Check for empty counts and unchanged corners."""
    solid = box()
    net, done = repair(solid.vertices, solid.faces, LIMITS)
    assert done == () and np.array_equal(net.corner, np.arange(net.faces.size).reshape(-1, 3))
    assert np.array_equal(net.vertices[net.faces], solid.vertices[solid.faces])


@pytest.mark.parametrize("share", [0.0, 0.3, 1.0])
def test_flipped_faces_are_flipped_back(share: float) -> None:
    """Check some faces, and all of them."""
    solid = box()
    flip = np.random.default_rng(1).random(len(solid.faces)) < share
    faces = np.where(flip[:, None], solid.faces[:, ::-1], solid.faces)
    net, done = repair(solid.vertices, faces, LIMITS)
    assert count(done, "faces turned") == flip.sum() and watertight(net.faces)
    assert volume(net.vertices, net.faces) == pytest.approx(solid.volume)
    assert np.array_equal(faces.reshape(-1)[net.corner], net.faces)


def test_open_cup_inside_out_is_flipped() -> None:
    """Check a body with a large hole, which stays open."""
    solid = box()
    cup = solid.faces[solid.triangles_center[:, 2] < 0.019]
    net, done = repair(solid.vertices, cup[:, ::-1], LIMITS)
    assert count(done, "faces turned") == len(cup) and count(done, "holes left open") == 1
    assert (net.faces == cup).all(axis=1).any() or volume(net.vertices, net.faces) > 0


def test_cavities_and_separate_bodies() -> None:
    """Check that a hollow ball keeps its inner side, also when all of it is inside out."""
    outer, inner = trimesh.creation.icosphere(2, 0.1), trimesh.creation.icosphere(2, 0.05)
    beside = trimesh.creation.icosphere(2, 0.03)
    beside.apply_translation([0.3, 0, 0])
    vertices = np.concatenate([outer.vertices, inner.vertices, beside.vertices])
    shell = np.concatenate([outer.faces, inner.faces[:, ::-1] + len(outer.vertices)])
    third = beside.faces[:, ::-1] + len(outer.vertices) + len(inner.vertices)
    wanted = outer.volume - inner.volume + beside.volume
    for hollow, turned in ((shell, len(third)), (shell[:, ::-1], len(third) + len(shell))):
        net, done = repair(vertices, np.concatenate([hollow, third]), LIMITS)
        assert volume(net.vertices, net.faces) == pytest.approx(wanted) and count(done, "faces turned") == turned
        assert bodies(net.faces).max() == 2


def test_winding_numbers() -> None:
    """Check 1 inside and 0 outside."""
    solid = box()
    assert winding_number(np.array([0.01, 0.02, 0.003]), solid.vertices, solid.faces) == pytest.approx(1)
    assert winding_number(np.array([0.3, 0.0, 0.0]), solid.vertices, solid.faces) == pytest.approx(0, abs=1e-12)


def test_repeated_vertices_faces_and_dust_are_removed() -> None:
    """Check a triangle soup with a repeated face, an empty one and a speck."""
    solid = box()
    soup = solid.triangles.reshape(-1, 3)
    faces = np.arange(len(soup)).reshape(-1, 3)
    speck = np.array([[1, 1, 1], [1.0002, 1, 1], [1, 1.0002, 1]])
    faces = np.concatenate([faces, faces[:1, [2, 1, 0]], faces[:1, [0, 0, 1]], [[len(soup), len(soup) + 1, len(soup) + 2]]])
    net, done = repair(np.concatenate([soup, speck]), faces, LIMITS)
    assert len(net.faces) == len(solid.faces) and len(net.vertices) == len(solid.vertices) and watertight(net.faces)
    assert done == (("vertices merged", len(soup) - len(solid.vertices)), ("empty faces dropped", 1), ("repeated faces dropped", 1),
                    ("faces of dust dropped", 1))


def test_small_holes_are_filled() -> None:
    """Check a missing face and a missing ring; attributes come from neighbours, new faces look outwards."""
    solid = trimesh.creation.icosphere(3, 0.1)
    ring = (solid.faces == solid.faces[500, 0]).any(axis=1)
    ring[7] = True
    left = solid.faces[~ring]
    net, done = repair(solid.vertices, left, LIMITS)
    assert done == (("holes filled", 2),) and watertight(net.faces)
    assert volume(net.vertices, net.faces) == pytest.approx(solid.volume, rel=0.01)
    new = np.arange(len(net.faces)) >= len(left)
    gap = np.linalg.norm(net.vertices[net.faces[new]] - solid.vertices[left.reshape(-1)[net.corner[new]]], axis=2)
    assert gap[:, :2].max() == 0 and gap.max() < 0.03


def test_moebius_band_is_reported() -> None:
    """Check a surface without an outside."""
    turn = np.linspace(0, 2 * np.pi, 41)[:-1]
    across = np.stack([np.cos(turn / 2) * np.cos(turn), np.cos(turn / 2) * np.sin(turn), np.sin(turn / 2)], -1) * 0.02
    middle = np.stack([np.cos(turn), np.sin(turn), 0 * turn], -1) * 0.1
    vertices = np.concatenate([middle + across, middle - across])
    k, n = np.arange(40), np.roll(np.arange(40), -1)
    a, b = np.where(n == 0, 40, n), np.where(n == 0, 0, n + 40)
    _, done = repair(vertices, np.concatenate([np.stack([k, k + 40, a], 1), np.stack([k + 40, b, a], 1)]), LIMITS)
    assert count(done, "edges left twisted") > 0


def test_texture_survives_flipping_and_merging(tmp_path: Path) -> None:
    """Check a soup with half of its faces flipped against the file, at random points."""
    solid, image = box(), checks()
    uv = planar_uv(solid.vertices, solid.faces)
    soup, faces = solid.triangles.reshape(-1, 3), np.arange(3 * len(solid.faces)).reshape(-1, 3)
    flip = np.arange(len(faces)) % 2 == 0
    write_image(tmp_path / "look.png", image)
    (tmp_path / "m.mtl").write_text("newmtl a\nmap_Kd look.png\n")
    turned, coords = np.where(flip[:, None], faces[:, ::-1], faces), np.where(flip[:, None, None], uv[:, ::-1], uv)
    write_obj(tmp_path / "thing.obj", soup, turned, coords, "mtllib m.mtl\nusemtl a")
    found = mended(tmp_path)
    assert found.report.watertight and np.array_equal(found.mesh.texture, image)
    face, bary, points = places(solid.vertices, solid.faces)
    wanted = sample_texture(image, np.einsum("nk,nkc->nc", bary, uv[face])).astype(int)
    place, there, _ = NearestSurface(found.mesh.vertices, found.mesh.faces)(points)
    seen = sample_texture(found.mesh.texture, np.einsum("nk,nkc->nc", there, found.mesh.uv[place])).astype(int)
    inside = np.abs(points[:, 2]) > 0.0199
    assert np.abs(seen - wanted)[inside].max() <= 1


def test_simplified_mesh_is_close_in_shape_and_colour(tmp_path: Path) -> None:
    """Check position, colour, reported deviation and determinism."""
    ball, image = trimesh.creation.icosphere(4, 0.1), checks(128)
    uv = planar_uv(ball.vertices, ball.faces)
    write_image(tmp_path / "look.png", image)
    (tmp_path / "m.mtl").write_text("newmtl a\nmap_Kd look.png\n")
    write_obj(tmp_path / "ball.obj", ball.vertices, ball.faces, uv, "mtllib m.mtl\nusemtl a")
    found = mended(tmp_path, faces=1500, texture_px=256)
    assert len(found.mesh.faces) <= 1650 and 0 < found.report.deviation_m < 0.001
    face, bary, points = places(found.mesh.vertices.astype(float), found.mesh.faces)
    seen = sample_texture(found.mesh.texture, np.einsum("nk,nkc->nc", bary, found.mesh.uv[face])).astype(int)
    old, there, _ = NearestSurface(ball.vertices, ball.faces)(points)
    wanted = sample_texture(image, np.einsum("nk,nkc->nc", there, uv[old])).astype(int)
    assert np.abs(seen - wanted).mean() < 2
    again = mended(tmp_path, faces=1500, texture_px=256)
    assert again.mesh.texture.tobytes() == found.mesh.texture.tobytes() and again.mesh.faces.tobytes() == found.mesh.faces.tobytes()


@pytest.mark.parametrize("size_m", [1e-3, 0.1, 10.0])
def test_nearest_points_are_exact_at_every_size(size_m: float) -> None:
    """Check points on fine triangles, and points at a known distance."""
    ball = trimesh.creation.icosphere(5, size_m)
    face, _, points = places(ball.vertices, ball.faces)
    off = points + 1e-3 * size_m * ball.face_normals[face]
    nearest = NearestSurface(ball.vertices, ball.faces)
    assert nearest(points)[2].max() < 1e-9 * size_m
    found, there, away = nearest(off)
    assert away == pytest.approx(1e-3 * size_m, rel=1e-2)
    assert np.abs(np.einsum("nk,nkc->nc", there, ball.triangles[found]) - points).max() < 1e-4 * size_m


def test_loose_triangles_are_not_simplified(tmp_path: Path) -> None:
    """Check loose triangles, of which none can be removed."""
    rng = np.random.default_rng(2)
    corners = rng.random((2000, 1, 3)) + rng.normal(0, 0.02, (2000, 3, 3))
    write_obj(tmp_path / "dust.obj", corners.reshape(-1, 3), np.arange(6000).reshape(-1, 3))
    with pytest.raises(SourceError, match=r"dust\.obj: expected a surface that 100 faces can show"):
        read_repaired(tree(tmp_path), wishes(faces=100))


def test_charts_do_not_overlap() -> None:
    """Check a spiral ramp above itself: no texel belongs to two distant points."""
    turn, radius = np.meshgrid(np.linspace(0, 6 * np.pi, 200), np.linspace(0.02, 0.05, 12), indexing="ij")
    vertices = np.stack([radius * np.cos(turn), radius * np.sin(turn), 0.002 * turn], -1).reshape(-1, 3)
    faces = grid_faces(*turn.shape).astype(np.int64)
    uv = unwrap(vertices, faces, 512)
    owner, bary = rasterise(uv.astype(float), 512)
    column, row = np.floor(uv[..., 0].mean(axis=1) * 512).astype(int), np.floor((1 - uv[..., 1].mean(axis=1)) * 512).astype(int)
    there = np.einsum("nk,nkc->nc", bary[row, column], vertices[faces[owner[row, column]]])
    gap = np.linalg.norm(there - vertices[faces].mean(axis=1), axis=1)
    assert (owner[row, column] >= 0).all() and gap.max() < 0.003 and uv.min() >= 0 and uv.max() <= 1
