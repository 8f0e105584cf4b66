"""Export of negative affordances: surfaces, points, N_t and JSON without loss."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import trimesh

from afford.surface.negative.export import probability_colours, task_slug
from schemas.files import FileTree
from stages.surface import negative_affordance_files
from tests.helpers.made_objects import looked, projected
from tests.helpers.made_samples import Scratch


def made(folder: Path) -> FileTree:
    x = looked()
    return negative_affordance_files.run(x.mesh, x.told, projected(x), negative_affordance_files.Params(), Scratch(folder))


def at(files: FileTree, name: str) -> Path:
    return next(file.path for file in files.files if file.name.endswith(name) and file.name.startswith("0_"))


def test_exported_surface_has_the_triangles_in_colours(tmp_path: Path) -> None:
    """Check GLB and PLY: red negative faces, green others."""
    x, files = looked(), made(tmp_path)
    bad = projected(x).tasks[0].probability > 0.9
    for name in ("surface.glb", "surface.ply"):
        shape = trimesh.load(at(files, name), force="mesh", process=False)
        assert shape.triangles == pytest.approx(x.mesh.vertices[x.mesh.faces], abs=1e-6)
        red, green = shape.visual.vertex_colors[::3, 0].astype(int), shape.visual.vertex_colors[::3, 1].astype(int)
        assert (red[bad] > green[bad] + 90).all() and (green > red).any()


def test_exported_points_and_json_agree_with_the_result(tmp_path: Path) -> None:
    """Check N_t, roles of parts, and the distance grid."""
    x, files = looked(), made(tmp_path)
    one = projected(x).tasks[0]
    assert trimesh.load(at(files, "N_t.ply")).vertices == pytest.approx(one.N_t, abs=1e-7)
    cloud = trimesh.load(at(files, "points.ply"))
    assert ((cloud.colors[:, 0] > 150) == one.negative).all()
    told = json.loads(at(files, "negative.json").read_text())
    assert told["parts"]["shaft"]["role"] == "negative" and told["parts"]["handle"]["role"] == "positive"
    assert np.array(told["N_t"]) == pytest.approx(one.N_t, abs=1e-6) and told["task"] == one.task
    with np.load(at(files, "distance.npz")) as grid:
        assert np.array_equal(grid["distance_m"], one.field.distance_m) and float(grid["spacing_m"]) == one.field.spacing_m


def test_export_is_deterministic(tmp_path: Path) -> None:
    """Check the bytes, and one folder for each task."""
    one, again = made(tmp_path / "a"), made(tmp_path / "b")
    assert [(f.name, f.digest) for f in one.files] == [(f.name, f.digest) for f in again.files]
    assert {f.name.partition("/")[0] for f in one.files} == {"0_drive_a_screw", "1_hand_over_the_screwdriver"}
    assert task_slug("") == "any_use" and task_slug("Hand over: the KNIFE!") == "hand_over_the_knife"


def test_empty_n_t_is_a_valid_file(tmp_path: Path) -> None:
    """Check a PLY without points."""
    x, found = looked(), projected(looked())
    empty = replace(found.tasks[0], N_t=np.zeros((0, 3), np.float32), negative=np.zeros_like(found.tasks[0].negative))
    told, nothing = replace(x.told, descriptions=x.told.descriptions[:1]), replace(found, tasks=(empty,))
    files = negative_affordance_files.run(x.mesh, told, nothing, negative_affordance_files.Params(), Scratch(tmp_path))
    assert b"element vertex 0\n" in at(files, "N_t.ply").read_bytes()


def test_colours_run_from_green_to_red() -> None:
    """Check opaque colours, and the mean of both at 0.5."""
    found = probability_colours(np.float32([0, 0.5, 1]))
    assert found[0].tolist() == [60, 160, 90, 255] and found[2].tolist() == [214, 48, 39, 255]
    assert found[1, :3] == pytest.approx((found[0, :3].astype(float) + found[2, :3]) / 2, abs=1)
