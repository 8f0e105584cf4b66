"""Small mesh files for tests, written by hand or with trimesh."""

from __future__ import annotations

import json
from pathlib import Path

import cv2
import numpy as np
import trimesh

from afford.surface.meshes.discover import discover
from afford.surface.meshes.mend import MeshSettings, read_repaired
from afford.surface.meshes.repair import RepairLimits
from runner.canonical import file_digest
from schemas.files import FileTree
from schemas.mesh import ReadMesh

SIZE_M = (0.1, 0.2, 0.04)
LIMITS = RepairLimits(hole_edges=64, hole_share=0.05, dust_share=0.0001)


def wishes(unit: str = "auto", categories: tuple[str, ...] = (), texture_px: int = 512, faces: int = 60_000) -> MeshSettings:
    """Return settings of mesh_read."""
    return MeshSettings(unit, categories, texture_px, faces, LIMITS)


def tree(folder: Path, name: str = "") -> FileTree:
    """Return the only object of a folder, or the one of that name."""
    found = discover(folder, file_digest)
    assert not found.refused, found.refused
    return next(t for t in found.objects if t.name == (name or found.objects[0].name))


def mended(folder: Path, name: str = "", **wanted: object) -> ReadMesh:
    """Read and repair an object of a folder."""
    return read_repaired(tree(folder, name), wishes(**wanted))  # type: ignore[arg-type]  # the fields of `wishes`


def box(cuts: int = 2) -> trimesh.Trimesh:
    """Build a box of SIZE_M with subdivided faces."""
    out = trimesh.creation.box(SIZE_M)
    for _ in range(cuts):
        out = out.subdivide()
    return trimesh.Trimesh(out.vertices, out.faces, process=False)


def checks(side: int = 64) -> np.ndarray:
    """Draw an image (side, side, 3) uint8 in which every texel encodes its position."""
    rows, columns = np.mgrid[:side, :side]
    return np.stack([rows * 255 // (side - 1), columns * 255 // (side - 1), 40 + 0 * rows], -1).astype(np.uint8)


def write_image(path: Path, rgb: np.ndarray) -> None:
    """Write an image as PNG."""
    cv2.imwrite(str(path), cv2.cvtColor(rgb, cv2.COLOR_RGB2BGR))


def write_obj(path: Path, vertices: np.ndarray, faces: np.ndarray, uv: np.ndarray | None = None, head: str = "",
              before: dict[int, str] | None = None) -> None:
    """Write an OBJ; `uv` (f, 3, 2) per corner, `before` are lines before a face."""
    lines = [head] if head else []
    lines += ["v " + " ".join(f"{x:.9g}" for x in v) for v in vertices]
    if uv is not None:
        lines += [f"vt {u:.9g} {v:.9g}" for u, v in uv.reshape(-1, 2)]
    for k, face in enumerate(faces):
        lines += [before[k]] if before and k in before else []
        lines.append("f " + " ".join(f"{v + 1}" + (f"/{3 * k + c + 1}" if uv is not None else "") for c, v in enumerate(face)))
    path.write_text("\n".join(lines) + "\n")


def write_labels(mesh: Path, **fields: object) -> None:
    """Write a label file for a mesh."""
    Path(f"{mesh}.parts.json").write_text(json.dumps({"version": 1, **fields}))


def planar_uv(vertices: np.ndarray, faces: np.ndarray) -> np.ndarray:
    """Compute coordinates (f, 3, 2) 0.1..0.9 from x and y."""
    flat = vertices[:, :2]
    return (0.1 + 0.8 * (flat - flat.min(axis=0)) / np.ptp(flat, axis=0))[faces]


def places(vertices: np.ndarray, faces: np.ndarray, count: int = 500) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Draw random faces (n,), barycentric coordinates (n, 3) and points (n, 3) on a surface."""
    rng = np.random.default_rng(3)
    area = np.linalg.norm(np.cross(*(vertices[faces][:, 1:] - vertices[faces][:, :1]).transpose(1, 0, 2)), axis=1)
    face = rng.choice(len(faces), count, p=area / area.sum())
    bary = rng.dirichlet((1, 1, 1), count)
    return face, bary, np.einsum("nk,nkc->nc", bary, vertices[faces[face]])
