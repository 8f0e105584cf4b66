"""From scores to the surface: with a scorer that is never wrong the negative part comes out; N_t covers it; tasks turn it round."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from afford.surface.negative.project import distance_to_points, interpolate_field
from stages.surface import negative_affordance_projection
from tests.helpers.made_objects import looked, projected, true_scores


def negative_faces(category: str) -> dict[str, tuple[np.ndarray, np.ndarray]]:
    """Task -> what was found and what is true."""
    x = looked(category)
    found = projected(x)
    bad = ([n.part for n in one.notes if n.role == "negative"] for one in x.told.descriptions)
    truth = [np.isin(x.parts.part, [x.parts.names.index(part) for part in parts]) for parts in bad]
    return {one.task: (one.probability > 0.5, true) for one, true in zip(found.tasks, truth, strict=True)}


@pytest.mark.parametrize("category", ["screwdriver", "ladle"])
def test_a_perfect_scorer_gives_the_perfect_part(category: str) -> None:
    """IoU by visible area above 0.9 for every task."""
    area = looked(category).views.visible_area
    for task, (found, truth) in negative_faces(category).items():
        assert area[found & truth].sum() / area[found | truth].sum() > 0.9, task


def test_a_task_turns_the_negative_part_round() -> None:
    """Of a screwdriver: shaft and tip while it is used, the handle when it is handed over."""
    (use, _), (give, _) = negative_faces("screwdriver").values()
    area = looked("screwdriver").views.visible_area
    assert area[use & give].sum() < 0.05 * area.sum() and area[use | give].sum() > 0.95 * area.sum()


def test_points_and_n_t_are_those_of_the_surface() -> None:
    """Labels agree with the faces; N_t lies on negative faces, as many as asked for, and near every negative point."""
    x, found = looked(), projected(looked())
    middle = x.mesh.vertices[x.mesh.faces].mean(1)
    size = float(np.ptp(x.mesh.vertices, axis=0).max())
    for one in found.tasks:
        assert one.negative.shape == found.points.shape[:1] and 0 < one.negative.mean() < 1 and len(one.N_t) == 40
        assert distance_to_points(one.N_t, found.points[one.negative]).max() < 0.1 * size
        assert distance_to_points(middle[one.probability > 0.5], one.N_t).max() < 0.02
        grid = interpolate_field(one.field, one.N_t)
        assert grid.max() < np.sqrt(3) * 0.02 and np.abs(grid - distance_to_points(one.N_t, one.N_t)).max() < np.sqrt(3) * 0.02


def test_an_unknown_thing_is_negative_nowhere() -> None:
    """No notes: probability 0, no point, an empty N_t."""
    x = looked()
    told = replace(x.told, descriptions=(replace(x.told.descriptions[0], category="unknown", notes=()),))
    nothing = replace(true_scores(x), share=np.zeros((len(x.candidates.view), 0), np.float32),
                      overlap=np.zeros((len(x.candidates.view), 0), np.float32))
    (one,) = projected(x._replace(told=told), nothing).tasks
    assert not one.probability.any() and not one.negative.any() and not len(one.N_t) and np.isinf(one.field.distance_m).all()


def test_scores_of_another_object_are_refused() -> None:
    """Shapes are named."""
    x, other = looked(), looked("ladle")
    with pytest.raises(ValueError, match="all inputs must be of one object"):
        negative_affordance_projection.run(x.mesh, x.views, x.candidates, x.told, true_scores(other),
                                           negative_affordance_projection.Params())
