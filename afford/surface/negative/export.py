"""Export of negative affordances: coloured surfaces (GLB, PLY), labelled points, N_t, distance grid, JSON."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np
import trimesh

from afford.common.files import empty_folder, tree, write_json
from afford.surface.negative.score_report import FREE, NEGATIVE
from schemas.files import FileTree
from schemas.mesh import ObjectMesh
from schemas.surface import NegativeAffordance, NegativeAffordances, PartDescription, PartDescriptions

POINT = "".join([f"property float {axis}\n" for axis in "xyz"] + [f"property uchar {c}\n" for c in ("red", "green", "blue")])


def write_files(mesh: ObjectMesh, descriptions: PartDescriptions, found: NegativeAffordances, scratch: Path) -> FileTree:
    """Write a folder for each task: surface.glb, surface.ply, points.ply, N_t.ply, distance.npz, negative.json."""
    root = empty_folder(scratch / "out")
    for number, (one, description) in enumerate(zip(found.tasks, descriptions.descriptions, strict=True)):
        folder = root / f"{number}_{task_slug(one.task)}"
        folder.mkdir()
        _surface(mesh, one, folder)
        _points(found.points, one, folder)
        _distances(one, folder)
        write_json(folder / "negative.json", affordance_record(one, description))
    return tree(found.name, root)


def task_slug(task: str) -> str:
    """Convert a task to a part of a file name: 'hand over the knife' -> hand_over_the_knife."""
    return re.sub(r"[^a-z0-9]+", "_", task.lower()).strip("_") or "any_use"


def affordance_record(one: NegativeAffordance, description: PartDescription) -> dict[str, object]:
    """Build the content of negative.json: parts, roles, reasons, N_t."""
    parts = {note.part: {"role": note.role, "reason": note.reason, "confidence": note.confidence} for note in description.notes}
    return {"task": one.task, "category": description.category, "parts": parts, "negative_points": len(one.N_t),
            "unit": "m", "frame": "object", "N_t": np.round(one.N_t.astype(float), 7).tolist()}  # fmt: skip


def probability_colours(probability: np.ndarray) -> np.ndarray:
    """Map probabilities to (n, 4) uint8 colours from green (free) to red (negative)."""
    p = probability[:, None]
    rgb = p * NEGATIVE + (1 - p) * FREE
    return np.concatenate([np.rint(rgb), np.full((len(p), 1), 255)], axis=1).astype(np.uint8)


def _surface(mesh: ObjectMesh, one: NegativeAffordance, folder: Path) -> None:
    """Write the surface with separate corners for each face, so that colours do not blend between faces."""
    corners = mesh.vertices[mesh.faces.reshape(-1)]
    shape = trimesh.Trimesh(corners, np.arange(len(corners)).reshape(-1, 3), process=False)
    shape.visual = trimesh.visual.ColorVisuals(shape, vertex_colors=np.repeat(probability_colours(one.probability), 3, axis=0))
    for name in ("surface.glb", "surface.ply"):
        shape.export(folder / name)


def _points(points: np.ndarray, one: NegativeAffordance, folder: Path) -> None:
    """Write the labelled points of the object, and N_t; both may be empty."""
    for name, place, bad in (("points.ply", points, one.negative), ("N_t.ply", one.N_t, np.ones(len(one.N_t), bool))):
        rows = np.empty(len(place), [("xyz", "<f4", 3), ("rgb", "u1", 3)])
        rows["xyz"], rows["rgb"] = place, probability_colours(bad.astype(np.float32))[:, :3]
        head = f"ply\nformat binary_little_endian 1.0\nelement vertex {len(rows)}\n{POINT}end_header\n"
        (folder / name).write_bytes(head.encode() + rows.tobytes())


def _distances(one: NegativeAffordance, folder: Path) -> None:
    """Write the distance grid as plain arrays."""
    grid = one.field
    np.savez(folder / "distance.npz", distance_m=grid.distance_m, origin=grid.origin, spacing_m=np.float64(grid.spacing_m))
