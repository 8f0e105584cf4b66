"""Objects that only training kitchens contain: EPIC nouns, sound meshes and natural grasps."""

from __future__ import annotations

import csv
import functools
from pathlib import Path

import numpy as np
import pytest

from afford.render.mesh import merge
from afford.render.motion import axis_angle, pose
from afford.synthetic.assets import library
from afford.synthetic.assets.object_model import ObjectModel
from afford.synthetic.human_hand.skeleton import distance_to
from afford.synthetic.kitchens.scene_builder import plain_name
from afford.synthetic.kitchens.vocabulary import FIRST_NEW_NOUN, noun_class
from afford.synthetic.splits import (
    EXTRA_TRAINED_KINDS,
    KNOWN_KINDS,
    NEW_KINDS,
    TEST_KINDS,
    TRAINED_KINDS,
    accepts_task,
    is_held_out,
    object_kinds,
)
from afford.synthetic.stills.grasp_options import ReachModel, grasp_plans
from afford.synthetic.stills.table_layout import PlacedObject
from afford.synthetic.stills.task_catalogue import tasks_for

CLASSES = Path(__file__).resolve().parents[3] / "shared" / "data" / "epic_P03_101" / "EPIC_100_noun_classes_v2.csv"
STICKS = ("ladle", "fork", "whisk", "brush")


@functools.cache
def thing(kind: str, seed: int = 3) -> ObjectModel:
    """Build one object of this kind."""
    return library.build(kind, np.random.default_rng(seed))


def placed(kind: str, x: float, number: int = 0, yaw: float = 0.0) -> PlacedObject:
    """Place an object 30 cm away from the person."""
    model = thing(kind)
    T = pose((x, 0.30, 0.0), axis_angle((0, 0, 1), yaw))
    points = (model.points @ T[:3, :3].T + T[:3, 3])[:, :2]
    (left, near), (right, far) = points.min(axis=0), points.max(axis=0)
    return PlacedObject(number, model, T, np.array([(left, near), (right, near), (right, far), (left, far)], np.float32))


def feasible_tasks(verb: str, *objects: PlacedObject) -> list[tuple[str, set[int], set[str]]]:
    """Return (sentence, taxonomies, gripped parts) of every feasible task with this verb and all of these objects."""
    names = {one.number: plain_name(one.model.noun) for one in objects}
    wanted = [task for task in tasks_for(objects, names) if task.verb == verb and len(task.objects) == len(objects)]
    found = [(task.text, grasp_plans(task, ReachModel(objects))) for task in wanted]
    return [(text, {plan.taxonomy for plan in made}, {option.grip.name for plan in made for option in plan.options if option})
            for text, made in found if made]


# -- the objects --------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("kind", EXTRA_TRAINED_KINDS)
@pytest.mark.parametrize("seed", [0, 3, *(pytest.param(seed, marks=pytest.mark.slow) for seed in (1, 2))])
def test_objects_rest_on_the_table_for_every_seed(kind: str, seed: int) -> None:
    """The lowest point is on the table, the size is plausible, and faces and normals are valid."""
    model = thing(kind, seed)
    assert abs(float(model.points[:, 2].min())) < 0.002 and 0.09 < model.size.max() < 0.36
    for part in model.parts:
        assert np.isfinite(part.mesh.vertices).all() and part.mesh.faces.max() < len(part.mesh.vertices)
        np.testing.assert_allclose(np.linalg.norm(part.mesh.normals, axis=1), 1, atol=1e-3)


@pytest.mark.parametrize("kind", EXTRA_TRAINED_KINDS)
def test_surfaces_face_outwards(kind: str) -> None:
    """Faces point away from the middle of their part, so parts are not inside out."""
    model = thing(kind)
    for part in (part for part in model.parts if part.name not in ("inside", "bowl")):
        corners = part.mesh.vertices[part.mesh.faces].astype(float)
        middle = part.mesh.vertices.mean(axis=0)
        normal = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
        assert float(np.sum(normal * (corners.mean(axis=1) - middle))) > 0, part.name


@pytest.mark.parametrize("kind", EXTRA_TRAINED_KINDS)
@pytest.mark.parametrize("side", ["left", "right"])
def test_grips_hold_the_named_part(kind: str, side: str) -> None:
    """The named part, or the body, is within a finger's reach of the palm, and the palm is not inside the object."""
    model = thing(kind)
    whole = merge(*(part.mesh for part in model.parts))
    for grip in model.grips_of(side):
        named = [part for part in model.parts if part.name == grip.name] or list(model.parts)
        points = np.concatenate([part.mesh.vertices for part in named])
        assert np.linalg.norm(points - grip.T_obj_palm[:3, 3], axis=1).min() < 0.09, grip.name
        assert distance_to(whole, np.linalg.inv(grip.T_obj_palm), side, samples=3000)(np.zeros((1, 3)))[0] > -0.012, grip.name


