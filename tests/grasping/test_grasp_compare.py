"""Grasps from masks of different kinds: masks are what they say, trials are the same for all, the report counts right."""

from __future__ import annotations

from dataclasses import replace
from functools import cache
from pathlib import Path

import numpy as np
import pytest

from afford.common.files import tree
from afford.grasping.candidates.compare import masks
from afford.grasping.candidates.comparison_report import differences, shares, table
from afford.grasping.candidates.render_view import ViewCamera, render_view
from schemas.files import FileTree
from schemas.grasp import FIGURES, METHODS, GraspComparison, GraspObject
from schemas.mesh import ObjectSpec, PartedMesh
from schemas.surface import PartDescriptions
from stages.grasping import grasp_compare, grasp_compare_report, object_solids
from stages.surface import part_describe
from stages.synthetic import object_build
from tests.helpers.made_hands import shadow
from tests.helpers.made_objects import looked
from tests.helpers.made_samples import Scratch
from tests.helpers.tiny_asked import write_model

NONE = FileTree("none", ())
QUICK = grasp_compare.Params(engines=("mujoco",), looks=1, places=16)


@cache
def subject() -> tuple[PartedMesh, GraspObject, PartDescriptions]:
    """With two of its tasks: its handle is held, or its head."""
    built = object_build.run(ObjectSpec("hammer", "hammer", 12, "plain", "train"),
                             object_build.Params(edge_m=0.012, max_faces=6000, atlas_px=64))  # fmt: skip
    body = object_solids.run(built.mesh, built.parts, object_solids.Params(points=64, hulls=12))
    tasks = part_describe.Params(tasks=("drive a nail", "hit it", "hand over the hammer"))
    return built, body, part_describe.run(built.mesh, looked().views, tasks)


def tried(told: PartDescriptions, model: FileTree, scratch: Path, params: grasp_compare.Params = QUICK) -> GraspComparison:
    built, body, _ = subject()
    return grasp_compare.run(shadow(), built.mesh, built.parts, body, told, model, params, Scratch(scratch))


def test_a_look_shows_the_object_where_it_lies() -> None:
    """Faces behind pixels are at the depth that the camera measured; noise is of the size that was asked for."""
    built, _, _ = subject()
    pose = np.array([0.02, -0.01, 0.0, 0.0, 0.0, np.sin(0.5), np.cos(0.5)])
    exact, noisy = (render_view(built.mesh, pose, ViewCamera(noise_m=noise, width_px=160, height_px=120), np.random.default_rng(0))
                    for noise in (0.0, 0.003))  # fmt: skip
    y, x = np.nonzero(exact.face >= 0)
    assert len(y) > 200
    rays = np.stack([(x - exact.K[0, 2]) / exact.K[0, 0], (y - exact.K[1, 2]) / exact.K[1, 1], np.ones(len(x))], axis=1)
    seen = (rays * exact.depth_m[y, x, None]) @ exact.T_world_cam[:3, :3].T + exact.T_world_cam[:3, 3]
    c, s = np.cos(1.0), np.sin(1.0)
    middle = built.mesh.vertices[built.mesh.faces].mean(1) @ np.array([[c, s, 0], [-s, c, 0], [0, 0, 1]]) + pose[:3]
    assert np.linalg.norm(seen - middle[exact.face[y, x]], axis=1).max() < 0.02  # triangles have edges of 12 mm
    assert (noisy.depth_m - exact.depth_m)[exact.depth_m > 0].std() == pytest.approx(0.003, rel=0.1)


