"""Household bodies: shapes with walls, masses, tasks in three poses, places by family, report and films by family."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import trimesh

from afford.grasping.env.families import GraspPlace, grasp_places
from afford.grasping.env.placed_worlds import REACH_M, best_place
from afford.grasping.evaluate.household_report import by_family, write_report
from afford.grasping.sim.grasp_object import grasp_object
from afford.grasping.sim.walls import WALLS, Wall, with_wall
from afford.surface.describe.household import household_category, household_look_up, uses_of
from afford.synthetic.objects import open_vessels, packages
from afford.synthetic.objects.household_bodies import CATEGORIES, HELD_OUT, STANDING, build_body
from afford.synthetic.splits import object_specs
from maps.settings import Origin, Settings
from pipeline import build
from schemas.bodies import BodyTasks
from schemas.files import FileTree
from schemas.mesh import MeshParts, ObjectMesh
from stages.grasping import body_report, household_tasks
from stages.synthetic import household_build, household_plan
from tests.helpers.made_hands import shadow
from tests.helpers.made_traces import episodes, hammer

NEW = (*open_vessels.BUILDERS, *packages.BUILDERS)


def test_categories_and_those_held_out() -> None:
    """Twenty or more, five of them in the split `unseen` alone; every one has uses in the lexicon."""
    assert len(set(CATEGORIES)) == len(CATEGORIES) >= 20 and len(set(HELD_OUT)) == 5
    specs = household_plan.run(household_plan.Params(splits=("train", "seen", "unseen")))
    split = {name: {one.split for one in specs if one.category == name} for name in CATEGORIES}
    assert all(split[name] == ({"unseen"} if name in HELD_OUT else {"train", "seen"}) for name in CATEGORIES)
    assert all(uses_of(name) for name in CATEGORIES) and WALLS.keys() == {household_category(name) for name in WALLS}
    with pytest.raises(ValueError, match="anvil"):
        household_plan.run(household_plan.Params(categories=("anvil",)))


@pytest.mark.parametrize("category", NEW)
def test_bodies_are_closed_with_labelled_parts_of_the_lexicon(category: str) -> None:
    """One watertight surface; sizes differ between bodies; parts are those that the lexicon describes."""
    made = [build_body(spec, 0.02, 16_000) for spec in object_specs("seen", (category,), 2, 5, 1)]
    for one in made:
        solid = trimesh.Trimesh(one.mesh.vertices, one.mesh.faces)
        assert solid.is_watertight and solid.body_count == 1 and solid.volume > 0
        described = {note.part for note in household_look_up("x", category, uses_of(category)[0]).notes}
        assert set(one.parts.names) == described and set(one.parts.part.tolist()) == set(range(len(one.parts.names)))
        assert 0.05 < np.ptp(one.mesh.vertices, axis=0).max() < 0.4
    assert not np.allclose(*(np.ptp(one.mesh.vertices, axis=0) for one in made))


def mesh_of(solid: trimesh.Trimesh, category: str = "") -> ObjectMesh:
    return ObjectMesh("thing", category, solid.vertices.astype(np.float32), solid.faces.astype(np.int32),
                      np.zeros((len(solid.faces), 3, 2), np.float32), np.zeros((1, 1, 3), np.uint8))  # fmt: skip


def test_walls_of_a_solid_and_of_a_hollow_sphere() -> None:
    """A solid sphere becomes a shell, 2/3 m r^2; one with thin walls keeps its volume, and only its density changes."""
    outer, inner = trimesh.creation.icosphere(4, 0.05), trimesh.creation.icosphere(4, 0.049)
    inner.invert()
    wall = Wall(0.002, 1000.0, "plastic")
    for solid, volume in ((outer, 4 * np.pi * 0.05**2 * 0.002), (outer + inner, 4 / 3 * np.pi * (0.05**3 - 0.049**3))):
        mesh = mesh_of(solid)
        body = grasp_object(mesh, MeshParts("thing", ("body",), np.zeros(len(mesh.faces), np.int16)), 700.0, 0.002, 1, 16, 50, 0)
        made = with_wall(mesh, body, float(solid.volume), wall)
        assert made.mass_kg == pytest.approx(1000 * volume, rel=0.02)
        np.testing.assert_allclose(made.inertia_kgm2, 2 / 3 * made.mass_kg * 0.05**2 * np.eye(3), rtol=0.05, atol=1e-8)
        np.testing.assert_allclose(made.com_m, 0, atol=1e-5)


def places(category: str, part: str, negative: str = "", task: str = "") -> list[GraspPlace]:
    """Places on a part of a standing body of a category."""
    built = build_body(object_specs("seen", (category,), 1, 5, 1)[0], 0.01, 16_000)
    solid = trimesh.Trimesh(built.mesh.vertices, built.mesh.faces, process=False)
    spots, face = trimesh.sample.sample_surface_even(solid, 1500, seed=0)
    on = built.parts.part[face]
    bad = spots[on == built.parts.names.index(negative)] if negative else np.zeros((0, 3))
    return grasp_places(spots, solid.face_normals[face], on == built.parts.names.index(part), bad[:200], solid.center_mass, task)


def test_family_of_each_part() -> None:
    """An upright bow is a handle, from outside; a bowl has a rim, which is no loop; a can is a body; an arch is no rim."""
    bow = places("pitcher", "handle", "rim", "pour water")[0]
    assert bow.family == "handle" and bow.approach[1] > 0.9 and abs(bow.along[2]) == 1
    rim = places("bowl", "rim")
    assert rim[0].family == "rim" and "hook" not in [one.family for one in rim]
    assert places("can", "body", "lid", "drink lemonade")[0].family == "body"
    assert {one.family for one in places("bucket", "handle")} <= {"handle", "hook"}
    assert places("bucket", "rim")[0].family == "rim"


def test_a_wide_vessel_is_not_pinched_below_its_rim() -> None:
    """Fingers from above would have to pass the wall."""
    assert places("bowl", "body", "rim", "hand over the bowl") == []


def tasks_of(category: str, **changes: object) -> BodyTasks:
    built = household_build.run(object_specs("seen", (category,), 1, 5, 1)[0], household_build.Params(edge_m=0.02))
    params = household_tasks.Params(**{"points": 300, "hulls": 3, "uses": 1, **changes})  # type: ignore[arg-type]
    return household_tasks.run(shadow(), built.mesh, built.parts, params)


def test_tasks_upright_flat_and_dropped() -> None:
    """Names end with the pose; N_t is on the true negative part; upright is taller than flat; a can weighs what its walls do."""
    made = tasks_of("can")
    assert [one.name.split("/")[1:] for one in made.tasks] == [[pose, "drink_lemonade"] for pose in ("upright", "flat", "dropped")]
    upright, flat, _ = made.tasks
    lid = flat.body.points[flat.body.point_part == flat.body.parts.index("lid")]
    assert len(flat.N_t) == 100 and np.linalg.norm(flat.N_t[:, None] - lid[None], axis=2).min(1).max() < 1e-4
    assert upright.body.size_m[2] > flat.body.size_m[2] + 0.005 and 0.02 < flat.body.mass_kg < 0.2
    assert all(one.body.points[:, 2].min() > -0.002 for one in made.tasks)
    assert best_place(upright).at_m[2] == pytest.approx(upright.body.points[:, 2].max() - REACH_M, abs=1e-3)


def test_tools_lie_and_are_never_upright() -> None:
    """A tool has its flat pose alone."""
    assert "screwdriver" not in STANDING
    made = tasks_of("screwdriver", poses=("upright", "flat"))
    assert [one.name.split("/")[1] for one in made.tasks] == ["flat"] and made.refused == ()


def test_report_and_films_by_family(tmp_path: Path) -> None:
    """Episodes are counted by family, pose and category; the film of a family has only its traces."""
    run = episodes()
    bodies = (BodyTasks("hammer", (hammer(),), ("handle",), ("hammer/x/upright: no place",), ()),)
    found = write_report(bodies, (run,), ("hammer",), tmp_path)
    text, figures = (found.find(name).path.read_text() for name in ("report.md", "metrics.json"))  # type: ignore[union-attr]
    assert "| handle |" in text and "## Refused" in text and "| held out |" in text
    key = f"{run.policy}.{run.engine}.family.handle.succ"
    assert json.loads(figures)[key] == pytest.approx(float((run.figure("success") > 0).mean()))
    (film,) = by_family(bodies, run, 1)
    assert film.name == f"handle-{run.engine}" and len(film.traces) == 1
    with pytest.raises(ValueError, match="one body or more"):
        write_report((), (run,), (), tmp_path)


def test_graph_trains_nothing_where_a_teacher_is_shipped() -> None:
    """Bodies, both engines, films of each, and a report."""
    chosen = replace(Settings(), weights=(("shipped_body_refinement", FileTree("t", ())),))
    graph = build("grasp-household", Origin("x"), chosen)
    names = {node.name for node in graph.stages()}
    assert {"household_tasks", "bodies_bullet", "bodies_mujoco", "household_report", "grasp_record_mujoco"} <= names
    assert not {"hand_imitation", "teacher_0", "body_refinement"} & names


def test_graph_of_both_policies() -> None:
    """Rows of the teacher of flat tools and of bodies; without a shipped one, that of bodies is trained from the teacher."""
    both = Settings().with_stages(body_report=body_report.Params(policies=("teacher", "bodies")))
    chosen = replace(both, weights=(("shipped_rl_grasp_refinement", FileTree("t", ())),))
    names = {node.name for node in build("grasp-household", Origin("x"), chosen).stages()}
    rows = {f"{policy}_{engine}" for policy in ("teacher", "bodies") for engine in ("bullet", "mujoco")}
    assert rows | {"body_refinement", "lesson_household_tasks"} <= names and "teacher_0" not in names
    with pytest.raises(ValueError, match="expected some of teacher, bodies, got bodeis"):
        build("grasp-household", Origin("x"), chosen.with_stages(body_report=body_report.Params(policies=("bodeis",))))
