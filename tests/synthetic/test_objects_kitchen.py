"""Laws of the objects that only training kitchens have: their nouns are EPIC's, and hands take them as people do."""

from __future__ import annotations

import csv
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


def thing(kind: str, seed: int = 3) -> ObjectModel:
    """One object of this kind."""
    return library.build(kind, np.random.default_rng(seed))


def stand(kind: str, x: float, number: int = 0, yaw: float = 0.0) -> PlacedObject:
    """A obj at a place, 30 cm away."""
    model = thing(kind)
    T = pose((x, 0.30, 0.0), axis_angle((0, 0, 1), yaw))
    points = (model.points @ T[:3, :3].T + T[:3, 3])[:, :2]
    (left, near), (right, far) = points.min(axis=0), points.max(axis=0)
    return PlacedObject(number, model, T, np.array([(left, near), (right, near), (right, far), (left, far)], np.float32))


def asked(verb: str, *objects: PlacedObject) -> list[tuple[str, set[int], set[str]]]:
    """(sentence, taxonomies, parts that are taken) of everything that can be done with this verb and all of these objects."""
    names = {placed.number: plain_name(placed.model.noun) for placed in objects}
    wanted = [task for task in tasks_for(objects, names) if task.verb == verb and len(task.objects) == len(objects)]
    found = [(task.text, grasp_plans(task, ReachModel(objects))) for task in wanted]
    return [(text, {plan.taxonomy for plan in made}, {option.grip.name for plan in made for option in plan.options if option})
            for text, made in found if made]


# -- the objects ---------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("kind", EXTRA_TRAINED_KINDS)
@pytest.mark.parametrize("seed", range(4))
def test_every_seed_gives_a_thing_that_rests_on_the_table(kind: str, seed: int) -> None:
    """Lowest point on the table, no larger than a kitchen obj, faces and normals sound."""
    model = thing(kind, seed)
    assert abs(float(model.points[:, 2].min())) < 0.002 and 0.09 < model.size.max() < 0.36
    for part in model.parts:
        assert np.isfinite(part.mesh.vertices).all() and part.mesh.faces.max() < len(part.mesh.vertices)
        np.testing.assert_allclose(np.linalg.norm(part.mesh.normals, axis=1), 1, atol=1e-3)


@pytest.mark.parametrize("kind", EXTRA_TRAINED_KINDS)
def test_surfaces_look_outwards(kind: str) -> None:
    """Seen from afar most of what is nearest faces the eye: parts are not inside out."""
    model = thing(kind)
    for part in (part for part in model.parts if part.name not in ("inside", "bowl")):
        corners = part.mesh.vertices[part.mesh.faces].astype(float)
        middle = part.mesh.vertices.mean(axis=0)
        normal = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
        assert float(np.sum(normal * (corners.mean(axis=1) - middle))) > 0, part.name


@pytest.mark.parametrize("kind", EXTRA_TRAINED_KINDS)
@pytest.mark.parametrize("side", ["left", "right"])
def test_hands_hold_the_part_that_they_name(kind: str, side: str) -> None:
    """The part of that name, or the body, is within a finger's reach of the palm, and the palm is not inside the obj."""
    model = thing(kind)
    whole = merge(*(part.mesh for part in model.parts))
    for grip in model.grips_of(side):
        named = [part for part in model.parts if part.name == grip.name] or list(model.parts)
        points = np.concatenate([part.mesh.vertices for part in named])
        assert np.linalg.norm(points - grip.T_obj_palm[:3, 3], axis=1).min() < 0.09, grip.name
        assert distance_to(whole, np.linalg.inv(grip.T_obj_palm), side, samples=3000)(np.zeros((1, 3)))[0] > -0.012, grip.name


@pytest.mark.parametrize("kind", EXTRA_TRAINED_KINDS)
def test_either_hand_takes_its_own_side(kind: str) -> None:
    """Right palms are not to the left of left palms in the obj's frame: grips are mirror images."""
    model = thing(kind)
    right, left = (sorted(grip.T_obj_palm[0, 3] for grip in model.grips_of(side)) for side in ("right", "left"))
    np.testing.assert_allclose(right, np.negative(left)[::-1], atol=1e-9)
    assert min(right) > -0.02


