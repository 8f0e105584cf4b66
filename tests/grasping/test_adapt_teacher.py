"""Adaptation of a teacher to one body: search of scripts, exact resumption, the best weights, rows before and after."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from afford.grasping.env.placed_worlds import PlacedWorlds
from afford.grasping.policies.adapt_teacher import Experts
from afford.grasping.policies.adapted_policy import FOLDER, ByTask, actor_by_task
from afford.grasping.policies.grasp_search import SPREAD, GraspSearch, numbers, script, shaped
from afford.grasping.policies.grasp_trials import episode_scores
from afford.grasping.policies.load_policy import load_policy
from afford.grasping.sim.scene import Physics, Scene
from afford.grasping.sim.scripted import GRASP, Aim
from commands.origin import origin
from maps.settings import Settings
from pipeline import build
from runner import Graph
from runner.canonical import file_digest
from schemas.files import FileTree
from schemas.training import Trained
from stages.grasping import body_adapt
from tests.grasping.test_bodies import stick, tasks_of
from tests.helpers.made_grasps import held_by_handle
from tests.helpers.made_hands import shadow
from tests.helpers.made_students import teacher
from tests.helpers.mesh_files import write_obj

TINY = body_adapt.Params(worlds=2, bullet=1, generations=1, rounds=3, updates=3, batch=8, iterations=10,
                          rate_hz=240)  # fmt: skip
ALL = tuple(tasks_of(stick()).tasks)
ONE = ALL[:1]


class Run:
    """A stage's context; dies when asked to."""

    def __init__(self, scratch: Path, dies_at: int = 0) -> None:
        self.scratch, self._dies_at = scratch, dies_at
        scratch.mkdir(exist_ok=True)

    def progress(self, done: int, total: int) -> None:
        if done == self._dies_at:
            raise KeyboardInterrupt


@pytest.fixture(scope="module")
def policy(tmp_path_factory: pytest.TempPathFactory) -> FileTree:
    """Files of an untrained teacher, whose episodes are short."""
    return teacher(tmp_path_factory.mktemp("policy"), base="none", steps=4)


def adapted(scratch: Path, policy: FileTree, dies_at: int = 0, **params: object) -> Trained:
    return body_adapt.run(shadow(), ONE, policy, replace(TINY, **params), Run(scratch, dies_at))  # type: ignore[arg-type]


def content(made: Trained) -> dict[str, str]:
    return {file.name: file.digest for file in made.files.files}


def test_the_search_approaches_the_best_script() -> None:
    """Thirty generations come five times as near to a known script as the first; the same seed gives the same scripts."""
    best = numbers(GRASP) + SPREAD

    def found(seed: int, generations: int) -> np.ndarray:
        search = GraspSearch([seed], 1)
        for _ in range(generations):
            search.tell(0, -(((search.ask(16) - best) / SPREAD) ** 2).sum(1), np.zeros(16))
        return search.best(1)[0]

    far = [float((((found(0, count) - best) / SPREAD) ** 2).sum()) for count in (1, 30)]
    assert far[1] < far[0] / 5
    assert (found(0, 3) == found(0, 3)).all() and (found(0, 3) != found(1, 3)).any()


def test_a_script_of_few_trials_is_doubted() -> None:
    """A script that was once good and then bad falls behind one that is always fair."""
    search = GraspSearch([0], 1)
    first = search.ask(2)
    search.tell(0, np.array([10.0, 9.0]), np.zeros(2))
    for _ in range(2):
        again = search.ask_again(2)
        search.tell(0, np.where((again == first[0]).all(1), 0.0, 9.0), np.zeros(2))
    assert (search.best(1)[0] == first[1]).all() and (shaped(numbers(GRASP)) == GRASP)


def test_a_search_ends_with_a_script_that_holds_in_every_engine() -> None:
    """Two trials in each of two engines, all of which hold; a script that failed once does not count."""
    search = GraspSearch([0], 2)
    found = list[bool]()
    for engine in (0, 1, 0, 1):
        rows = (search.ask_again if engine or found else search.ask)(2)
        held = np.array([True, len(found) > 0])
        search.tell(engine, np.array([2.0, 1.0]), held)
        found.append(search.found(2))
        assert len(rows) == 2
    assert found == [False, False, False, True] and not search.found(3)


def test_targets_of_a_script() -> None:
    """Targets lead from the start to the height of the goal above the closed hand; the wrist does not turn round on its way."""
    scene, aim = Scene(shadow(), held_by_handle().body), Aim(np.array([0.1, 0.0, 0.02]), 3.0)
    u = script(scene, aim, GRASP, (), 40, 0.2)
    assert u.shape == (40, 24) and u[-1, 2] - u[21, 2] == pytest.approx(0.2) and (u[34:] == u[-1]).all()
    assert np.abs(np.diff(u[:, :3], axis=0)).max() < 0.04 and np.abs(np.diff(u[:, 3])).max() < 0.1


