"""What others open: coloured surfaces, points, N_t and words, and nothing lost on the way."""

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


def test_the_surface_is_that_of_the_mesh_in_colours(tmp_path: Path) -> None:
    """GLB and PLY: the same triangles; red where it is negative, green elsewhere."""
    x, files = looked(), made(tmp_path)
    bad = projected(x).tasks[0].probability > 0.9
    for name in ("surface.glb", "surface.ply"):
        shape = trimesh.load(at(files, name), force="mesh", process=False)
        assert shape.triangles == pytest.approx(x.mesh.vertices[x.mesh.faces], abs=1e-6)
        red, green = shape.visual.vertex_colors[::3, 0].astype(int), shape.visual.vertex_colors[::3, 1].astype(int)
        assert (red[bad] > green[bad] + 90).all() and (green > red).any()


def test_points_and_words_are_those_of_the_result(tmp_path: Path) -> None:
    """N_t comes back; the JSON names the parts with their roles; distances are the grid's."""
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


def test_the_same_input_gives_the_same_files(tmp_path: Path) -> None:
    """To the byte; a folder for each task, named after it."""
    one, again = made(tmp_path / "a"), made(tmp_path / "b")
    assert [(f.name, f.digest) for f in one.files] == [(f.name, f.digest) for f in again.files]
    assert {f.name.partition("/")[0] for f in one.files} == {"0_drive_a_screw", "1_hand_over_the_screwdriver"}
    assert task_slug("") == "any_use" and task_slug("Hand over: the KNIFE!") == "hand_over_the_knife"


def test_where_nothing_is_negative_n_t_is_a_file_without_points(tmp_path: Path) -> None:
    """Still a PLY that opens."""
    x, found = looked(), projected(looked())
    empty = replace(found.tasks[0], N_t=np.zeros((0, 3), np.float32), negative=np.zeros_like(found.tasks[0].negative))
    told, nothing = replace(x.told, descriptions=x.told.descriptions[:1]), replace(found, tasks=(empty,))
    files = negative_affordance_files.run(x.mesh, told, nothing, negative_affordance_files.Params(), Scratch(tmp_path))
    assert b"element vertex 0\n" in at(files, "N_t.ply").read_bytes()


def test_colours_run_from_green_to_red() -> None:
    """Opaque; in the middle between both."""
    found = probability_colours(np.float32([0, 0.5, 1]))
    assert found[0].tolist() == [60, 160, 90, 255] and found[2].tolist() == [214, 48, 39, 255]
    assert found[1, :3] == pytest.approx((found[0, :3].astype(float) + found[2, :3]) / 2, abs=1)
