"""Project scored part masks on the faces of a mesh: negative probability of faces, N_t, distance field.

1. `part_posterior`: the parts of an object compete for each candidate mask. A candidate that fits the blade better than the handle
is blade, even if neither fits well. Every part exists somewhere, so a part that fits nothing well gets more weight where it fits
best.

2. `pixel_probability`: weighted mean of the candidates that cover a pixel. Certain and small candidates weigh most, so that a
switch is not outvoted by the body it belongs to; candidates that fit no part have no weight.

3. `project_to_faces`: the pixels vote on the exact face behind them, weighted by the cosine of incidence. Faces without a vote take
the harmonic interpolation of their neighbours.

4. `label_surface`: faces above a threshold are negative. N_t is a farthest point sample of them, and a grid contains the distance
to N_t.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components
from scipy.sparse.linalg import spsolve
from scipy.spatial import cKDTree

from afford.common.geometry import farthest_point_sampling, sample_surface
from afford.render.views.surface import face_areas
from afford.surface.face_features import shared_edges
from schemas.mesh import ObjectMesh, ObjectViews
from schemas.surface import (
    DistanceField,
    NegativeAffordance,
    NegativeAffordances,
    PartCandidates,
    PartDescription,
    PartDescriptions,
    PartScores,
)


def vote_on_faces(face: np.ndarray, value: np.ndarray, weight: np.ndarray, faces: int) -> tuple[np.ndarray, np.ndarray]:
    """Compute the weighted mean (f,) float32 of the pixels of each face, and the sum of their weights (f,).

    `face` (n, h, w) int32, -1 for background; `value` (n, h, w) 0..1; `weight` (n, h, w), not negative. Faces without weight get 0.
    """
    on = face >= 0
    index, w = face[on], weight[on].astype(np.float64)
    total = np.bincount(index, w, faces)
    weighted = np.bincount(index, w * value[on], faces)
    return np.divide(weighted, total, out=np.zeros(faces), where=total > 0).astype(np.float32), total.astype(np.float32)


def cos_incidence(mesh: ObjectMesh, views: ObjectViews) -> np.ndarray:
    """Compute the cosine of the angle between line of sight and face normal at each pixel: (n, h, w) float32.

    0 for background. Back faces (of an open surface) count as front faces.
    """
    normal = face_areas(mesh.vertices[mesh.faces].astype(np.float64))[1]
    out = np.zeros(views.face.shape, np.float32)
    for one, face, K, T in zip(out, views.face, views.K, views.T_obj_cam, strict=True):
        y, x = np.nonzero(face >= 0)
        sight = np.stack([(x - K[0, 2]) / K[0, 0], (y - K[1, 2]) / K[1, 1], np.ones(len(x))], 1) @ T[:3, :3].T
        sight /= np.linalg.norm(sight, axis=1, keepdims=True)
        one[y, x] = np.abs((sight * normal[face[y, x]]).sum(1))
    return out


SHARPEN = 2.0
"""exponent of the fits before the parts compete"""
LIFTED = 0.98
"""quantile of the fits of a part over the candidates of an object that counts as its best fit"""
LEAST_BEST = 0.05
"""smallest best fit by which the fits of a part are normalised"""
REJECTED = 0.1
"""a candidate whose share of every part is below this has no weight"""
UNSURE = 0.02
"""weight of a candidate that fits all parts equally"""


def pixel_probability(candidates: PartCandidates, scores: PartScores, description: PartDescription,
           face: np.ndarray) -> tuple[np.ndarray, np.ndarray]:  # fmt: skip
    """Compute the probability (n, h, w) float32 that a pixel is negative, and the weight (n, h, w) of its candidates.

    `face` (n, h, w) is the face of each pixel, -1 for background. Pixels without a candidate have weight 0.
    """
    value, counts = part_posterior(scores, description)
    shown = (face >= 0).sum((1, 2))[candidates.view]
    size = candidates.masks.sum((1, 2)) / np.maximum(shown, 1)
    return weighted_pixel_mean(candidates, value, (counts / np.maximum(size, 1e-6)).astype(np.float32), face.shape)


def weighted_pixel_mean(candidates: PartCandidates, value: np.ndarray, weight: np.ndarray,
           shape: tuple[int, ...]) -> tuple[np.ndarray, np.ndarray]:  # fmt: skip
    """Average the values (m,) of candidates at every pixel: (n, h, w) float32, and the sum of the weights (m,)."""
    mean, total = np.zeros(shape, np.float32), np.zeros(shape, np.float32)
    for view, mask, v, w in zip(candidates.view, candidates.masks, value, weight, strict=True):
        mean[view][mask] += v * w
        total[view][mask] += w
    return np.divide(mean, total, out=mean, where=total > 0), total


def split_by_task(descriptions: PartDescriptions, scores: PartScores) -> Iterator[tuple[PartDescription, PartScores]]:
    """Yield every description with its own columns of the scores."""
    at = 0
    for one in descriptions.descriptions:
        mine = slice(at, at := at + len(one.notes))
        yield one, PartScores(scores.name, scores.share[:, mine], scores.overlap[:, mine])


def part_posterior(scores: PartScores, description: PartDescription) -> tuple[np.ndarray, np.ndarray]:
    """Compute the negative share (m,) float32 of each candidate, and the weight (m,) of the candidate."""
    count = len(description.notes)
    if not count:
        return np.zeros(len(scores.share), np.float32), np.zeros(len(scores.share), np.float32)
    fit = _unnormalised_posterior(scores)
    share = fit / np.maximum(fit.sum(1, keepdims=True), 1e-12)
    value = share[:, [note.role == "negative" for note in description.notes]].sum(1)
    sure = np.ones(len(share)) if count == 1 else (share.max(1) - 1 / count) / (1 - 1 / count)
    counts = np.where(scores.share.max(1) > REJECTED, UNSURE + sure, 0)
    return value.astype(np.float32), counts.astype(np.float32)


def _unnormalised_posterior(scores: PartScores) -> np.ndarray:
    """Compute the fit (m, k) float64 of candidates and parts, from share and overlap, normalised by the best fit."""
    claim = scores.share.astype(np.float64) * np.sqrt(scores.overlap)
    best = np.quantile(claim, LIFTED, axis=0) if len(claim) else np.ones(claim.shape[1])
    return np.asarray((claim / np.sqrt(np.maximum(best, LEAST_BEST))) ** SHARPEN)


def harmonic_fill(vertices: np.ndarray, faces: np.ndarray, value: np.ndarray, known: np.ndarray) -> np.ndarray:
    """Fill unknown faces by the harmonic function of the known ones: (f,) float32.

    `known` (f,) bool. Components without a known face take the value of the nearest known face. All values are 0 when no face is
    known.
    """
    if known.all() or not known.any():
        return np.where(known, value, 0).astype(np.float32)
    graph = face_adjacency(vertices, faces)
    piece = connected_components(graph, directed=False)[1]
    reached = np.isin(piece, np.unique(piece[known]))
    out = np.where(known, value, 0.0).astype(np.float64)
    free = np.flatnonzero(reached & ~known)
    if len(free):
        rows = graph[free]
        degree = rows.sum(1)
        system = coo_array((degree, (np.arange(len(free)), np.arange(len(free)))), shape=(len(free),) * 2).tocsr() - rows[:, free]
        out[free] = spsolve(system.tocsc(), rows[:, np.flatnonzero(known)] @ out[known])
    middle = vertices[faces].mean(1)
    lost = np.flatnonzero(~reached)
    out[lost] = out[reached][cKDTree(middle[reached]).query(middle[lost])[1]]
    return out.clip(0, 1).astype(np.float32)


def face_adjacency(vertices: np.ndarray, faces: np.ndarray):  # type: ignore[no-untyped-def]  # scipy has no types
    """Build the sparse symmetric matrix (f, f) of faces that share an edge, weighted by relative edge length."""
    (a, b), length = (found.T for found in shared_edges(vertices, faces))
    weight = np.maximum(length / max(float(length.mean()) if len(length) else 1.0, 1e-30), 1e-6)
    both = coo_array((np.tile(weight, 2), (np.concatenate([a, b]), np.concatenate([b, a]))), shape=(len(faces),) * 2)
    return both.tocsr()


def distance_to_points(N_t: np.ndarray, points: np.ndarray) -> np.ndarray:
    """Compute the distance (n,) float64 in metres from points (n, 3) to N_t (k, 3); infinite for an empty N_t."""
    return np.asarray(cKDTree(N_t).query(points)[0]) if len(N_t) else np.full(len(points), np.inf)


def distance_field(name: str, N_t: np.ndarray, vertices: np.ndarray, spacing_m: float, margin_m: float) -> DistanceField:
    """Sample the distance to N_t on a grid around the object (v, 3), extended by `margin_m`."""
    low, high = vertices.min(0) - margin_m, vertices.max(0) + margin_m
    count = np.ceil((high - low) / spacing_m).astype(int) + 1
    axes = [low[k] + spacing_m * np.arange(count[k]) for k in range(3)]
    nodes = np.stack(np.meshgrid(*axes, indexing="ij"), -1).reshape(-1, 3)
    return DistanceField(name, distance_to_points(N_t, nodes).reshape(count).astype(np.float32), low.astype(np.float64), spacing_m)


DENSE = 20
"""sampled points for each point of N_t, from which the farthest are chosen"""


@dataclass(frozen=True)
class ProjectionSettings:
    """Settings of the projection: the Params of negative_affordance_projection."""

    threshold: float
    points: int
    negative_points: int
    spacing_m: float
    margin_m: float
    seed: int


def project(mesh: ObjectMesh, views: ObjectViews, candidates: PartCandidates, descriptions: PartDescriptions, scores: PartScores,
            settings: ProjectionSettings) -> NegativeAffordances:  # fmt: skip
    """Compute the negative affordance of every described task."""
    rng = np.random.default_rng(settings.seed)
    points, face = sample_surface(mesh.vertices, mesh.faces, views.visible_area, settings.points, rng)
    square, tasks = cos_incidence(mesh, views), []
    for one, own in split_by_task(descriptions, scores):
        value, weight = pixel_probability(candidates, own, one, views.face)
        probability, evidence = project_to_faces(mesh, views, value, weight * square)
        tasks.append(label_surface(mesh, views, one.task, probability, evidence, face, settings))
    return NegativeAffordances(mesh.name, points, tuple(tasks))


def project_to_faces(mesh: ObjectMesh, views: ObjectViews, value: np.ndarray, weight: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Average pixel values (n, h, w) with weights (n, h, w) on faces: probability (f,), and sum of weights (f,).

    Faces without weight take the values of their neighbours.
    """
    voted, evidence = vote_on_faces(views.face, value, weight, len(mesh.faces))
    return harmonic_fill(mesh.vertices, mesh.faces, voted, evidence > 0), evidence


def label_surface(mesh: ObjectMesh, views: ObjectViews, task: str, probability: np.ndarray, evidence: np.ndarray, face: np.ndarray,
             settings: ProjectionSettings) -> NegativeAffordance:  # fmt: skip
    """Convert face probabilities (f,) to labels, N_t and distance field; `face` (n,) belongs to the object's points."""
    bad = probability > settings.threshold
    rng = np.random.default_rng((settings.seed, 1))
    area = np.where(bad, views.visible_area, 0)
    dense, _ = sample_surface(mesh.vertices, mesh.faces, area, DENSE * settings.negative_points, rng)
    N_t = dense[farthest_point_sampling(dense, settings.negative_points)]
    grid = distance_field(mesh.name, N_t, mesh.vertices, settings.spacing_m, settings.margin_m)
    return NegativeAffordance(task, probability, evidence, bad[face], N_t, grid)
