"""Grasp tasks of a mesh of the user: checks, rigid body, the part to hold of each use, and the pose in which it is laid."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.spatial.transform import Rotation

from afford.grasping.env.body_parts import one_part, parted_as_mesh, parted_by_pieces, whole
from afford.grasping.env.families import THIN_M, WIDE_M
from afford.grasping.env.measures import SAFE_M
from afford.grasping.env.rest_choice import Turns, laid, places_of, ranked_options, steady_turns
from afford.grasping.env.task import NEGATIVE_POINTS, spread_points
from afford.grasping.env.task_rules import safe_points, with_predicted_negative
from afford.grasping.sim.engine import make_world
from afford.grasping.sim.grasp_object import grasp_object
from afford.grasping.sim.rest_poses import placed_rest_pose
from afford.grasping.sim.scene import Scene
from afford.grasping.sim.walls import WALLS, with_wall
from afford.surface.describe.household import household_category
from schemas.bodies import BodyTasks
from schemas.grasp import GraspObject, GraspTask
from schemas.hand import HandModel
from schemas.mesh import MeshParts, MeshReport, ObjectMesh
from schemas.surface import NegativeAffordances, PartDescription, PartDescriptions

NONE = np.zeros((0, 3))
ANY_USE, GEOMETRY = "any use", "geometry alone"
LEAST_KG = 0.0005
"""lighter bodies are a mistake of the mesh, and physics engines diverge on them"""
LEAST_FILLED = 0.1
"""faces of an open mesh that enclose less of its hulls enclose no volume, as a sheet"""


@dataclass(frozen=True)
class BodySettings:
    """Settings of body_tasks."""

    density_kg_m3: float
    tolerance_m: float
    hulls: int
    hull_corners: int
    points: int
    seed: int
    least_fit: float
    most_kg: float
    turns: int
    walls: bool
    by_part: bool


def body_tasks(hand: HandModel, mesh: ObjectMesh, parts: MeshParts, report: MeshReport, descriptions: PartDescriptions,
               found: NegativeAffordances, settings: BodySettings, listed: Turns | None = None) -> BodyTasks:  # fmt: skip
    """Turn a mesh into the tasks that a hand can do with it; reasons for the other uses.

    It is laid in one of the `listed` poses where there are any, else in a stable one.
    """
    try:
        body = rigid_body(mesh, parts, settings)
    except ValueError as error:
        return BodyTasks(mesh.name, (), (), (str(error),), assumptions(report))
    tasks, refused, turns = list[GraspTask](), list[str](), listed or steady_turns(body)
    for one in descriptions.descriptions:
        try:
            task = with_predicted_negative(use_task(body, one), found)
            tasks.append(laid_task(hand, task, ranked_options(held_tasks(task, one), turns), settings))
        except ValueError as error:
            refused.append(str(error))
    notes = [*assumptions(report), *_weighed(mesh, body, settings)]
    if not tasks:
        notes += _by_geometry(hand, body, turns, settings, tasks, refused)
    family = tuple(places_of(one)[0].family for one in tasks)
    return BodyTasks(mesh.name, tuple(tasks), family, tuple(refused), tuple(notes))


def _by_geometry(hand: HandModel, body: GraspObject, turns: Turns, settings: BodySettings, tasks: list[GraspTask],
                 refused: list[str]) -> list[str]:  # fmt: skip
    """Add a task without parts, uses or N_t to `tasks`, or a sentence to `refused`; a sentence on what was assumed."""
    options = [GraspTask(f"{body.name}/{GEOMETRY.replace(' ', '_')}", "", "", shape, (), part, NONE, (), NONE)
               for shape in (one_part(body), parted_by_pieces(body)) for part in shape.parts]  # fmt: skip
    try:
        tasks.append(laid_task(hand, options[0], ranked_options(options, turns), settings))
    except ValueError as error:
        refused.append(str(error))
        return []
    return [f"{body.name}: no use has a place for a hand on the parts that were found (under Refused); it is grasped by geometry "
            "alone, without N_t; label its parts, docs/surface/mesh-format.md, or say what to hold with --uses"]  # fmt: skip


def _weighed(mesh: ObjectMesh, body: GraspObject, s: BodySettings) -> tuple[str, ...]:
    """Sentence on the mass of a vessel."""
    kind = household_category(mesh.category)
    if not s.walls or kind not in WALLS:
        return ()
    wall = WALLS[kind]
    return (f"{mesh.name}: is an empty {kind.replace('_', ' ')} of {wall.of} with walls of at most {1000 * wall.thick_m:g} mm, "
            f"{body.mass_kg:.2f} kg; if it is solid or filled, set body_tasks.walls=false and .density_kg_m3",)  # fmt: skip


def assumptions(report: MeshReport) -> tuple[str, ...]:
    """Sentences on what was assumed or repaired while a mesh was read."""
    out = list[str]()
    if report.unit != "m" and report.decided == "its size":
        out.append(f"{report.name}: its numbers are taken for {report.unit}, the only unit in which it fits a hand; "
                   f"if not, set mesh_read.unit")  # fmt: skip
    if report.bodies > 1:
        out.append(f"{report.name}: has {report.bodies} separate bodies, which are grasped as one rigid body")
    simplified = sum(repair.count for repair in report.repairs if "simplifying" in repair.what)
    if simplified:
        out.append(f"{report.name}: {simplified} faces were taken out, to at most mesh_read.max_faces; the surface moved by "
                   f"{1000 * report.deviation_m:.1f} mm at most")  # fmt: skip
    return tuple(out)


def check_extent(mesh: ObjectMesh) -> None:
    """Raise ValueError for a mesh that is flat, or thinner than what a hand picks up from a table."""
    spots = mesh.vertices[np.unique(mesh.faces)].astype(np.float64) if len(mesh.faces) else NONE
    if len(spots) < 4:
        raise ValueError(f"{mesh.name}: expected a body, got {len(spots)} points; give it a volume")
    axes = np.linalg.svd(spots - spots.mean(0), full_matrices=False)[2]
    thin = float(np.ptp((spots - spots.mean(0)) @ axes[2]))
    if thin < THIN_M:
        raise ValueError(f"{mesh.name}: expected a body of {1000 * THIN_M:.0f} mm or more everywhere, got {1000 * thin:.1f} mm, "
                         "which fingers cannot lift off a table; check its unit, or give it a thickness")  # fmt: skip


def rigid_body(mesh: ObjectMesh, parts: MeshParts, s: BodySettings) -> GraspObject:
    """Build the rigid body. ValueError, one sentence, for a mesh that cannot be one."""
    check_extent(mesh)
    cut = parts if s.by_part else whole(parts)
    body = grasp_object(mesh, cut, s.density_kg_m3, s.tolerance_m, s.hulls, s.hull_corners, s.points, s.seed)
    body = _with_volume_of(mesh, body if s.by_part else parted_as_mesh(body, mesh, parts), s.density_kg_m3)
    wall = WALLS.get(household_category(mesh.category)) if s.walls else None
    body = with_wall(mesh, body, body.mass_kg / s.density_kg_m3, wall) if wall else body
    if body.mass_kg < LEAST_KG:
        raise ValueError(f"{mesh.name}: expected {1000 * LEAST_KG:g} g or more, got {1000 * body.mass_kg:.2g} g; its faces enclose "
                         "nearly nothing: give it a thickness, or close it")  # fmt: skip
    if body.mass_kg > s.most_kg:
        raise ValueError(f"{mesh.name}: expected at most {s.most_kg:g} kg, got {body.mass_kg:.2f} kg"
                         f"{'' if wall else f' at {s.density_kg_m3:g} kg/m3'}; set body_tasks.density_kg_m3, lower for a hollow "
                         "thing, or body_tasks.most_kg")  # fmt: skip
    return body


def _with_volume_of(mesh: ObjectMesh, body: GraspObject, density_kg_m3: float) -> GraspObject:
    """Give a body of an open mesh the mass of the volume that its faces enclose, where its hulls, which overfill it, have more.

    A scan with small holes encloses nearly its volume. Centre of mass and the form of the inertia stay those of the hulls.
    """
    corner = mesh.vertices[mesh.faces].astype(np.float64) - mesh.vertices.mean(axis=0)
    mass = density_kg_m3 * float(np.einsum("fi,fi->f", corner[:, 0], np.cross(corner[:, 1], corner[:, 2])).sum()) / 6
    share = mass / body.mass_kg
    if body.closed or not LEAST_FILLED < share < 1:
        return body
    return replace(body, mass_kg=mass, inertia_kgm2=share * body.inertia_kgm2)


def use_task(body: GraspObject, one: PartDescription) -> GraspTask:
    """Create the task of a description: the largest positive part is held, else the largest that is not negative."""
    count = dict(zip(body.parts, np.bincount(body.point_part, minlength=len(body.parts)).tolist(), strict=True))
    roles = {note.part: note.role for note in one.notes}
    negative = tuple(part for part in body.parts if roles.get(part) == "negative")
    positive = [part for part in body.parts if roles.get(part) == "positive"]
    others = positive or [part for part in body.parts if part not in negative]
    use = one.task or ANY_USE
    name = f"{body.name}/{use.replace(' ', '_')}"
    if not others:
        raise ValueError(f"{name}: every part that was found must not be touched ({', '.join(negative)}); label the parts of the "
                         "mesh, docs/surface/mesh-format.md")  # fmt: skip
    return GraspTask(name, "", one.task, body, negative, max(others, key=lambda part: count[part]), NONE, negative, NONE)


def held_tasks(task: GraspTask, one: PartDescription) -> list[GraspTask]:
    """The task with each part that may be held: those where a hand belongs, or the part of the task where there are none."""
    positive = [note.part for note in one.notes if note.role == "positive" and note.part in task.body.parts]
    return [replace(task, hold=part) for part in positive or [task.hold]]


def laid_task(hand: HandModel, wanted: GraspTask, options: Sequence[tuple[GraspTask, Rotation]], s: BodySettings,
              pose: str = "stable") -> GraspTask:  # fmt: skip
    """Lay the body of a task so that a hand can do it: the first option of task and rotation, best first, in which it rests.

    ValueError, one sentence, where it cannot.
    """
    for task, turn in options[: s.turns]:
        one = laid(task, turn)
        if places_of(one)[0].fit < s.least_fit:
            break
        if _rests(hand, one.body):
            return replace(one, A_t=spread_points(safe_points(one.body, one.hold, one.N_t), NEGATIVE_POINTS))
    where = f" {100 * SAFE_M:.0f} cm off what must not be touched" if len(wanted.N_t) else ""
    raise ValueError(f"{wanted.name}: no {pose} pose has a place on the {wanted.hold.replace('_', ' ')}{where} that a hand can "
                     f"hold: {100 * THIN_M:.1f} to {100 * WIDE_M:.0f} cm across, near the centre of mass")  # fmt: skip


def _rests(hand: HandModel, body: GraspObject) -> bool:
    """Test in MuJoCo whether a body stays as it is laid."""
    scene = Scene(hand, body)
    world = make_world("mujoco", scene)
    try:
        placed_rest_pose(world, scene)
    except ValueError:
        return False
    finally:
        world.close()
    return True
