"""Rendered stills: consistent labels, hands that depend on the layout, and disjoint sets."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from afford.codecs import CODEC
from afford.dataset.still_samples import sample_stills
from afford.render.motion import axis_angle, pose
from afford.synthetic.assets import library
from afford.synthetic.splits import (
    KNOWN_KINDS,
    NEW_KINDS,
    NEW_PAIRS,
    RoomExtent,
    accepts_task,
    benchmark_specs,
    is_held_out,
    object_kinds,
    shift_specs,
    train_specs,
)
from afford.synthetic.stills.grasp_options import ReachModel, grasp_plans, plan_weights, with_extra_grips
from afford.synthetic.stills.render_stills import ImageSizes, RenderQuality, render_stills, take_picture
from afford.synthetic.stills.still_world import StillWorld
from afford.synthetic.stills.table_layout import PlacedObject, height_map, place_on_table
from afford.synthetic.stills.task_catalogue import Task, tasks_for
from schemas.scene import Stills, StillSpec
from stages.synthetic import shift_plan

SMALL = RenderQuality(ImageSizes((228, 128), (228, 128)), supersample=1, jpeg_quality=90)
EXTENT = RoomExtent(layouts=2, views=1, tasks=6)
SPEC = train_specs(3, 1, 0, EXTENT)[0]


def quiet(done: int, total: int) -> None:
    """Ignore progress."""


@pytest.fixture(scope="module")
def room() -> Stills:
    """Two images of a training kitchen."""
    return render_stills(SPEC, SMALL, quiet)


def test_every_painter_shows_the_same_scenes() -> None:
    """A painter changes the pictures alone: stills, modes and masks stay."""
    grey = render_stills(SPEC, SMALL, quiet, lambda layout, camera: np.full((camera.height, camera.width, 3), 128, np.uint8))
    usual = render_stills(SPEC, SMALL, quiet)
    assert [one.narration for one in grey.stills] == [one.narration for one in usual.stills]
    assert all(np.array_equal(a.masks, b.masks) for x, y in zip(grey.stills, usual.stills, strict=True)
               for a, b in zip(x.modes, y.modes, strict=True))  # fmt: skip
    assert all(a.jpeg.tobytes() != b.jpeg.tobytes() for a, b in zip(grey.images, usual.images, strict=True))


def placed(kind: str, x: float, y: float = 0.30, yaw: float = 0.0, number: int = 0) -> PlacedObject:
    """Place an object at a position."""
    model = with_extra_grips(library.build(kind, np.random.default_rng(5)))
    T = pose((x, y, 0.0), axis_angle((0, 0, 1), yaw))
    points = model.points @ T[:3, :3].T + T[:3, 3]
    low, high = points[:, :2].min(axis=0), points[:, :2].max(axis=0)
    corners = np.array([low, (high[0], low[1]), high, (low[0], high[1])], np.float32)
    return PlacedObject(number, model, T, corners)


def hands_for(*objects: PlacedObject, parts: tuple[str, ...] = ()) -> set[int]:
    """Return the taxonomies of the natural ways to take the first of some objects."""
    task = Task("take", "take it", objects[:1], parts)
    return {plan.taxonomy for plan in grasp_plans(task, ReachModel(objects))}


# -- labels -------------------------------------------------------------------------------------------------------------


def test_same_spec_gives_the_same_bytes(room: Stills) -> None:
    """Images, narrations and masks are equal, also when fewer layouts are rendered; another seed gives others."""
    first = replace(SPEC, layouts=1)
    again, other = (render_stills(spec, SMALL, quiet) for spec in (first, replace(first, seed=SPEC.seed + 1, tasks=1)))
    part = replace(room, images=room.images[:1], stills=tuple(still for still in room.stills if still.image == 0))
    assert CODEC.digest(part) == CODEC.digest(again)
    assert not np.array_equal(other.images[0].jpeg, room.images[0].jpeg)


def test_masks_agree_with_taxonomy_and_objects(room: Stills) -> None:
    """Exactly the active hands of a mode have an affordance, and it is inside the complete object of that hand."""
    assert len(room.stills) > 4
    for mode in (mode for still in room.stills for mode in still.modes):
        affordance, objects = mode.masks[:2], mode.masks[2:]
        assert not (affordance & ~objects).any()
        active = affordance.any(axis=(1, 2)).tolist()
        assert active == [mode.taxonomy != 1, mode.taxonomy != 0] == [bool(name) for name in mode.objects]
        assert active == objects.any(axis=(1, 2)).tolist() == [bool(name) for name in mode.grips]
        assert not (affordance[0] & affordance[1]).any()
        if mode.taxonomy >= 2:
            assert np.array_equal(*objects) == (mode.taxonomy == 2)


def test_affordance_is_visible_hand_and_complete_object() -> None:
    """A hand is visible only in front of other surfaces: behind a near wall no pixel of it remains."""
    world = StillWorld(SPEC)
    layout = world.layout()
    shot, reach = take_picture(world, layout, SMALL.sizes, 1), ReachModel(layout.objects)
    plan = next(plan for obj in layout.objects for plan in grasp_plans(Task("take", "", (obj,), ()), reach))
    seen = shot.hands(world, plan.options)
    assert seen.any() and not (seen[0] & seen[1]).any()
    walled = replace(shot, nearness=np.full_like(shot.nearness, 50.0))
    assert not walled.hands(world, plan.options).any()


def test_modes_differ_and_their_weights_sum_to_one(room: Stills) -> None:
    """Weights are descending and sum to 1; no two modes look the same."""
    for still in room.stills:
        shares = [mode.weight for mode in still.modes]
        assert shares == sorted(shares, reverse=True) and sum(shares) == pytest.approx(1)
        shapes = [mode.masks[:2].tobytes() for mode in still.modes]
        assert len(set(shapes)) == len(shapes)


def test_images_have_several_tasks(room: Stills) -> None:
    """Several tasks share an image, so the text selects the object; every sentence names its objects."""
    for image in range(len(room.images)):
        narrations = [still.narration for still in room.stills if still.image == image]
        assert len(narrations) > 1 and len({(n.verb, n.all_nouns) for n in narrations}) == len(narrations)
        assert all(noun.split(":")[0] in n.text for n in narrations for noun in n.all_nouns)


# -- samples ------------------------------------------------------------------------------------------------------------


def test_samples_show_one_mode_each(room: Stills) -> None:
    """The same image and text occur with different modes, each of them valid."""
    drawn = sample_stills(room, 2, 1)
    by_number = {still.narration.narration_id: still for still in room.stills}
    options: dict[str, list[bytes]] = {}
    for sample in drawn.samples:
        valid = [mode.masks.tobytes() for mode in by_number[sample.narration.narration_id].modes]
        assert sample.masks.tobytes() in valid
        options.setdefault(sample.narration.narration_id, []).append(sample.masks.tobytes())
    assert all(len(found) == min(2, len(by_number[name].modes)) == len(set(found)) for name, found in options.items())
    assert any(len(found) == 2 for found in options.values())
    assert len({sample.sample_id for sample in drawn.samples}) == len(drawn.samples)


def test_sampling_follows_the_mode_weights(room: Stills) -> None:
    """Over many seeds the first mode is drawn as often as its weight."""
    still = next(still for still in room.stills if len(still.modes) > 1)
    alone = replace(room, stills=(still,))
    first = [sample_stills(alone, 1, seed).samples[0].masks.tobytes() == still.modes[0].masks.tobytes() for seed in range(200)]
    assert np.mean(first) == pytest.approx(still.modes[0].weight, abs=0.12)


def test_zero_draws_are_refused(room: Stills) -> None:
    """The minimum is one sample."""
    with pytest.raises(ValueError, match="expected 1 or more, got 0"):
        sample_stills(room, 0, 1)


# -- choice of the hand -------------------------------------------------------------------------------------------------


def test_object_position_determines_the_hand() -> None:
    """An object at the right is taken with the right hand, at the left with the left, in the middle with either."""
    assert [hands_for(placed("can", x), parts=("body",)) for x in (-0.2, 0.0, 0.2)] == [{0}, {0, 1}, {1}]


def test_obstacle_determines_the_hand() -> None:
    """A tall box beside a can leaves no room for the hand on that side."""
    can = placed("can", 0.0)
    for side, free in ((1, {0}), (-1, {1})):
        assert hands_for(can, placed("box", side * 0.115, number=1), parts=("body",)) == free


def test_handle_side_determines_the_hand() -> None:
    """A mug in the middle is taken by its handle with the hand to which the handle points."""
    assert hands_for(placed("mug", 0.0), parts=("handle",)) == {1}
    assert hands_for(placed("mug", 0.0, yaw=np.pi), parts=("handle",)) == {0}


def test_wide_objects_take_two_hands_where_both_sides_are_free() -> None:
    """A plate in the middle is lifted with both hands; with a box at one side, with the other hand."""
    plate = placed("plate", 0.0, 0.26)
    lift = next(task for task in tasks_for([plate], {0: "plate"}) if task.verb == "lift")
    assert {plan.taxonomy for plan in grasp_plans(lift, ReachModel([plate]))} == {2}
    crowded = [plate, placed("box", 0.20, 0.26, number=1), placed("box", 0.20, 0.15, number=2)]
    assert {plan.taxonomy for plan in grasp_plans(lift, ReachModel(crowded))} == {0}


def test_task_determines_the_part() -> None:
    """A jar is taken by its body and opened at its lid."""
    jar = placed("jar", 0.0)
    of = {task.verb: grasp_plans(task, ReachModel([jar])) for task in tasks_for([jar], {0: "jar"})}
    assert {option.grip.name for plan in of["take"] for option in plan.options if option} == {"body"}
    assert all({option.grip.name for option in plan.options if option} == {"body", "lid"} for plan in of["open"]) and of["open"]


def test_plan_weights_follow_comfort() -> None:
    """Less comfortable plans have smaller weights."""
    chosen = grasp_plans(Task("take", "", (placed("mug", 0.05),), ()), ReachModel([placed("mug", 0.05)]))
    assert len(chosen) > 1 and (np.diff(plan_weights(chosen)) <= 0).all() and plan_weights(chosen).sum() == pytest.approx(1)


# -- placement on the table ---------------------------------------------------------------------------------------------


def test_placed_objects_neither_overlap_nor_float() -> None:
    """Footprints are disjoint and every object rests on the table."""
    models = [library.build(kind, np.random.default_rng(2)) for kind in KNOWN_KINDS]
    objects = place_on_table(models, np.random.default_rng(0))
    assert len(objects) > 3
    built = [height_map([obj]) > 0 for obj in objects]
    assert np.sum(built, axis=0).max() == 1
    assert all(abs(float((obj.model.points @ obj.T_world_obj[:3, :3].T)[:, 2].min())) < 0.003 for obj in objects)


# -- held-out kinds and uses --------------------------------------------------------------------------------------------


def test_training_and_benchmark_share_no_room_and_no_mesh() -> None:
    """No two rooms share a random stream, even for equal seeds, and no mesh is in both sets."""
    train, test = (*train_specs(7, 20, 5, EXTENT), *shift_specs(7, 2, EXTENT)), benchmark_specs(7, 26, EXTENT)
    seeds = [spec.seed for spec in (*train, *test)]
    assert len(set(seeds)) == len(seeds) == len({spec.video_id for spec in (*train, *test)})
    assert {spec.split for spec in test} == {"test"} and {spec.split for spec in train} == {"train", "val"}
    workshops = [next(spec for spec in specs if spec.setting == "workshop") for specs in (train, test)]
    for one, other in ((train[0], test[0]), workshops):
        shapes = [{part.mesh.vertices.tobytes() for model in StillWorld(spec).models for part in model.parts}
                  for spec in (one, other)]
        assert not shapes[0] & shapes[1]


def test_shift_plan_adds_validation_rooms_of_other_settings() -> None:
    """The rooms of the training stay as they are; what is added is in the split val, and in no setting that training shows."""
    rooms = train_specs(7, 3, 1, EXTENT)
    planned = shift_plan.run(rooms, shift_plan.Params(rooms=2))
    assert planned[: len(rooms)] == rooms and len(planned) == len(rooms) + 4
    added = planned[len(rooms) :]
    assert {spec.split for spec in added} == {"val"}
    assert {(spec.layouts, spec.views, spec.tasks) for spec in planned} == {(EXTENT.layouts, EXTENT.views, EXTENT.tasks)}
    assert not {spec.setting for spec in added} & {spec.setting for spec in rooms if spec.split == "train"}
    assert shift_plan.run(rooms, shift_plan.Params(rooms=0)) == rooms
    with pytest.raises(ValueError, match="expected 0 or more, got -1"):
        shift_plan.run(rooms, shift_plan.Params(rooms=-1))


def test_held_out_kinds_and_uses_are_absent_from_training() -> None:
    """Held-out kinds are not in the pool, and a held-out use of a known kind is no training task."""
    assert not set(NEW_KINDS) & set(object_kinds("kitchen", "known", "train"))
    assert set(NEW_KINDS) < set(object_kinds("kitchen", "new", "test"))
    for verb, kind in NEW_PAIRS:
        assert kind in KNOWN_KINDS and is_held_out(verb, (kind,)) and not accepts_task("known", is_held_out(verb, (kind,)))
        assert any(not is_held_out(verb, (other,)) for other in KNOWN_KINDS) and not is_held_out("take", (kind,))
    assert all(spec.asks == "known" and spec.setting == "kitchen" for spec in train_specs(1, 5, 2, EXTENT))


def test_unknown_task_filter_is_refused() -> None:
    """The error lists the filters."""
    with pytest.raises(ValueError, match="known, new or any"):
        accepts_task("all", True)


@pytest.mark.parametrize("spec", [benchmark_specs(1, 1, RoomExtent(1, 1, 4))[k] for k in (1, 2, 3)], ids=lambda spec: spec.video_id)
def test_benchmark_rows_have_stills(spec: StillSpec) -> None:
    """Rows are new kinds, workshop and desk; the row of new objects has held-out tasks only."""
    made = render_stills(replace(spec, layouts=4 if spec.asks == "new" else 1), SMALL, quiet)
    assert made.stills and (spec.asks != "new" or all(still.new for still in made.stills))
