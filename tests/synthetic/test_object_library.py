"""Procedural objects: closed, labelled meshes of household size, deterministic in their seed."""

from __future__ import annotations

import functools

import numpy as np
import pytest
import trimesh

from afford.synthetic.objects.library import BUILDERS, LabelledMesh, build_shape, unite_parts
from afford.synthetic.objects.solid_shapes import OVERLAP_M, Solid, block, closed, d_grip, loft, plate, ring_grip, t_grip, wire
from afford.synthetic.objects.texture import cut_by_level
from afford.synthetic.splits import TRAINED_CATEGORIES, UNSEEN_CATEGORIES

ALONG_Y = ("knife", "cleaver", "scissors", "saw", "chisel", "razor", "hammer", "axe", "screwdriver", "soldering_iron", "trowel",
           "pan", "ladle", "iron", "brush", "spatula", "fork", "pliers", "wrench", "shovel", "pizza_cutter", "rolling_pin",
           "toothbrush", "flashlight")  # fmt: skip
"""Categories that are longest along y."""
BOTH_SIDES = ("pot", "kettle", "teapot", "iron", "drill", "rolling_pin", "wine_glass")
"""Categories whose handle may be above, below, on both sides or in the middle."""
HELD = {"spray_bottle": "neck", "flashlight": "body", "wine_glass": "stem"}
"""Held part of categories without a handle."""
SEEDS = (1, 2)


@functools.cache
def made(category: str, seed: int) -> LabelledMesh:
    """Build a coarse mesh once."""
    return build_shape(category, seed, edge_m=0.02)


def areas(thing: LabelledMesh) -> np.ndarray:
    tri = thing.vertices.astype(np.float32)[thing.faces].astype(float)
    return np.linalg.norm(np.cross(tri[:, 1] - tri[:, 0], tri[:, 2] - tri[:, 0]), axis=1) / 2


@pytest.mark.parametrize("category", sorted(BUILDERS))
def test_object_is_one_closed_labelled_mesh_of_household_size(category: str) -> None:
    """The mesh is watertight and oriented outwards, is one body without inner shells, and rests on z = 0.

    Every face has a part, and every part has a surface.
    """
    for seed in SEEDS:
        thing = made(category, seed)
        mesh = trimesh.Trimesh(thing.vertices, thing.faces, process=False)
        assert mesh.is_watertight and mesh.is_winding_consistent and mesh.volume > 0
        assert mesh.body_count == 1
        assert areas(thing).min() > 0
        assert thing.part.shape == (len(thing.faces),) and thing.part.min() >= 0
        shares = np.bincount(thing.part, areas(thing), len(thing.names)) / areas(thing).sum()
        assert shares.min() > 0.004, dict(zip(thing.names, shares, strict=True))
        low, high = thing.vertices.min(axis=0), thing.vertices.max(axis=0)
        np.testing.assert_allclose((*(low + high)[:2], low[2]), 0, atol=1e-9)
        assert 0.02 < (high - low).max() <= (1.1 if category == "shovel" else 0.6)


@pytest.mark.parametrize("category", sorted(BUILDERS))
def test_parts_depend_on_the_category_and_handles_point_to_minus_y(category: str) -> None:
    """Another seed gives other shapes of the same parts; the held part is towards -y of the whole, or on both sides of it."""
    first, *others = (made(category, seed) for seed in SEEDS)
    for thing in others:
        assert thing.names == first.names
        assert thing.vertices.shape != first.vertices.shape or not np.allclose(thing.vertices, first.vertices)
    for thing in (first, *others):
        size = np.ptp(thing.vertices, axis=0)
        assert category not in ALONG_Y or size.argmax() == 1, size
        held = HELD.get(category, "handle")
        middle = thing.vertices[thing.faces].mean(axis=1)[thing.part == thing.names.index(held), 1].mean()
        assert middle < (0.02 if category in BOTH_SIDES else -0.005), middle


@pytest.mark.parametrize("category", ["knife", "kettle", "brush"])
def test_same_seed_gives_the_same_bytes(category: str) -> None:
    """The bytes are equal also after other objects were built."""
    again = build_shape(category, 1, edge_m=0.02)
    for name in ("vertices", "faces", "part"):
        assert getattr(again, name).tobytes() == getattr(made(category, 1), name).tobytes(), name


def test_edge_length_and_face_limit() -> None:
    """Edges are at most 6 mm (plus micrometres), unless that exceeds the face limit."""
    fine = build_shape("knife", 1, edge_m=0.006)
    tri = fine.vertices[fine.faces]
    assert np.linalg.norm(tri - np.roll(tri, 1, axis=1), axis=2).max() < 0.00605
    assert len(build_shape("pot", 1, edge_m=0.006, max_faces=9000).faces) <= 9000
    with pytest.raises(ValueError, match=r"max_faces: expected at least \d+ for this object, got 10"):
        build_shape("pot", 1, edge_m=0.006, max_faces=10)


