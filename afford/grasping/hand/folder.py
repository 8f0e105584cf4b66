"""A hand as files, for engines that read URDF from a folder."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from schemas.hand import HandMesh, HandModel


def files(hand: HandModel) -> dict[str, bytes]:
    """The meshes that the URDF names, by file name without folder, for engines that read from memory."""
    return {mesh.file.rpartition("/")[2]: _obj(mesh).encode() for mesh in hand.meshes}


def save(hand: HandModel, folder: Path) -> Path:
    """Write `<name>.urdf` and the meshes that it names; gives the URDF. The same hand gives the same bytes."""
    folder.mkdir(parents=True, exist_ok=True)
    for mesh in hand.meshes:
        path = folder / mesh.file
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(_obj(mesh), encoding="utf-8", newline="\n")
    path = folder / f"{hand.name}.urdf"
    path.write_text(hand.urdf, encoding="utf-8", newline="\n")
    return path


def _obj(mesh: HandMesh) -> str:
    """OBJ with one normal per face, so that edges stay edges."""
    corners = mesh.vertices.astype(np.float64)[mesh.faces]
    normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    normals /= np.maximum(np.linalg.norm(normals, axis=1, keepdims=True), 1e-30)
    lines = [f"v {x:.9g} {y:.9g} {z:.9g}" for x, y, z in mesh.vertices.tolist()]
    lines += [f"vn {x:.6f} {y:.6f} {z:.6f}" for x, y, z in normals.tolist()]
    lines += [f"f {a}//{k} {b}//{k} {c}//{k}" for k, (a, b, c) in enumerate((mesh.faces + 1).tolist(), 1)]
    return "\n".join(lines) + "\n"