@pytest.mark.parametrize("kind", EXTRA_TRAINED_KINDS)
def test_grips_of_left_and_right_are_mirror_images(kind: str) -> None:
    """Right palms are not to the left of left palms in the object frame."""
    model = thing(kind)
    right, left = (sorted(grip.T_obj_palm[0, 3] for grip in model.grips_of(side)) for side in ("right", "left"))
    np.testing.assert_allclose(right, np.negative(left)[::-1], atol=1e-9)
    assert min(right) > -0.02


# -- tasks and grasps ---------------------------------------------------------------------------------------------------


def test_kinds_occur_in_training_kitchens_only() -> None:
    """The benchmark's kinds are unchanged, and no kind is held out from training."""
    others = {*KNOWN_KINDS, *NEW_KINDS, *(kind for pool in TEST_KINDS.values() for kind in pool)}
    assert len(set(TRAINED_KINDS)) == 20 and not set(EXTRA_TRAINED_KINDS) & others
    assert object_kinds("kitchen", "known", "train") == object_kinds("kitchen", "known", "val") == TRAINED_KINDS
    for setting, pool in TEST_KINDS.items():
        assert object_kinds(setting, "any", "test") == pool and object_kinds(setting, "new", "test") == (*pool, *NEW_KINDS)
    assert all(accepts_task("known", is_held_out("take", (kind,))) for kind in EXTRA_TRAINED_KINDS)
    assert is_held_out("stir", ("ladle", "pan")) and not is_held_out("stir", ("ladle", "pot"))


@pytest.mark.parametrize("kind", EXTRA_TRAINED_KINDS)
def test_take_uses_one_hand_on_the_natural_part(kind: str) -> None:
    """One hand takes the part that people take."""
    part = {"glass": {"body", "rim"}, "grinder": {"body"}}.get(kind, {"handle"})
    found = [feasible_tasks("take", placed(kind, x, yaw=yaw)) for x in (-0.1, 0.1) for yaw in (-0.5, 0.0, 0.5)]
    assert any(found)
    assert all(taxonomies <= {0, 1} and parts <= part for options in found for _, taxonomies, parts in options)


def test_pot_is_carried_and_grinder_turned_with_two_hands() -> None:
    """The pot is taken by its handles, the grinder by head and body."""
    assert {(*taxonomies, *parts) for _, taxonomies, parts in feasible_tasks("carry", placed("pot", 0.0))} == {(2, "handle")}
    turn = [(taxonomies, parts) for _, taxonomies, parts in feasible_tasks("turn", placed("grinder", 0.0))]
    assert turn == [({2}, {"head", "body"})]


@pytest.mark.parametrize(("verb", "tool", "target", "text"), [
    ("pour", "jug", "glass", "pour from jug into glass"),
    ("stir", "ladle", "pot", "stir pot with ladle"),
    ("stir", "whisk", "bowl", "stir bowl with whisk"),
    ("wash", "brush", "plate", "wash plate with brush"),
])  # fmt: skip
def test_tool_use_takes_both_hands(verb: str, tool: str, target: str, text: str) -> None:
    """One hand holds the tool and the other its target, side by side on a table."""
    objects = placed(tool, 0.14), placed(target, -0.12, number=1)
    found = {sentence: (taxonomies, parts) for sentence, taxonomies, parts in feasible_tasks(verb, *objects)}
    assert 3 in found[text][0] and "handle" in found[text][1]


# -- nouns --------------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("kind", EXTRA_TRAINED_KINDS)
def test_nouns_are_epic_classes(kind: str) -> None:
    """Id, key and category are EPIC's, and the word is in EPIC's table."""
    if not CLASSES.exists():
        pytest.skip("no EPIC class file beside the project")
    noun = thing(kind).noun
    mine = noun_class(noun)
    with CLASSES.open(newline="") as file:
        row = next(row for row in csv.DictReader(file) if int(row["id"]) == mine.id)
    assert mine.id < FIRST_NEW_NOUN and f"'{noun}'" in row["instances"]
    assert (row["key"], row["category"]) == (mine.key, mine.category)


@pytest.mark.parametrize("kind", STICKS)
def test_tools_lie_along_y_with_the_handle_near(kind: str) -> None:
    """The handle is near the person, the working end beyond it."""
    model = thing(kind)
    handle = next(part.mesh.vertices for part in model.parts if part.name == "handle")
    assert model.tip is not None and handle[:, 1].mean() < 0 < model.tip[1] and model.size.argmax() == 1
