"""Surface regions: creases separate, the tree contains all regions, and every face is in one."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
import trimesh

from afford.surface.face_features import Borders, BorderWeights, FaceFeatures, face_colours, shared_edges
from afford.surface.proposals.nms import nms
from afford.surface.proposals.regions import RegionTree, merge_regions, oversegment
from schemas.mesh import ObjectMesh
from tests.helpers.made_meshes import as_object, ball, cut_up, shell


def dumbbell() -> trimesh.Trimesh:
    """Build a stick of 1 cm with a block of 4 cm at one end."""
    block = trimesh.creation.box((0.04, 0.04, 0.04), transform=trimesh.transformations.translation_matrix((0, 0.1, 0)))
    return cut_up(trimesh.boolean.union([trimesh.creation.box((0.01, 0.2, 0.01)), block]), 0.008)


def tree_of(thing: ObjectMesh, scale: float = 0.0003, least: float = 0.002) -> RegionTree:
    features = FaceFeatures.of(thing)
    borders = Borders.of(thing.vertices, thing.faces, features, BorderWeights())
    return merge_regions(oversegment(borders, features.area, scale, least), borders, features)


def best_overlap(tree: RegionTree, truth: np.ndarray, area: np.ndarray) -> float:
    """Return the IoU by area of the best node for a set of faces."""
    nodes = tree.members()[:, tree.leaf]
    return float(max((area[n & truth].sum() / area[n | truth].sum()) for n in nodes))


def test_concave_crease_separates_block_and_stick() -> None:
    """Check that one node is the block and another the stick, both persistent."""
    made = dumbbell()
    tree = tree_of(as_object(made))
    block = made.triangles_center[:, 1] > 0.0799
    for truth in (block, ~block):
        assert best_overlap(tree, truth, made.area_faces) > 0.97
    nodes = tree.members()[:, tree.leaf]
    like = [made.area_faces[n & block].sum() / made.area_faces[n | block].sum() for n in nodes]
    assert tree.persistence[int(np.argmax(like))] > 0.3


def test_colour_separates_equal_shapes() -> None:
    """Check a ball painted in two halves."""
    made = ball(0.05, 4)
    upper = made.triangles_center[:, 2] > 0
    texture = np.zeros((2, 2, 3), np.uint8)
    texture[:, 1] = 255
    uv = np.where(upper[:, None, None], 0.75, 0.25) * np.ones((1, 3, 2))
    tree = tree_of(replace(as_object(made), uv=uv.astype(np.float32), texture=texture))
    assert best_overlap(tree, upper, made.area_faces) > 0.99


def test_tree_contains_every_region_once() -> None:
    """Check disjoint leaves, merges of two children, the root, and shares."""
    thing = as_object(dumbbell())
    tree = tree_of(thing)
    nodes, regions = tree.members(), len(tree.persistence) - len(tree.children)
    assert set(tree.leaf) == set(range(regions)) and nodes[-1].all() and tree.share[-1] == pytest.approx(1)
    for n, (a, b) in enumerate(tree.children, regions):
        assert not (nodes[a] & nodes[b]).any() and tree.share[n] == pytest.approx(tree.share[a] + tree.share[b])
    assert (tree.persistence >= 0).all() and (tree.persistence <= 1).all() and len(tree.children) == regions - 1


def test_separate_pieces_are_joined_last() -> None:
    """Check a ball in a ball."""
    made = shell()
    tree = tree_of(as_object(made))
    inner = np.linalg.norm(made.triangles_center, axis=1) < 0.07
    assert best_overlap(tree, inner, made.area_faces) == best_overlap(tree, ~inner, made.area_faces) == 1


def test_regions_have_a_minimum_size() -> None:
    """Check scale and least share."""
    thing = as_object(dumbbell())
    features = FaceFeatures.of(thing)
    borders = Borders.of(thing.vertices, thing.faces, features, BorderWeights())
    fine, coarse = (oversegment(borders, features.area, scale, 0.01) for scale in (1e-4, 1e-1))
    assert fine.max() >= coarse.max()
    assert np.bincount(fine, features.area).min() >= 0.01 * features.area.sum()


def test_shape_diameter() -> None:
    """Check a ball and a plate."""
    ball_thick = FaceFeatures.of(as_object(ball(0.05, 4))).thickness
    assert np.abs(ball_thick / 0.1 - np.cos(np.radians(30))).max() < 0.03
    plate = cut_up(trimesh.creation.box((0.1, 0.1, 0.004)), 0.01)
    inside = np.abs(plate.triangles_center[:, :2]).max(1) < 0.04
    assert FaceFeatures.of(as_object(plate)).thickness[inside] == pytest.approx(0.004 / np.cos(np.radians(30)), rel=0.02)


def test_face_colours_sample_the_texture() -> None:
    """Check that v runs upwards and coordinates repeat."""
    thing = as_object(ball(0.05, 1))
    texture = np.zeros((4, 4, 3), np.uint8)
    texture[:2] = 255
    for v, light in ((0.75, 100), (0.25, 0), (1.75, 100)):
        uv = np.full((len(thing.faces), 3, 2), v, np.float32)
        assert face_colours(replace(thing, uv=uv, texture=texture))[:, 0] == pytest.approx(light, abs=0.5)


def test_edges_and_lengths_of_a_closed_surface() -> None:
    """Check one and a half edges for each face, and their lengths."""
    made = ball(0.05, 2)
    pair, length = shared_edges(made.vertices, made.faces)
    assert len(pair) == 1.5 * len(made.faces) and (pair[:, 0] != pair[:, 1]).all()
    assert np.sort(length) == pytest.approx(np.sort(made.edges_unique_length), rel=1e-6)


def test_nms_keeps_the_better_mask() -> None:
    """Check IoU, the largest number, and empty masks."""
    masks = np.zeros((4, 10), bool)
    masks[0, :8], masks[1, :7], masks[2, 5:] = True, True, True
    quality = np.float32([0.5, 0.9, 0.1, 1.0])
    assert nms(masks, quality, 0.7, 9).tolist() == [1, 2]
    assert nms(masks, quality, 0.9, 9).tolist() == [1, 0, 2] and nms(masks, quality, 0.9, 1).tolist() == [1]
    assert not len(nms(np.zeros((0, 3, 3), bool), np.zeros(0), 0.7, 5))
