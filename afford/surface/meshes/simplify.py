"""Fewer faces by quadric edge collapse, as in Garland and Heckbert 1997."""

from __future__ import annotations

import fast_simplification
import numpy as np

from afford.surface.meshes.errors import MeshError
from afford.surface.meshes.net import edit_mesh
from afford.surface.meshes.repair import drop_empty, drop_repeated


def simplify(vertices: np.ndarray, faces: np.ndarray, count: int) -> tuple[np.ndarray, np.ndarray]:
    """(v, 3) float64 and (f, 3) int64 of about `count` faces. MeshError when the surface cannot be made that simple."""
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
