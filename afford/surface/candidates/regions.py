"""The embedded proposer: the surface is cut where it bends inwards, changes colour or thickness, at all scales."""

from __future__ import annotations

import numpy as np

from afford.surface.candidates import Regions
from afford.surface.segments.borders import Borders, BorderWeights
from afford.surface.segments.features import FaceFeatures
from afford.surface.segments.oversegment import oversegment
from afford.surface.segments.suppress import collect_candidates, nms
from afford.surface.segments.tree import RegionTree, merge_regions
from schemas.mesh import ObjectMesh, ObjectViews
from schemas.surface import PartCandidates

FINEST = 0.0003
"""scale of the first regions (see oversegment)"""


def propose(mesh: ObjectMesh, views: ObjectViews, params: Regions) -> PartCandidates:
    """See `Propose`."""
    tree = region_tree(mesh, params.least_share)
    chosen = np.flatnonzero((tree.share >= params.least_share) & (tree.share <= params.most_share))
    nodes, quality = tree.members()[chosen], tree.persistence[chosen]
    found: list[tuple[int, np.ndarray, float]] = []
    for view, face in enumerate(views.face):
        region = np.append(tree.leaf, len(nodes.T))[face]
        size = np.bincount(region.reshape(-1), minlength=len(nodes.T) + 1)[:-1]
        shown = np.flatnonzero((nodes @ size >= params.least_px) & (nodes @ size <= params.most_share * size.sum()))
        masks = np.pad(nodes[shown], ((0, 0), (0, 1)))[:, region]
        found += [(view, masks[k], float(quality[shown[k]])) for k in nms(masks, quality[shown], params.nms_iou, params.most)]
    return collect_candidates(mesh.name, found, views.face.shape[1:])


def region_tree(mesh: ObjectMesh, least: float) -> RegionTree:
    """The tree of regions of a surface."""
    features = FaceFeatures.of(mesh)
    borders = Borders.of(mesh.vertices, mesh.faces, features, BorderWeights())
    return merge_regions(oversegment(borders, features.area, FINEST, least / 2), borders, features)