# -- what is asked ------------------------------------------------------------------------------------------------------


def test_only_training_kitchens_have_them() -> None:
    """The benchmark's rooms draw from what they always drew from; nothing that is new to training is among them."""
    others = {*KNOWN_KINDS, *NEW_KINDS, *(kind for pool in TEST_KINDS.values() for kind in pool)}
    assert len(set(TRAINED_KINDS)) == 20 and not set(EXTRA_TRAINED_KINDS) & others
    assert object_kinds("kitchen", "known", "train") == object_kinds("kitchen", "known", "val") == TRAINED_KINDS
    for setting, pool in TEST_KINDS.items():
        assert object_kinds(setting, "any", "test") == pool and object_kinds(setting, "new", "test") == (*pool, *NEW_KINDS)
    assert all(accepts_task("known", is_held_out("take", (kind,))) for kind in EXTRA_TRAINED_KINDS)
    assert is_held_out("stir", ("ladle", "pan")) and not is_held_out("stir", ("ladle", "pot"))


@pytest.mark.parametrize("kind", EXTRA_TRAINED_KINDS)
def test_every_kind_is_taken_in_the_middle(kind: str) -> None:
    """By one hand, and by the part that people take."""
    part = {"glass": {"body", "rim"}, "grinder": {"body"}}.get(kind, {"handle"})
    found = [asked("take", stand(kind, x, yaw=yaw)) for x in (-0.1, 0.1) for yaw in (-0.5, 0.0, 0.5)]
    assert any(found)
    assert all(taxonomies <= {0, 1} and parts <= part for options in found for _, taxonomies, parts in options)


def test_two_hands_carry_a_pot_and_turn_a_mill() -> None:
    """The pot by its handles, the mill by head and body."""
    assert {(*taxonomies, *parts) for _, taxonomies, parts in asked("carry", stand("pot", 0.0))} == {(2, "handle")}
    assert [(taxonomies, parts) for _, taxonomies, parts in asked("turn", stand("grinder", 0.0))] == [({2}, {"head", "body"})]


@pytest.mark.parametrize(("verb", "tool", "target", "text"), [
    ("pour", "jug", "glass", "pour from jug into glass"),
    ("stir", "ladle", "pot", "stir pot with ladle"),
    ("stir", "whisk", "bowl", "stir bowl with whisk"),
    ("wash", "brush", "plate", "wash plate with brush"),
])  # fmt: skip
def test_one_hand_uses_it_and_the_other_holds_what_it_is_used_on(verb: str, tool: str, target: str, text: str) -> None:
    """Side by side on a table."""
    objects = stand(tool, 0.14), stand(target, -0.12, number=1)
    found = {said: (taxonomies, parts) for said, taxonomies, parts in asked(verb, *objects)}
    assert 3 in found[text][0] and "handle" in found[text][1]


# -- their names --------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("kind", EXTRA_TRAINED_KINDS)
def test_nouns_are_classes_of_epic(kind: str) -> None:
    """With EPIC's id, key and category, and a word that EPIC's map has."""
    if not CLASSES.exists():
        pytest.skip("no EPIC class file beside the project")
    noun = thing(kind).noun
    mine = noun_class(noun)
    with CLASSES.open(newline="") as file:
        row = next(row for row in csv.DictReader(file) if int(row["id"]) == mine.id)
    assert mine.id < FIRST_NEW_NOUN and f"'{noun}'" in row["instances"]
    assert (row["key"], row["category"]) == (mine.key, mine.category)


@pytest.mark.parametrize("kind", STICKS)
def test_tools_lie_along_y_with_their_handle_near(kind: str) -> None:
    """The handle towards the person, the working end beyond it."""
    model = thing(kind)
    handle = next(part.mesh.vertices for part in model.parts if part.name == "handle")
    assert model.tip is not None and handle[:, 1].mean() < 0 < model.tip[1] and model.size.argmax() == 1