def test_masks_are_what_they_say() -> None:
    """The affordance lies in the whole; negative parts are told by +N alone and are no part of the affordance."""
    built, _, told = subject()
    camera = ViewCamera(width_px=160, height_px=120)
    seen = render_view(built.mesh, np.array([0, 0, 0, 0, 0, 0, 1.0]), camera, np.random.default_rng(0))
    said = np.zeros(seen.face.shape, bool)
    found = {name: (region, bad) for name, region, bad in masks(built.parts, seen, told.descriptions[0], said)}
    assert tuple(found) == tuple(METHODS)
    good, bad = found["affordance+N"]
    assert good.any() and bad.any() and not (good & bad).any()
    assert (found["whole"][0] == (seen.face >= 0)).all() and (found["whole"][0] >= good).all()
    assert not found["whole"][1].any() and np.array_equal(found["whole+N"][1], bad) and not found["predicted"][0].any()


def test_a_tool_is_compared(tmp_path: Path) -> None:
    """Every task that differs in its parts, every kind of mask but the model's; success is to hold and to press on nothing
    forbidden; the same again gives the same.
    """
    told = subject()[2]
    found, again = (tried(told, NONE, tmp_path / name) for name in ("a", "b"))
    assert found.methods == tuple(name for name in METHODS if "predicted" not in name)
    assert found.values.shape == (4, 1, len(found.tasks), 1, len(FIGURES)) and len(found.tasks) == 2
    held, pressed = found.figure("held"), found.figure("negative_end")
    assert np.array_equal(found.figure("success"), held * (1 - pressed)) and (pressed <= found.figure("negative_any")).all()
    assert found.figure("held")[1, 0, 0].all(), "the handle, told what to keep off, is held"
    assert "hit it" not in found.tasks  # its parts are those of driving a nail
    assert found.figure("iou")[0].min() == 1.0 and found.figure("iou")[2].max() < 1.0
    assert found.values.tobytes() == again.values.tobytes()


def test_a_model_gets_rows_of_its_own(tmp_path: Path) -> None:
    told = subject()[2]
    model = tree("tiny", write_model(tmp_path / "small"))
    one = replace(told, descriptions=told.descriptions[:1])
    assert tried(one, model, tmp_path / "scratch").methods == tuple(METHODS)


def test_an_object_without_a_place_for_a_hand_is_refused(tmp_path: Path) -> None:
    told = subject()[2]
    nothing = replace(told, descriptions=(replace(told.descriptions[0], notes=()),))
    with pytest.raises(ValueError, match=r"expected a task with positive parts among .* got none"):
        tried(nothing, NONE, tmp_path)


def made_up(name: str, held: list[float]) -> GraspComparison:
    """`affordance` holds as told, `whole` never."""
    values = np.zeros((2, 1, 1, len(held), len(FIGURES)))
    values[0, 0, 0, :, [list(FIGURES).index(figure) for figure in ("found", "held", "success")]] = held
    return GraspComparison(name, "tool", ("affordance", "whole"), ("mujoco",), ("use",), values)


def test_the_report_counts(tmp_path: Path) -> None:
    """3 of 4 are 0.75 within Wilson's interval; the difference is the mean over objects; objects are paired."""
    found = (made_up("a", [1.0, 1.0]), made_up("b", [1.0, 0.0]))
    row = next(row for row in shares(found) if (row.method, row.figure) == ("affordance", "held"))
    assert (row.value, row.trials, row.low, row.high) == pytest.approx((0.75, 4, 0.3006, 0.9544), abs=1e-3)
    (gain,) = differences(found, 0)
    assert gain.value == 0.75 and 0.5 <= gain.low <= gain.value <= gain.high <= 1.0
    files = grasp_compare_report.run(found, grasp_compare_report.Params(), Scratch(tmp_path))
    assert [ref.name for ref in files.files] == ["grasp_compare.json", "grasp_compare.md"]
    assert "0.75 (0.30 to 0.95)" in table(found, 0)


def test_comparisons_of_other_methods_are_refused(tmp_path: Path) -> None:
    one = made_up("a", [1.0])
    with pytest.raises(ValueError, match="one set of methods and engines, got 2"):
        grasp_compare_report.run((one, replace(one, engines=("bullet",))), grasp_compare_report.Params(), Scratch(tmp_path))
