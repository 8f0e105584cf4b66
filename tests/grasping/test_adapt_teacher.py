"""Adaptation of a teacher to one body: search of scripts, exact resumption, the best weights, rows before and after."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from afford.grasping.policies.adapt_teacher import Adaptation, episode_scores
from afford.grasping.policies.grasp_search import SPREAD, GraspSearch, numbers, script, shaped
from afford.grasping.sim.scene import Scene
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

TINY = body_adapt.Params(worlds=2, bullet=1, generations=1, rounds=3, updates=3, batch=8, iterations=10)
ONE = tuple(tasks_of(stick()).tasks[:1])


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
    monkeypatch.setattr("afford.grasping.policies.adapt_teacher.MARGIN", -1.0)
    values = iter(np.linspace(0.0, 1.0, 100))
    monkeypatch.setattr("afford.grasping.policies.adapt_teacher.episode_scores", lambda report: 0 * report["held"] + next(values))
    whole = adapted(tmp_path / "whole", policy)
    assert whole.log.best_step == 3
    with pytest.raises(KeyboardInterrupt):
        adapted(tmp_path / "killed", policy, dies_at=4)
    assert content(adapted(tmp_path / "killed", policy)) == content(whole)
    assert content(adapted(tmp_path / "other", policy, seed=1)) != content(whole)


@pytest.mark.parametrize(("scores", "kept"), [((0.5, 0.4, 0.5), 0), ((0.5, 0.6, 0.4), 2)], ids=["worse", "better"])
def test_worse_weights_are_dropped(tmp_path: Path, policy: FileTree, monkeypatch: pytest.MonkeyPatch, scores: tuple[float, ...],
                                   kept: int) -> None:  # fmt: skip
    """Evaluations before and after two and three rounds; a policy that got worse, or is as good, stays as it was."""
    monkeypatch.setattr("afford.grasping.policies.adapt_teacher._experts", expert)
    found = iter(scores)
    monkeypatch.setattr(Adaptation, "scores", lambda self, choose, seed: {"score": np.array([next(found)])})
    made = adapted(tmp_path / "run", policy)
    assert made.log.best_step == kept
    assert (content(made)["policy.safetensors"] == content(Trained(policy, made.log))["policy.safetensors"]) == (kept == 0)


def expert(adaptation: Adaptation, folder: Path, progress: object):  # type: ignore[no-untyped-def]  # an Expert
    from afford.grasping.policies.adapt_teacher import Expert

    return Expert(numbers(GRASP)[None], np.array([True]))


def test_scores_of_episodes() -> None:
    """Success and held count alike; all fingertips at negative points cost half."""
    report = {"success": np.array([1.0, 1.0, 0.0]), "held": np.array([1.0, 0.0, 0.0]), "as_violation_pct": np.array([100.0, 0, 9])}
    assert episode_scores(report).tolist() == [0.5, 0.5, 0.0]


def test_a_body_without_tasks_keeps_the_policy(tmp_path: Path, policy: FileTree) -> None:
    """A refused mesh has nothing to adapt to."""
    made = body_adapt.run(shadow(), (), policy, TINY, Run(tmp_path / "none"))  # type: ignore[arg-type]
    assert made.files == policy and made.log.best_step == 0


def test_rows_before_are_those_of_grasp(tmp_path: Path) -> None:
    """Both targets evaluate the shipped teacher by the same stages, parameters and inputs; a mesh file is a source too."""
    write_obj(tmp_path / "stick.obj", stick().vertices, stick().faces)
    graphs = {target: build(target, origin(target, tmp_path / "stick.obj", Settings(), file_digest)[0], Settings())
              for target in ("grasp", "grasp-adapt")}  # fmt: skip
    for name in ("teacher_bullet", "teacher_mujoco"):
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
