"""Instances flattened into world-space triangles with a table of materials: what the kernels read."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from afford.render.mesh import smooth_normals
from afford.render.model import Instance
from afford.render.textures import Textures


@dataclass(frozen=True, eq=False)
class Batch:
    """(v, 3) world vertices, normals, colours; (v, 2) uv; (f, 3) faces; (f,) part of each face; per part: entity int16,
    texture layer, and `looks` (tint rgb, specular, roughness, bump, metal, skin).
    """

    vertices: np.ndarray
    normals: np.ndarray
    colours: np.ndarray
    uv: np.ndarray
    faces: np.ndarray
    part: np.ndarray
    entity: np.ndarray
    layer: np.ndarray
    looks: np.ndarray
    casts: np.ndarray


def batch(instances: Sequence[Instance], textures: Textures) -> Batch:
    """All instances as one."""
    placed = [_placed(i) for i in instances]
    starts = np.cumsum([0] + [len(v) for v, _ in placed[:-1]])
    faces = [i.mesh.faces + np.int32(s) for i, s in zip(instances, starts, strict=True)]
    materials = [i.material for i in instances]
    return Batch(
        np.concatenate([v for v, _ in placed]),
        np.concatenate([n for _, n in placed]),
        np.concatenate([i.mesh.colour for i in instances]),
        np.concatenate([i.mesh.uv for i in instances]),
        np.concatenate(faces),
        np.repeat(np.arange(len(faces), dtype=np.int32), [len(f) for f in faces]),
        np.array([i.entity for i in instances], np.int16),
        np.array([textures.layer[id(m.image)] for m in materials], np.int32),
        np.array([(*m.tint, m.specular, m.roughness, m.bump, m.metal, m.skin) for m in materials], np.float32),
        np.array([i.casts for i in instances], np.bool_),
    )


def _placed(instance: Instance) -> tuple[np.ndarray, np.ndarray]:
    """World vertices and normals of one instance, float32."""
    if instance.vertices is not None:
        points = np.ascontiguousarray(instance.vertices, np.float32)
        return points, smooth_normals(points, instance.mesh.faces)
    R = instance.T_world_mesh[:3, :3].astype(np.float32)
    return instance.mesh.vertices @ R.T + instance.T_world_mesh[:3, 3].astype(np.float32), instance.mesh.normals @ R.T
