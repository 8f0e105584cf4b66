"""A published policy plays on a mesh of one's own: the very lines of the page, with a policy that has learned nothing."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import trimesh

from afford.common.files import tree
from commands.outputs import Publisher, publish_outputs
from commands.session import open_runner
from maps.settings import Origin
from runner import Graph
from tests.helpers.made_students import teacher
from tests.helpers.mesh_files import write_labels, write_obj

PAGE = Path(__file__).parents[2] / "docs" / "grasping" / "grasping.md"
STICK_M = (0.2, 0.02, 0.02)


def code() -> str:
    """The first Python block below the heading."""
    section = PAGE.read_text().partition("## Your own object")[2]
    return section.partition("```python\n")[2].partition("```")[0]


def knife(folder: Path) -> np.ndarray:
    """A stick that lies along x, half of it a blade, as OBJ and labels; (k, 3) points of the blade."""
    folder.mkdir(parents=True)
    stick = trimesh.creation.box(STICK_M).subdivide().subdivide()
    middle = stick.vertices[stick.faces].mean(axis=1)
    blade = middle[:, 0] > 0
    faces = np.concatenate([stick.faces[blade], stick.faces[~blade]])
    write_obj(folder / "knife.obj", stick.vertices, faces)
    write_labels(folder / "knife.obj", parts={"blade": [[0, int(blade.sum())]], "handle": [[int(blade.sum()), len(faces)]]})
    return np.asarray(middle[blade])


def test_the_lines_of_the_page_play_an_episode(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """The policy is shown the points of the file; the episode is judged by the part that was named."""
    points = knife(tmp_path / "things" / "knife")
    (tmp_path / "negative.json").write_text(json.dumps({"N_t": points[:40].tolist()}))
    teacher(tmp_path / "artifacts" / "models" / "grasp-teacher")
    monkeypatch.chdir(tmp_path)
    found: dict[str, Any] = {}
    exec(compile(code(), str(PAGE), "exec"), found)
    task, played = found["task"], found["episodes"]
    assert {tuple(place) for place in task.N_t} == {tuple(place) for place in points[:40]}
    assert task.body.parts == ("blade", "handle") and task.negative.tolist() == [True, False] and task.hold == 1
    assert np.allclose(np.ptp(task.body.points, axis=0), STICK_M, atol=1e-6)
    assert played.q.shape[:2] == (1, found["worlds"].config.steps + 1) and np.ptp(played.palm[0, :, 2]) > 0.05
    assert all(values.shape == (1,) for values in played.report.values()) and played.report["as_violation_pct"][0] >= 0


def test_finished_policies_are_published_under_their_row(tmp_path: Path) -> None:
    """The folder has the name of the run; a policy that is not finished is no error."""
    runner, g = open_runner(tmp_path / "store", jobs=0), Graph()
    files = teacher(tmp_path / "made")
    shown = [g.publish(g.leaf(f"{row}_0.files", tree(row, tmp_path / "made")), f"models/{{source}}-{row}", as_=row)
             for row in ("teacher", "student_no_negative")]  # fmt: skip
    g.target("some", g.finished("policies", shown))
    g.target("none", g.finished("policies", []))
    place = Origin("grasp-full")
    models = tmp_path / "store" / "models"
    assert publish_outputs(Publisher(runner), g, runner.run(g, "some"), place, True) == {
        row: str(models / f"grasp-full-{row}") for row in ("teacher", "student_no_negative")}  # fmt: skip
    assert [(file.name, file.digest) for file in tree("again", models / "grasp-full-teacher").files] == [
        (file.name, file.digest) for file in files.files]
    assert publish_outputs(Publisher(runner), g, runner.run(g, "none"), place, True) == {}
