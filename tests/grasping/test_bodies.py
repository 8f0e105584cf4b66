"""Grasps of meshes of the user: plan of the graph, bad meshes, tasks by part, a tiny evaluation and its report."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import trimesh

from afford.training.curves import Point, training_log
from commands.errors import UsageError
from commands.origin import origin
from maps.settings import Settings
from pipeline import build
from runner.canonical import file_digest
from schemas.bodies import BodyTasks
from schemas.mesh import MeshParts, MeshReport, ObjectMesh
from schemas.surface import DistanceField, NegativeAffordance, NegativeAffordances, PartDescription, PartDescriptions, PartNote
from stages.grasping import body_choose, body_evaluate, body_report, body_tasks
from tests.helpers.made_hands import shadow
from tests.helpers.made_students import teacher
from tests.helpers.mesh_files import write_obj

FEW = body_tasks.Params(points=300, hulls=6)


class Ctx:
    """Context of a stage in a test."""

    def __init__(self, scratch: Path) -> None:
        self.scratch = scratch

    def progress(self, done: int, total: int) -> None:
        """Take notice of nothing."""


def stick(name: str = "stick", size: tuple[float, float, float] = (0.2, 0.025, 0.02)) -> trimesh.Trimesh:
    mesh = trimesh.creation.box(size).subdivide().subdivide()
    mesh.metadata["name"] = name
    return mesh


def tasks_of(mesh: trimesh.Trimesh, name: str = "stick", params: body_tasks.Params = FEW, category: str = "",
             **report: object) -> BodyTasks:  # fmt: skip
    """Tasks of a mesh, whose half with x > 0 is a blade that must not be touched to cut, and of which nothing is known else."""
    blade = mesh.triangles_center[:, 0] > 0
    given = ObjectMesh(name, category, mesh.vertices.astype(np.float32), mesh.faces.astype(np.int32),
                       np.zeros((len(mesh.faces), 3, 2), np.float32), np.zeros((1, 1, 3), np.uint8))
    notes = (PartNote("blade", "the blade", "negative", "it cuts", 1.0, False),
             PartNote("handle", "the handle", "positive", "", 1.0, False))  # fmt: skip
    N_t = mesh.triangles_center[blade][:60].astype(np.float32)
    grid = DistanceField(name, np.zeros((1, 1, 1), np.float32), np.zeros(3), 0.01)
    found = [NegativeAffordance(use, np.zeros(len(blade), np.float32), np.zeros(len(blade), np.float32), blade & (use == "cut"),
                                N_t if use == "cut" else N_t[:0], grid) for use in ("cut", "")]  # fmt: skip
    said = MeshReport(name, f"{name}.obj", **{"unit": "m", "decided": "its size", "scale": 1.0, "repairs": (), "deviation_m": 0.0,
                                              "watertight": True, "bodies": 1, "size_m": (0.2, 0.02, 0.02), **report})  # type: ignore[arg-type]
    described = (PartDescription(name, "knife", "cut", notes, "rules"), PartDescription(name, "unknown", "", (), "rules"))
    return body_tasks.run(shadow(), given, MeshParts(name, ("handle", "blade"), blade.astype(np.int16)), said,
                          PartDescriptions(name, described),
                          NegativeAffordances(name, mesh.triangles_center.astype(np.float32), tuple(found)), params)  # fmt: skip


def test_tasks_hold_the_safe_part_of_a_lying_body() -> None:
    """A use with a blade is held by the handle, 2 cm off N_t; any use has no N_t; both lie on the table."""
    made = tasks_of(stick())
    assert made.refused == () and made.family == ("handle", "handle")
    assert [one.name for one in made.tasks] == ["stick/cut", "stick/any_use"]
    cut, free = made.tasks
    assert (cut.hold, cut.negative, cut.told, len(cut.N_t), len(free.N_t)) == ("handle", ("blade",), ("blade",), 60, 0)
    assert np.linalg.norm(cut.A_t[:, None] - cut.N_t[None], axis=2).min() > 0.02
    for one in made.tasks:
        assert one.body.points[:, 2].min() == pytest.approx(0, abs=1e-3) and one.body.points[:, 2].max() < 0.03
        assert one.body.mass_kg == pytest.approx(700 * 0.2 * 0.025 * 0.02, rel=0.01)


def test_a_body_whose_parts_are_refused_is_grasped_by_its_shape() -> None:
    """A block that is too wide for a hand, with a bar beside it: the bar is a piece, held without N_t, and the refusals stay."""
    block, bar = trimesh.creation.box((0.14, 0.14, 0.14)).subdivide(), trimesh.creation.box((0.02, 0.02, 0.12)).subdivide()
    arm = trimesh.creation.box((0.04, 0.02, 0.02)).subdivide().apply_translation((-0.085, 0, 0.05))
    params = replace(FEW, density_kg_m3=100, points=600, hulls=12)
    made = tasks_of(block + arm + bar.apply_translation((-0.115, 0, 0)), params=params)
    assert len(made.refused) == 2 and all("no stable pose" in line for line in made.refused)
    (one,) = made.tasks
    assert one.name == "stick/geometry_alone" and one.hold.startswith("piece") and one.negative == () and not len(one.N_t)
    assert "by geometry alone" in made.notes[-1] and made.family == ("handle",)


def test_a_standing_body_is_laid_down() -> None:
    """The pose of the file does not matter: an upright stick is grasped lying, and N_t and body turn together."""
    upright = stick()
    upright.apply_transform(trimesh.transformations.rotation_matrix(np.pi / 2, (0, 1, 0)))
    upright.apply_transform(trimesh.transformations.rotation_matrix(np.pi, (0, 0, 1)))
    made = tasks_of(upright)
    assert made.tasks and all(one.body.points[:, 2].max() < 0.03 for one in made.tasks)


@pytest.mark.parametrize(("size", "word"), [
    ((0.2, 0.1, 0.0005), "thickness"), ((0.4, 0.3, 0.3), "at most 3 kg"), ((0.4, 0.24, 0.22), "no stable pose has a place"),
], ids=["sheet", "crate", "too wide"])  # fmt: skip
def test_bodies_that_no_hand_lifts_are_refused(size: tuple[float, float, float], word: str) -> None:
    """One sentence each, and no exception: other objects go on."""
    params = body_tasks.Params(points=300, hulls=6, density_kg_m3=700 if "kg" in word else 100)
    made = tasks_of(stick(size=size), params=params)
    assert made.tasks == () and made.refused and all(word in line and "\n" not in line for line in made.refused)


def test_flat_and_empty_meshes_are_refused() -> None:
    """No volume, and no face."""
    plane = trimesh.Trimesh([[0, 0, 0], [0.1, 0, 0], [0, 0.1, 0], [0.1, 0.1, 0]], [[0, 1, 2], [1, 3, 2]], process=False)
    empty = trimesh.Trimesh([[0, 0, 0]], np.zeros((0, 3), int), process=False)
    assert "0.0 mm" in tasks_of(plane).refused[0] and "got 0 points" in tasks_of(empty).refused[0]


def test_a_skin_without_mass_is_refused() -> None:
    """A closed surface that encloses nearly nothing, of which an engine would make a body of no weight."""
    skin, inside = trimesh.creation.box((0.06, 0.06, 0.06)), trimesh.creation.box((0.0599999, 0.0599999, 0.0599999))
    inside.invert()
    made = tasks_of(skin + inside)
    assert made.tasks == () and len(made.refused) == 1 and "0.5 g or more" in made.refused[0]


def test_a_vessel_weighs_what_its_walls_do() -> None:
    """An object called bottle is empty and says so; `walls=false` makes it solid."""
    size = (0.06, 0.06, 0.2)
    empty, solid = (tasks_of(stick(size=size), "bottle", replace(FEW, walls=walls), category="bottle") for walls in (True, False))
    assert empty.tasks[0].body.mass_kg == pytest.approx(0.0552 * 0.001 * 950, rel=0.01) and "plastic" in empty.notes[0]
    assert solid.tasks[0].body.mass_kg == pytest.approx(700 * 0.06 * 0.06 * 0.2, rel=0.01) and solid.notes == ()


def test_assumptions_are_sentences() -> None:
    """Unit by size, several bodies."""
    made = tasks_of(stick(), unit="mm", bodies=3)
    assert "taken for mm" in made.notes[0] and "3 separate bodies" in made.notes[1] and len(made.notes) == 2


def test_an_evaluation_and_its_report(tmp_path: Path) -> None:
    """Two episodes of each task; a refused object has none, and its reason is in the report; AS counts tasks with N_t."""
    good, bad, ctx = tasks_of(stick()), tasks_of(stick(size=(0.2, 0.1, 0.0005)), "sheet"), Ctx(tmp_path)
    policy = teacher(tmp_path / "policy", steps=44)
    params = body_evaluate.Params(engine="mujoco", episodes=4, at_once=2, iterations=20, rate_hz=240)
    runs = [body_evaluate.run(shadow(), one.tasks, policy, params, ctx) for one in (good, bad)]  # type: ignore[arg-type]
    assert [len(one.task) for one in runs] == [4, 0] and [len(one.traces) for one in runs] == [1, 0]
    names = tuple(file_tree(name) for name in ("stick", "sheet", "room"))
    points = [Point(step, f"val.{name}", 0.1 * step) for step in (0, 2) for name in ("score", "success", "held")]
    logs = (training_log("stick", points, 2, 4), training_log("sheet", (), 0, 0))
    tried = (replace(good, notes=("stick/cut: at the blade",)), bad)
    page = body_report.run(names, (good, bad), tuple(runs), logs, body_report.Params(), ctx, tried)  # type: ignore[arg-type]
    text = page.find("report.md").path.read_text()  # type: ignore[union-attr]
    found = json.loads(page.find("metrics.json").path.read_text())  # type: ignore[union-attr]
    assert "sheet: expected a body" in text and "room: could not be read" in text and "| stick | teacher | mujoco |" in text
    assert "| stick | 0.0 | 20.0 | 0.0 | 20.0 | round 2 of 4 |" in text and "| sheet | 0" not in text
    assert text.index("Places by trial") < text.index("- stick/cut: at the blade") and text.count("at the blade") == 1
    assert (found["objects"], found["objects_refused"], found["teacher.mujoco.tasks_with_negative"]) == (3, 2, 1)
    assert 0 <= found["teacher.mujoco.succ"] <= 1


def file_tree(name: str):  # type: ignore[no-untyped-def]  # a FileTree
    from schemas.files import FileTree

    return FileTree(name, ())


def test_the_graph_with_and_without_a_source(tmp_path: Path) -> None:
    """Meshes: evaluation of a policy in both engines, no training of motion; no source: the stages as they are."""
    write_obj(tmp_path / "stick.obj", stick().vertices, stick().faces)
    place, found = origin("grasp", tmp_path, Settings(), file_digest)
    graph = build("grasp", place._replace(name="mine"), Settings.of()) if found else None
    assert graph is not None and [one.name for one in place.meshes] == ["stick"]
    names = {node.name for node in graph.stages()}
    assert {"mesh_read", "part_segment", "body_tasks", "body_choose", "bodies_bullet", "tried_mujoco", "body_report"} <= names
    once = build("grasp", place._replace(name="mine"), Settings.of(body_choose=body_choose.Params(options=1)))
    assert not {"body_choose", "tried_bullet"} & {node.name for node in once.stages()}
    usual = {node.name for node in build("grasp", origin("grasp", None, Settings(), file_digest)[0], Settings()).stages()}
    assert not {"mesh_read", "body_tasks"} & usual and {"teacher_0", "no_negative_0"} <= usual
    with pytest.raises(UsageError, match="got nothing"):
        origin("grasp", tmp_path / "absent", Settings(), file_digest)
