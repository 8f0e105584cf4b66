"""Comparison of grasps from different masks: rendered views, masks, trials and report."""

from __future__ import annotations

from dataclasses import replace
from functools import cache
from pathlib import Path

import numpy as np
import pytest

from afford.common.files import tree
from afford.grasping.candidates.compare import ViewCamera, masks, render_view
from afford.grasping.candidates.comparison_report import differences, shares, table
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
    """Build a hammer with tasks that hold its handle or its head."""
    built = object_build.run(ObjectSpec("hammer", "hammer", 12, "plain", "train"),
                             object_build.Params(edge_m=0.012, max_faces=6000, atlas_px=64))  # fmt: skip
    body = object_solids.run(built.mesh, built.parts, object_solids.Params(points=64, hulls=12))
    tasks = part_describe.Params(tasks=("drive a nail", "hit it", "hand over the hammer"))
    return built, body, part_describe.run(built.mesh, looked().views, tasks)


def compared(descriptions: PartDescriptions, model: FileTree, scratch: Path,
             params: grasp_compare.Params = QUICK) -> GraspComparison:  # fmt: skip
    built, body, _ = subject()
    return grasp_compare.run(shadow(), built.mesh, built.parts, body, descriptions, model, params, Scratch(scratch))


def test_a_rendered_view_shows_the_object_at_its_pose() -> None:
    """Faces behind pixels are at the measured depth; noise has the requested standard deviation."""
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


def test_masks_of_every_method() -> None:
    """The affordance is inside the whole; only +N has negative parts, which do not overlap the affordance."""
    built, _, descriptions = subject()
    camera = ViewCamera(width_px=160, height_px=120)
    seen = render_view(built.mesh, np.array([0, 0, 0, 0, 0, 0, 1.0]), camera, np.random.default_rng(0))
    predicted = np.zeros(seen.face.shape, bool)
    found = {name: (region, bad) for name, region, bad in masks(built.parts, seen, descriptions.descriptions[0], predicted)}
    assert tuple(found) == tuple(METHODS)
    good, bad = found["affordance+N"]
    assert good.any() and bad.any() and not (good & bad).any()
    assert (found["whole"][0] == (seen.face >= 0)).all() and (found["whole"][0] >= good).all()
    assert not found["whole"][1].any() and np.array_equal(found["whole+N"][1], bad) and not found["predicted"][0].any()


@pytest.fixture(scope="module")
def found(tmp_path_factory: pytest.TempPathFactory) -> GraspComparison:
    return compared(subject()[2], NONE, tmp_path_factory.mktemp("compared"))


def test_comparison_of_a_tool(found: GraspComparison) -> None:
    """Trials cover all tasks with distinct parts and all masks except the model's.

    Success means held without pressing on a negative part at the end.
    """
    assert found.methods == tuple(name for name in METHODS if "predicted" not in name)
    assert found.values.shape == (4, 1, len(found.tasks), 1, len(FIGURES)) and len(found.tasks) == 2
    held, pressed = found.figure("held"), found.figure("negative_end")
    assert np.array_equal(found.figure("success"), held * (1 - pressed)) and (pressed <= found.figure("negative_any")).all()
    assert found.figure("held")[1, 0, 0].all(), "the handle, descriptions what to keep off, is held"
    assert "hit it" not in found.tasks  # its parts are those of driving a nail
    assert found.figure("iou")[0].min() == 1.0 and found.figure("iou")[2].max() < 1.0


def test_a_model_adds_rows(found: GraspComparison, tmp_path: Path) -> None:
    """Rows of the other masks have the same bytes as without a model."""
    descriptions = subject()[2]
    model = tree("tiny", write_model(tmp_path / "small"))
    one = replace(descriptions, descriptions=descriptions.descriptions[:1])
    with_model = compared(one, model, tmp_path / "scratch")
    assert with_model.methods == tuple(METHODS)
    assert with_model.values[: len(found.methods)].tobytes() == found.values[:, :, :1].tobytes()


def test_an_object_without_positive_parts_is_rejected(tmp_path: Path) -> None:
    descriptions = subject()[2]
    nothing = replace(descriptions, descriptions=(replace(descriptions.descriptions[0], notes=()),))
    with pytest.raises(ValueError, match="no task has a positive part among"):
        compared(nothing, NONE, tmp_path)


def comparison(name: str, held: list[float]) -> GraspComparison:
    """Build a comparison in which `affordance` holds as given and `whole` never."""
    values = np.zeros((2, 1, 1, len(held), len(FIGURES)))
    values[0, 0, 0, :, [list(FIGURES).index(figure) for figure in ("found", "held", "success")]] = held
    return GraspComparison(name, "tool", ("affordance", "whole"), ("mujoco",), ("use",), values)


def test_report_of_a_comparison(tmp_path: Path) -> None:
    """3 of 4 are 0.75 within Wilson's interval; the difference is the mean over paired objects."""
    found = (comparison("a", [1.0, 1.0]), comparison("b", [1.0, 0.0]))
    row = next(row for row in shares(found) if (row.method, row.figure) == ("affordance", "held"))
    assert (row.value, row.trials, row.low, row.high) == pytest.approx((0.75, 4, 0.3006, 0.9544), abs=1e-3)
    (gain,) = differences(found, 0)
    assert gain.value == 0.75 and 0.5 <= gain.low <= gain.value <= gain.high <= 1.0
    files = grasp_compare_report.run(found, grasp_compare_report.Params(), Scratch(tmp_path))
    assert [ref.name for ref in files.files] == ["grasp_compare.json", "grasp_compare.md"]
    assert "0.75 (0.30 to 0.95)" in table(found, 0)


def test_comparisons_of_different_methods_are_rejected(tmp_path: Path) -> None:
    one = comparison("a", [1.0])
    with pytest.raises(ValueError, match="one set of methods and engines, got 2"):
        grasp_compare_report.run((one, replace(one, engines=("bullet",))), grasp_compare_report.Params(), Scratch(tmp_path))
