"""Places by trial: options keep the use and its points, the best one is taken, and a body that rolls is no option."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from itertools import combinations
from pathlib import Path

import numpy as np
import pytest
import trimesh

from afford.grasping.env.place_options import STEP_RAD, distinct_turns, place_options
from afford.grasping.env.rest_choice import places_of, steady_turns
from afford.grasping.policies import place_trials
from afford.grasping.policies.load_policy import load_policy
from afford.grasping.policies.place_trials import TrialSettings, try_options
from schemas.bodies import BodyTasks
from schemas.files import FileTree
from schemas.grasp import GraspTask
from schemas.surface import PartDescription, PartDescriptions, PartNote
from stages.grasping import body_choose
from tests.grasping.test_bodies import FEW, Ctx, stick, tasks_of
from tests.helpers.made_hands import shadow
from tests.helpers.made_students import teacher

MADE = tasks_of(stick())
CUT, FREE = MADE.tasks
TINY = body_choose.Params(options=3, finalists=1, episodes=1, iterations=10)
SETTINGS = TrialSettings(options=9, turned=True, finalists=2, episodes=1, enough=0.95, engines=("mujoco", "bullet"),
                         iterations=10, rate_hz=240, seed=0, carry=True)  # fmt: skip
ROLES = (PartNote("blade", "the blade", "negative", "it cuts", 1.0, False),
         PartNote("handle", "the handle", "positive", "", 1.0, False))  # fmt: skip
NOTES = PartDescriptions("stick", (PartDescription("stick", "knife", "cut", ROLES, "rules"),))


@pytest.fixture(scope="module")
def policy(tmp_path_factory: pytest.TempPathFactory) -> FileTree:
    """Files of an untrained teacher, whose episodes are short."""
    return teacher(tmp_path_factory.mktemp("policy"), base="none", steps=3)


def distances(task: GraspTask) -> np.ndarray:
    """Distances of N_t from points of the surface, which no rigid motion changes."""
    return np.linalg.norm(task.N_t[:, None] - task.body.points[None, ::30], axis=2)


def test_options_are_one_use_at_different_places() -> None:
    """Each has the use, N_t and negative parts of the first, on the held part or a piece of it, and lies on the table."""
    found = place_options(CUT, ["handle"], 12)
    assert found[0] is CUT and 1 < len(found) <= 12
    for one in found:
        assert (one.name, one.use, one.negative, one.told) == (CUT.name, CUT.use, CUT.negative, CUT.told)
        assert one.hold.partition(",")[0] == "handle" and places_of(one)
        assert np.allclose(distances(one), distances(CUT), atol=1e-5)
        assert one.body.points[:, 2].min() == pytest.approx(0, abs=2e-3)
        assert np.linalg.norm(one.A_t[:, None] - one.N_t[None], axis=2).min() > 0.02
    assert all(one.hold != other.hold or not np.allclose(one.body.points, other.body.points, atol=2e-3)
               for one, other in combinations(found, 2))  # fmt: skip


def test_a_body_that_stays_as_it_lies() -> None:
    """Every option has the points of the first where nothing may be turned."""
    found = place_options(CUT, ["handle"], 12, turned=False)
    assert all(np.allclose(one.body.points, CUT.body.points, atol=1e-6) for one in found)


def test_a_piece_is_a_part_of_its_own_within_the_held_part() -> None:
    """Its points are of the held part, and those of all other parts stay as they were."""
    bar = trimesh.creation.box((0.02, 0.02, 0.12)).apply_translation((-0.05, 0, 0.05)).subdivide().subdivide()
    made = tasks_of(stick() + bar, params=replace(FEW, points=900))
    task = made.tasks[0]
    pieces = [one for one in place_options(task, ["handle"], 30) if "piece" in one.hold]
    assert pieces
    for one in pieces:
        own, held = one.body.parts.index(one.hold), task.body.parts.index("handle")
        assert set(task.body.point_part[one.body.point_part == own]) == {held}
        others = one.body.point_part != own
        assert np.array_equal(one.body.point_part[others], task.body.point_part[others])
        assert set(task.body.hull_part[one.body.hull_part == own]) <= {held}


def test_a_curved_side_is_one_pose() -> None:
    """A cylinder rests on every face of its hull; those that are kept differ by the step, and are fewer."""
    body = tasks_of(trimesh.creation.cylinder(0.02, 0.12, sections=96).subdivide(), category="").tasks[-1].body
    turns = steady_turns(replace(body, **{name: np.array(getattr(body, name)) for name in ("corners", "com_m")}))
    kept = [turn.as_matrix()[2] for turn, _ in distinct_turns(turns)]
    assert 1 < len(kept) < len(turns)
    assert all(one @ other < np.cos(STEP_RAD) for one, other in combinations(kept, 2))


@pytest.mark.parametrize(("scores", "best", "played"), [
    ({0: (1.0, 1.0), 1: (1.0, 1.0)}, 0, 1),
    ({0: (0.0, 0.0), 1: (0.0, 0.0), 2: (1.0, 0.5), 3: (1.0, 1.0)}, 3, 4),
    ({0: (0.5, 0.5), 1: (0.0, 1.0), 2: (0.4, 1.0)}, 2, 3),
    ({0: (0.5, 0.5), 1: (0.5, 0.5)}, 0, 2),
    ({0: (0.0, 0.0), 1: (1.0, 0.0), 2: (0.9, 0.0), 3: (0.8, 1.0)}, 1, 4),
], ids=["first is enough", "best in all engines", "last resort", "equal", "not among the finalists"])  # fmt: skip
def test_the_best_option_is_taken(monkeypatch: pytest.MonkeyPatch, policy: FileTree, scores: dict[int, tuple[float, float]],
                                  best: int, played: int) -> None:  # fmt: skip
    """Every option is played in the first engine, two more in the second; the first place stays where none is better."""
    options = [replace(CUT, name=str(k)) for k in scores]
    asked = list[tuple[str, str]]()

    def told(hand: object, task: GraspTask, policy: object, s: object, engines: Sequence[str]) -> list[float]:
        asked.extend((task.name, engine) for engine in engines)
        return [scores[int(task.name)][SETTINGS.engines.index(engine)] for engine in engines]

    monkeypatch.setattr(place_trials, "_scores", told)
    found = try_options(shadow(), options, load_policy(policy, {}), SETTINGS)
    assert (found.number, found.played, found.task) == (best, played, options[best])
    assert found.score == pytest.approx(np.mean(scores[best])) and found.first == pytest.approx(np.mean(scores[0]))
    assert len(asked) == len(set(asked)) and sum(engine == "bullet" for _, engine in asked) <= 1 + SETTINGS.finalists


def test_a_body_that_rolls_scores_nothing(policy: FileTree) -> None:
    """An option in which a ball rolls away is not played, and does not fail the run."""
    ball = trimesh.creation.icosphere(4, 0.03)
    free = tasks_of(stick()).tasks[1]
    hull = ball.convex_hull.vertices
    one = {"hull_start": np.array([0, len(hull)], np.int32), "hull_part": np.zeros(1, np.int16), "stand_out_m": np.zeros(1)}
    body = replace(free.body, corners=hull + (0, 0, 0.03), com_m=np.array([0.02, 0.0, 0.03]), **one)
    assert place_trials._scores(shadow(), replace(free, body=body), load_policy(policy, {}), SETTINGS, ("mujoco",)) == [0.0]


def chosen(scratch: Path, policy: FileTree, made: BodyTasks = MADE, **params: object) -> BodyTasks:
    context = Ctx(scratch)
    return body_choose.run(shadow(), made, NOTES, policy, replace(TINY, **params), context)  # type: ignore[arg-type]


def test_uses_stay_and_the_same_seed_chooses_the_same(tmp_path: Path, policy: FileTree) -> None:
    """Same tasks by name, twice the same; one option is the body as it was."""
    once, twice = chosen(tmp_path, policy), chosen(tmp_path, policy)
    assert [one.name for one in once.tasks] == [one.name for one in MADE.tasks] and len(once.family) == 2
    assert [one.hold for one in once.tasks] == [one.hold for one in twice.tasks] and once.notes == twice.notes
    assert all(np.array_equal(a.body.points, b.body.points) for a, b in zip(once.tasks, twice.tasks, strict=True))
    assert chosen(tmp_path, policy, options=1) is MADE
    assert chosen(tmp_path, policy, made=replace(MADE, tasks=(), family=())).tasks == ()


@pytest.mark.parametrize("wrong", [{"options": 0}, {"episodes": 0}, {"engines": ()}, {"engines": ("unity",)}], ids=str)
def test_numbers_out_of_range_are_refused(tmp_path: Path, policy: FileTree, wrong: dict[str, object]) -> None:
    """One sentence."""
    with pytest.raises(ValueError, match="expected"):
        chosen(tmp_path, policy, **wrong)
