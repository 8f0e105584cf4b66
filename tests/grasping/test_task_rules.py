"""Rules that derive grasp tasks from the lexicon."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from afford.grasping.env.task import from_grasp_task
from afford.grasping.env.task_rules import holdable, negative_distance, scaled, with_ballast
from schemas.grasp import LEVELS, GraspTask
from schemas.mesh import ObjectSpec
from stages.grasping import grasp_tasks
from tests.helpers.made_scenes import tool


def made(category: str, split: str = "train", **params: object) -> tuple[GraspTask, ...]:
    spec = ObjectSpec(category, category, 1, "plain", split)
    return grasp_tasks.run(spec, tool(category, 1), replace(grasp_tasks.Params(), **{"within_m": 1.0, **params}))  # type: ignore[arg-type]  # named


def test_use_has_negative_parts_and_another_to_hold() -> None:
    for category in ("knife", "hammer", "brush", "spatula", "shovel"):
        for one in made(category):
            assert one.hold in one.body.parts and one.hold not in one.negative and set(one.negative) <= set(one.body.parts)
            assert one.level == "train" and len(one.N_t) == 100
            points = one.body.points[np.isin(one.body.point_part, [one.body.parts.index(part) for part in one.negative])]
            assert {tuple(p) for p in one.N_t.tolist()} <= {tuple(p) for p in points.astype(float).tolist()}


def test_uses_of_one_object_have_different_negative_parts() -> None:
    dig, hand_over = made("shovel")
    assert "handle" not in dig.negative and "handle" in hand_over.negative and hand_over.hold == "shaft"
    assert from_grasp_task(dig).hold == from_grasp_task(hand_over).hold and not np.array_equal(dig.N_t, hand_over.N_t)
    assert len({one.name for one in made("shovel")}) == 2


def test_part_too_close_to_negative_parts_is_not_held() -> None:
    """The head of a brush is long enough, but bristles and handle surround it."""
    body = tool("brush", 1)
    assert holdable(body, "head", np.zeros((0, 3)), 0.05, (0.009, 0.06)) and [one.hold for one in made("brush")] == ["handle"]


def test_thin_blade_on_the_table_is_not_held() -> None:
    assert [one.hold for one in made("knife")] == ["handle"]
    assert not holdable(tool("knife", 1), "blade", np.zeros((0, 3)), 0.07, (0.009, 0.06)) and not made("knife", least_length_m=0.5)


def test_levels_come_from_splits() -> None:
    assert [made("hammer", split)[0].level for split in ("train", "seen", "unseen")] == [LEVELS[0], LEVELS[1], LEVELS[3]]
    assert made("hammer", level="unseen_size")[0].level == "unseen_size"


def test_scaled_object_has_the_same_density() -> None:
    body = tool("hammer", 1)
    large = scaled(body, 1.5)
    assert large.mass_kg == pytest.approx(1.5**3 * body.mass_kg) and large.size_m == pytest.approx(1.5 * body.size_m)
    assert large.points == pytest.approx(1.5 * body.points, rel=1e-6)
    assert large.inertia_kgm2 == pytest.approx(1.5**5 * body.inertia_kgm2)
    names = [one.name for one in made("hammer", scales=(0.9, 1.1))]
    assert len(set(names)) == len(names) and any("x0.9" in name for name in names)


def test_wrong_scales_and_categories_are_refused() -> None:
    with pytest.raises(ValueError, match="numbers above 0"):
        made("hammer", scales=(0.0,))
    with pytest.raises(ValueError, match="category of the lexicon"):
        grasp_tasks.run(ObjectSpec("x", "x", 1, "plain", "train"), tool("hammer", 1), grasp_tasks.Params())


def test_far_negative_parts_give_no_task() -> None:
    """The face of a hammer is far from the usual place of a grasp."""
    first, body = made("hammer")[0], tool("hammer", 1)
    away = negative_distance(body, first.N_t)
    assert 0.03 < away < body.size_m.max()
    assert first.name not in [one.name for one in made("hammer", within_m=away - 0.001)]
    assert first.name in [one.name for one in made("hammer", within_m=away + 0.001)]


def test_ballast_moves_the_centre_of_mass_and_adds_mass() -> None:
    body = tool("knife", 1)
    heavy = with_ballast(body, ("blade",), 6.0)
    blade = np.concatenate([h for h, part in zip(body.hulls(), body.hull_part, strict=True) if body.parts[part] == "blade"])
    towards = blade.mean(axis=0) - body.com_m
    moved = heavy.com_m - body.com_m
    assert moved @ towards > 0.9 * np.linalg.norm(moved) * np.linalg.norm(towards) and heavy.mass_kg > body.mass_kg
    both = with_ballast(body, body.parts, 3.0)
    assert both.mass_kg == pytest.approx(3 * body.mass_kg) and both.com_m == pytest.approx(body.com_m, abs=0.003)
    assert both.inertia_kgm2 == pytest.approx(3 * body.inertia_kgm2, rel=0.2, abs=1e-6)
    assert with_ballast(body, ("blade",), 1.0) is body
    with pytest.raises(ValueError, match=r"grasp_tasks.ballast: expected numbers above 0, got \(0.0,\)"):
        made("knife", ballast=(0.0,))


def test_ballast_changes_no_use() -> None:
    plain, heavy = made("knife", ballast=(1.0, 6.0))
    assert (plain.name, heavy.name) == ("knife/cut_bread", "knife+6/cut_bread") and plain.negative == heavy.negative
    assert np.array_equal(plain.N_t, heavy.N_t) and np.linalg.norm(plain.body.com_m - heavy.body.com_m) > 0.01
