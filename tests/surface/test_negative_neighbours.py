"""Faces that nobody saw: between their neighbours, never beyond them, and those that were seen stay as they are."""

from __future__ import annotations

import numpy as np
import pytest
import trimesh

from afford.surface.negative.project import face_adjacency, harmonic_fill
from tests.helpers.made_meshes import ball


def strip(count: int) -> tuple[np.ndarray, np.ndarray]:
    """A straight ribbon of `count` equal triangles."""
    x = np.arange(count + 2)
    vertices = np.stack([x / 2, (x % 2).astype(float), 0 * x], -1).astype(np.float32)
    return vertices, np.stack([x[:-2], x[1:-1], x[2:]], -1).astype(np.int32)


def test_between_two_ends_values_run_straight() -> None:
    """Heat in a rod."""
    vertices, faces = strip(11)
    known = np.isin(np.arange(11), [0, 10])
    found = harmonic_fill(vertices, faces, known * np.linspace(0, 1, 11), known)
    assert found == pytest.approx(np.linspace(0, 1, 11), abs=1e-5)


def test_known_faces_stay_and_others_lie_between(seed: int = 0) -> None:
    """The maximum principle, on a ball with a third of the faces known."""
    made, rng = ball(0.1, 3), np.random.default_rng(seed)
    known, value = rng.random(len(made.faces)) < 0.3, rng.uniform(0.2, 0.7, len(made.faces)).astype(np.float32)
    found = harmonic_fill(made.vertices, made.faces, value, known)
    assert np.array_equal(found[known], value[known]) and found.min() >= 0.2 - 1e-6 and found.max() <= 0.7 + 1e-6
    rows = face_adjacency(made.vertices, made.faces)[~known]
    assert found[~known] == pytest.approx((rows @ found) / rows.sum(1), abs=1e-4)


def test_seams_do_not_part_and_gaps_do() -> None:
    """A surface whose triangles share no vertex is one piece; a second body takes the value of the nearest face."""
    vertices, faces = strip(5)
    apart = vertices[faces].reshape(-1, 3), np.arange(15, dtype=np.int32).reshape(-1, 3)
    known = np.isin(np.arange(5), [0])
    assert harmonic_fill(*apart, np.full(5, 0.9, np.float32), known) == pytest.approx([0.9] * 5)
    far = np.concatenate([vertices, vertices[:3] + np.float32([0, 9, 0])]), np.concatenate([faces, [[7, 8, 9]]]).astype(np.int32)
    ends = np.isin(np.arange(6), [0, 4])
    found = harmonic_fill(*far, np.float32([0.1, 0, 0, 0, 0.8, 0]), ends)
    assert found[5] == pytest.approx(found[:5][np.linalg.norm(vertices[faces].mean(1) - far[0][7:].mean(0), axis=1).argmin()])


def test_where_nothing_is_known_nothing_is_said() -> None:
    """Zeros; where all is known, the values."""
    made = ball(0.1, 1)
    value = np.linspace(0, 1, len(made.faces)).astype(np.float32)
    assert not harmonic_fill(made.vertices, made.faces, value, np.zeros(len(value), bool)).any()
    assert np.array_equal(harmonic_fill(made.vertices, made.faces, value, np.ones(len(value), bool)), value)


def test_every_edge_joins_two_faces() -> None:
    """Three neighbours for each face of a closed surface, and the relation is mutual."""
    made = trimesh.creation.box()
    graph = face_adjacency(made.vertices, made.faces)
    assert ((graph > 0).sum(1) == 3).all() and abs(graph - graph.T).max() < 1e-12