def test_a_killed_adaptation_resumes_to_the_same_bytes(tmp_path: Path, policy: FileTree, monkeypatch: pytest.MonkeyPatch) -> None:
    """Killed after its first checkpoint; another seed gives other bytes."""
    for module in ("adapt_teacher", "clone_scripts"):
        monkeypatch.setattr(f"afford.grasping.policies.{module}.MARGIN", -1.0)
    values = iter(np.linspace(0.0, 1.0, 100))
    monkeypatch.setattr("afford.grasping.policies.grasp_trials.episode_scores", lambda report: 0 * report["held"] + next(values))
    whole = adapted(tmp_path / "whole", policy)
    assert whole.log.best_step == 3
    with pytest.raises(KeyboardInterrupt):
        adapted(tmp_path / "killed", policy, dies_at=4)
    assert content(adapted(tmp_path / "killed", policy)) == content(whole)
    assert content(adapted(tmp_path / "other", policy, seed=1)) != content(whole)


@pytest.mark.parametrize(("scores", "kept"), [(((0.5, 0.2), (0.4, 0.2), (0.5, 0.2)), 0), (((0.5, 0.2), (0.1, 0.6), (0.4, 0.3)), 2)],
                         ids=["worse", "better in one task"])  # fmt: skip
def test_tasks_that_are_not_better_stay_with_the_teacher(tmp_path: Path, policy: FileTree, monkeypatch: pytest.MonkeyPatch,
                                                         scores: tuple[tuple[float, ...], ...], kept: int) -> None:  # fmt: skip
    """Evaluations of two tasks before and after two and three rounds; what got worse, or is as good, stays as it was."""
    two = ALL[:2]
    found = Experts(np.arange(2), np.tile(numbers(GRASP), (2, 1)), np.zeros(4))
    monkeypatch.setattr("afford.grasping.policies.adapt_teacher._experts", lambda *given: found)
    each = iter(scores)
    monkeypatch.setattr("afford.grasping.policies.clone_scripts.trial_figures", lambda *given: {"score": np.array(next(each))})
    made = body_adapt.run(shadow(), two, policy, TINY, Run(tmp_path / "run"))  # type: ignore[arg-type]
    before, after = content(Trained(policy, made.log)), content(made)
    assert made.log.best_step == kept and {name: after[name] for name in before} == before
    assert (FOLDER + "policy.json" in after) == (kept > 0)
    worlds = PlacedWorlds(shadow(), two * 2, load_policy(policy, {}).config("mujoco", Physics(), "flat", 0.0))
    actor = actor_by_task(made.files, load_policy(made.files, {}), worlds)
    assert not kept or (isinstance(actor, ByTask) and actor.chosen.tolist() == [False, True] * 2)
    worlds.close()


def test_a_body_without_a_better_script_keeps_the_policy(tmp_path: Path, policy: FileTree) -> None:
    """Episodes of four steps hold nothing; the figures of the teacher are in the log, and a second run reads the same scripts."""
    made = adapted(tmp_path / "run", policy)
    assert made.files == policy and made.log.best_step == 0
    assert {"val.score", "val.success", "val.held"} <= {curve.name for curve in made.log.curves}
    assert adapted(tmp_path / "run", policy).files == policy


def test_scores_of_episodes() -> None:
    """Success and held count alike; all fingertips at negative points cost half."""
    report = {"success": np.array([1.0, 1.0, 0.0]), "held": np.array([1.0, 0.0, 0.0]), "as_violation_pct": np.array([100.0, 0, 9])}
    assert episode_scores(report).tolist() == [0.5, 0.5, 0.0]


def test_a_body_without_tasks_keeps_the_policy(tmp_path: Path, policy: FileTree) -> None:
    """A refused mesh has nothing to adapt to."""
    made = body_adapt.run(shadow(), (), policy, TINY, Run(tmp_path / "none"))  # type: ignore[arg-type]
    assert made.files == policy and made.log.best_step == 0


def test_rows_before_are_those_of_grasp(tmp_path: Path) -> None:
    """Both targets evaluate the policy of bodies by the same stages, parameters and inputs; a mesh file is a source too."""
    write_obj(tmp_path / "stick.obj", stick().vertices, stick().faces)
    graphs = {target: build(target, origin(target, tmp_path / "stick.obj", Settings(), file_digest)[0], Settings())
              for target in ("grasp", "grasp-adapt")}  # fmt: skip
    for name in ("bodies_bullet", "bodies_mujoco"):
        assert described(graphs["grasp"], name) == described(graphs["grasp-adapt"], name)
    names = {node.name for node in graphs["grasp-adapt"].stages()}
    assert {"body_adapt", "adapted_bullet", "adapted_mujoco"} <= names
    assert origin("grasp-adapt", tmp_path / "stick.obj", Settings(), file_digest)[0].name == "stick-adapted"


def described(graph: Graph, name: str) -> object:
    """Stage of a graph with all that it is made from."""
    by_id = {node.id: node for node in graph.nodes}

    def of(number: int) -> object:
        node = by_id[number]
        params = None if node.params is None else repr(node.params)
        return node.sort, node.name, getattr(node.value, "__module__", ""), params, [(key, of(made)) for key, made in node.inputs]

    return of(next(node.id for node in graph.stages() if node.name == name))
