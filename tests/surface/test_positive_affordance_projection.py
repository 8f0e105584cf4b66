"""Stage positive_affordance_projection: a perfect model gives the part, an unused hand gives nothing."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from afford.common.files import tree
from afford.common.text import as_narration
from afford.surface.negative.project import distance_to_points
from afford.surface.positive.project import ProjectionSettings, hand_probability, project
from schemas.benchmark import Prediction
from schemas.files import FileTree
from stages.surface import positive_affordance_projection
from tests.helpers.made_objects import looked
from tests.helpers.made_samples import Scratch
from tests.helpers.tiny_asked import write_model

WISH = ProjectionSettings(threshold=0.5, points=30, seed=0)
RIGHT = np.array([False, True])


def says(part: str, hands: np.ndarray = RIGHT) -> list[Prediction]:
    """Predict perfectly: the second of two hypotheses of both hands is the part, and has the best score."""
    x = looked()
    shown = np.append(x.parts.part, -1)[x.views.face] == x.parts.names.index(part)
    region = np.stack([np.zeros_like(shown), shown]).astype(np.float32)
    score = np.array([[0.2, 0.8]] * 2, np.float32)
    taxonomy = np.array([0.1, 0.7, 0.1, 0.1], np.float32)
    return [Prediction("use", np.stack([region[:, n]] * 2), score, taxonomy, hands, 0.5) for n in range(len(shown))]


def test_perfect_model_gives_the_part() -> None:
    """Check an IoU by visible area above 0.9, and coverage by the points."""
    x = looked()
    found = project(x.mesh, x.views, "use", says("handle"), WISH)
    truth, area = x.parts.part == x.parts.names.index("handle"), x.views.visible_area
    said = found.probability > 0.5
    assert area[said & truth].sum() / area[said | truth].sum() > 0.9
    middle = x.mesh.vertices[x.mesh.faces].mean(1)
    assert len(found.A_t) == 30 and distance_to_points(middle[said], found.A_t).max() < 0.02
    assert distance_to_points(middle[truth], found.A_t.astype(float)).max() < 0.03
    assert found.taxonomy.argmax() == 1


def test_unused_hands_are_empty() -> None:
    """Check a right hand alone, and no hand."""
    x = looked()
    found = project(x.mesh, x.views, "use", says("handle"), WISH)
    assert not found.hand[0].any() and np.array_equal(found.hand[1], found.probability)
    nothing = project(x.mesh, x.views, "use", says("handle", np.array([False, False])), WISH)
    assert not nothing.probability.any() and nothing.A_t.shape == (0, 3)


def test_pixels_take_the_likeliest_hypothesis() -> None:
    one = says("handle")[0]
    assert np.array_equal(hand_probability([one])[1, 0], one.probability[1, 1])
    assert np.array_equal(hand_probability([replace(one, score=one.score[:, ::-1].copy())])[1, 0], one.probability[1, 0])


@pytest.fixture(scope="module")
def model(tmp_path_factory: pytest.TempPathFactory) -> FileTree:
    return tree("tiny", write_model(tmp_path_factory.mktemp("model") / "small"))


def test_stage_runs_a_model(model: FileTree, tmp_path: Path) -> None:
    """Check one result for each task, probabilities, and determinism."""
    x = looked()
    params = positive_affordance_projection.Params(points=20, hands="both", mirror=False)
    found, again = (positive_affordance_projection.run(x.mesh, x.views, x.told, model, params, Scratch(tmp_path / name))
                    for name in ("a", "b"))  # fmt: skip
    assert [one.task for one in found.tasks] == [one.task for one in x.told.descriptions]
    for one, other in zip(found.tasks, again.tasks, strict=True):
        assert one.probability.shape == (len(x.mesh.faces),) and 0 < one.probability.max() <= 1 and len(one.A_t) in (0, 20)
        assert one.probability.tobytes() == other.probability.tobytes() and one.A_t.tobytes() == other.A_t.tobytes()


def test_views_of_another_object_are_refused(model: FileTree, tmp_path: Path) -> None:
    x = looked()
    other = replace(x.views, visible_area=x.views.visible_area[:-1])
    with pytest.raises(ValueError, match="all inputs must be of one object"):
        positive_affordance_projection.run(x.mesh, other, x.told, model, positive_affordance_projection.Params(), Scratch(tmp_path))


@pytest.mark.parametrize(("task", "category", "narration"), [
    ("cut bread", "knife", "cut bread with knife"), ("hand over the knife", "knife", "hand over the knife"),
    ("", "hair_dryer", "use hair dryer"), ("stir", "", "stir"), ("", "", "use")])  # fmt: skip
def test_tasks_as_narrations(task: str, category: str, narration: str) -> None:
    assert as_narration(task, category) == narration