def test_union_keeps_the_part_of_each_face() -> None:
    """The union of two crossing boxes has the surface of both without the inside, each face labelled with its box."""
    across, along = block((0.1, 0.02, 0.02), bevel=0), block((0.02, 0.1, 0.02), (0, 0, 0.005), bevel=0)
    thing = unite_parts((Solid("a", across), Solid("b", along)), 1.0, 999)
    mesh = trimesh.Trimesh(thing.vertices, thing.faces, process=False)
    assert mesh.volume == pytest.approx(2 * 0.1 * 0.02 * 0.02 - 0.02 * 0.02 * 0.015, rel=1e-6)
    middle = thing.vertices[thing.faces].mean(axis=1)
    assert (thing.part[np.abs(middle[:, 0]) > 0.0101] == thing.names.index("a")).all()
    assert (thing.part[np.abs(middle[:, 1]) > 0.0101] == thing.names.index("b")).all()


def test_disjoint_parts_are_refused() -> None:
    """An object must be one body."""
    apart = (Solid("a", block((0.01, 0.01, 0.01))), Solid("b", block((0.01, 0.01, 0.01), (0.05, 0, 0))))
    with pytest.raises(ValueError, match="parts a, b: expected one body, got 2"):
        unite_parts(apart, 0.01, 999)


def test_loft_is_closed_and_oriented_outwards() -> None:
    """Rings in either order give the same volume; an open surface is refused."""
    square = np.array([(-1, -1, 0), (1, -1, 0), (1, 1, 0), (-1, 1, 0)]) * 0.01
    rings = np.stack([square, square + [0, 0, 0.02]])
    assert loft(rings).volume() == pytest.approx(8e-6) == loft(rings[::-1]).volume()
    with pytest.raises(ValueError, match="expected a closed surface"):
        closed(np.eye(3), np.array([[0, 1, 2]]))


def test_volume_of_a_curved_plate() -> None:
    """The volume is exact for any height function; both ends are closed."""
    x, y = np.meshgrid(np.linspace(-0.05, 0.05, 21), np.linspace(0, 0.1, 11))
    for height in (0 * x, 20 * x**2, 0.01 * np.sin(60 * y)):
        assert plate(np.stack([x, y, height], -1), 0.004).volume() == pytest.approx(0.1 * 0.1 * 0.004, rel=1e-6)


def test_wire_keeps_its_ends_and_rounds_its_corners() -> None:
    """Both ends stay in place; the wire is slightly shorter than its line segments, and one body."""
    shape = wire([(0, 0, 0), (0.1, 0, 0), (0.1, 0.1, 0)], 0.003, 0.02, sides=48)
    low_x, low_y, low_z, high_x, high_y, high_z = shape.bounding_box()
    np.testing.assert_allclose((low_x, high_y, low_z, high_z), (0, 0.1, -0.003, 0.003), atol=1e-4)
    length = shape.volume() / (np.pi * 0.003**2)
    assert 0.18 < length < 0.2 and len(shape.decompose()) == 1 and high_x < 0.1031 and low_y > -0.0031


@pytest.mark.parametrize("seed", range(5))
def test_handles_are_one_body_that_overlaps_the_tool(seed: int) -> None:
    """T, D and ring handles end just past y = 0 and extend towards -y; D and ring handles have a hole."""
    rng = np.random.default_rng(seed)
    for grip, holes in ((t_grip(rng, 0.12, 0.014), 0), (d_grip(rng, 0.12, 0.12, 0.014), 1), (ring_grip(rng, 0.02, 0.005), 1)):
        assert len(grip.decompose()) == 1 and grip.genus() == holes
        assert OVERLAP_M <= round(grip.bounding_box()[4], 6) <= 2 * OVERLAP_M


def test_specks_without_volume_are_ignored() -> None:
    """Rounding leaves, with this seed, four faces of 1e-26 m^3 where the socket of a shovel leaves its blade."""
    thing = build_shape("shovel", 29, edge_m=0.02)
    assert trimesh.Trimesh(thing.vertices, thing.faces, process=False).body_count == 1


def test_level_set_cut_keeps_the_surface_and_separates_its_sides() -> None:
    """A closed surface stays closed with the same area; every piece lies on its side and keeps its source face."""
    ball = trimesh.creation.icosphere(2)
    level = ball.vertices[:, 2] - 0.3
    points, faces, source, side = cut_by_level(ball.vertices, ball.faces, level)
    after = trimesh.Trimesh(points, faces, process=False)
    assert after.is_watertight and after.is_winding_consistent
    assert after.area == pytest.approx(ball.area) and after.volume == pytest.approx(ball.volume)
    np.testing.assert_allclose(np.bincount(source, after.area_faces), ball.area_faces, rtol=1e-9)
    assert (after.triangles_center[side == 1][:, 2] > 0.25).all() and (after.triangles_center[side == 0][:, 2] < 0.35).all()
    assert 0 < side.mean() < 1


def test_categories_are_either_trained_or_unseen() -> None:
    """The two sets are disjoint and cover the library."""
    assert {*TRAINED_CATEGORIES, *UNSEEN_CATEGORIES} == set(BUILDERS) and not {*TRAINED_CATEGORIES} & {*UNSEEN_CATEGORIES}
