"""Stage negative_affordance_projection with a perfect scorer: the true part, N_t, and dependence on the task."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from afford.surface.negative.project import distance_to_points
from stages.surface import negative_affordance_projection
from tests.helpers.made_objects import between_nodes, looked, projected, true_scores


def negative_faces(category: str) -> dict[str, tuple[np.ndarray, np.ndarray]]:
    """Return predicted and true faces by task."""
    x = looked(category)
    found = projected(x)
    bad = ([n.part for n in one.notes if n.role == "negative"] for one in x.told.descriptions)
    truth = [np.isin(x.parts.part, [x.parts.names.index(part) for part in parts]) for parts in bad]
    return {one.task: (one.probability > 0.5, true) for one, true in zip(found.tasks, truth, strict=True)}


@pytest.mark.parametrize("category", ["screwdriver", "ladle"])
def test_perfect_scorer_gives_the_true_part(category: str) -> None:
    """Check an IoU by visible area above 0.9 for every task."""
    area = looked(category).views.visible_area
    for task, (found, truth) in negative_faces(category).items():
        assert area[found & truth].sum() / area[found | truth].sum() > 0.9, task


def test_task_changes_the_negative_part() -> None:
    """Check a screwdriver: shaft and tip in use, the handle when it is handed over."""
    (use, _), (give, _) = negative_faces("screwdriver").values()
    area = looked("screwdriver").views.visible_area
    assert area[use & give].sum() < 0.05 * area.sum() and area[use | give].sum() > 0.95 * area.sum()


def test_points_and_n_t_agree_with_the_surface() -> None:
    """Check labels of points, and number, position and coverage of N_t."""
    x, found = looked(), projected(looked())
    middle = x.mesh.vertices[x.mesh.faces].mean(1)
    size = float(np.ptp(x.mesh.vertices, axis=0).max())
    for one in found.tasks:
        assert one.negative.shape == found.points.shape[:1] and 0 < one.negative.mean() < 1 and len(one.N_t) == 40
        assert distance_to_points(one.N_t, found.points[one.negative]).max() < 0.1 * size
        assert distance_to_points(middle[one.probability > 0.5], one.N_t).max() < 0.02
        grid = between_nodes(one.field)(one.N_t)
        assert grid.max() < np.sqrt(3) * 0.02 and np.abs(grid - distance_to_points(one.N_t, one.N_t)).max() < np.sqrt(3) * 0.02


def test_unknown_object_has_no_negative_face() -> None:
    """Check probability 0 and an empty N_t."""
    x = looked()
    told = replace(x.told, descriptions=(replace(x.told.descriptions[0], category="unknown", notes=()),))
    nothing = replace(true_scores(x), share=np.zeros((len(x.candidates.view), 0), np.float32),
                      overlap=np.zeros((len(x.candidates.view), 0), np.float32))
    (one,) = projected(x._replace(told=told), nothing).tasks
    assert not one.probability.any() and not one.negative.any() and not len(one.N_t) and np.isinf(one.field.distance_m).all()


def test_scores_of_another_object_are_refused() -> None:
    """Check that the error names the shapes."""
    x, other = looked(), looked("ladle")
    with pytest.raises(ValueError, match="all inputs must be of one object"):
        negative_affordance_projection.run(x.mesh, x.views, x.candidates, x.told, true_scores(other),
                                           negative_affordance_projection.Params())
