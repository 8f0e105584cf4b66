"""The skin of a hand to the last bit: `HandModel.posed` without linear algebra libraries, whose sums depend on their threads.

Colours are rounded and do not show it; depth and flow, which are kept as they are, would.
"""

from __future__ import annotations

import numpy as np

from afford.synthetic.people.hand import HandModel
from afford.synthetic.people.hand_shape import hand_shape


def exact_skin(model: HandModel, T_world_palm: np.ndarray, angles: np.ndarray, elbow: np.ndarray) -> np.ndarray:
    """(v, 3) float32 world vertices."""
    T = T_world_palm @ model._mirror
    shape = hand_shape()
    blended = np.einsum("vb,bij->vij", shape.weights.astype(np.float64), model._moves(T, angles, elbow)[:, :3])
    rest = shape.vertices.astype(np.float64)
    local = np.einsum("vij,vj->vi", blended[..., :3], rest) + blended[..., 3]
    return (np.einsum("vj,ij->vi", local, T[:3, :3]) + T[:3, 3]).astype(np.float32)
