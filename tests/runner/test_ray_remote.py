"""Runs on Ray nodes that share nothing but a remote: the bytes of an inline run, and no task twice."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import threading
from collections import Counter
from collections.abc import Iterator
from importlib.util import find_spec
from pathlib import Path
from typing import Any

import pytest
from toy import shout
from toy_project import HERE, Project, graph, text, wait_until

from runner import ray_engine
from runner.objects import open_objects
from runner.report import SilentObserver
from tests.helpers.object_servers import folder, s3_server
from tests.helpers.ray_nodes import Nodes, descendants, ray_nodes

pytestmark = [pytest.mark.slow, pytest.mark.skipif(find_spec("ray") is None, reason="needs the extra ray")]
WORDS = tuple(f"word{i}" for i in range(8))


@pytest.fixture
def nodes(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Nodes]:
    with ray_nodes(tmp_path, monkeypatch) as running:
        yield running


@pytest.fixture(params=["folder", "s3"])
def url(request: pytest.FixtureRequest, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[str]:
    with folder(tmp_path / "remote") if request.param == "folder" else s3_server() as server:
        for name, value in server.environment.items():
            monkeypatch.setenv(name, value)
        yield f"{server.url}/shared"


def apart(nodes: Nodes, number: int) -> list[Any]:
    """Nodes of one core, with a folder of temporary files each."""
    places = [nodes.folder / f"n{index}" for index in range(number)]
    for place in places:
        place.mkdir()
    return [nodes.add(place, num_cpus=1) for place in places]


def stores(nodes: Nodes) -> list[Path]:
    """Stores of the nodes."""
    return sorted(nodes.folder.glob("n*/afford-ray-*/stores/*"))


def executed(nodes: Nodes) -> Counter[str]:
    return Counter(nodes.log.read_text().split("\n")[:-1])


def blobs(store: Path) -> int:
    return sum(path.is_file() for path in (store / "blobs").rglob("*"))


def test_nodes_share_nothing_but_the_remote(url: str, tmp_path: Path, nodes: Nodes) -> None:
    """The driver has every trace, pulls the bytes that are read alone, and a second run has nothing to do, here or elsewhere."""
    apart(nodes, 2)
    project, other = Project.make(tmp_path / "ray"), Project.make(tmp_path / "inline")
    params = shout.Params(sleep_s=0.1)
    report = project.runner(engine=nodes.engine, remote=url).run(graph(*WORDS, params=params), "all")
    first = executed(nodes)
    expected = other.run(*WORDS, params=params)
    assert report.ok and report.ran == expected.ran and report.used == expected.used and report.outputs == expected.outputs
    assert len(stores(nodes)) == 2 and set(first.values()) == {1} and first.total() == sum(expected.ran.values())
    assert blobs(project.store) == len(WORDS)  # the leafs
    index = project.runner().index
    traces = {trace.key: trace for trace in index.all()}
    assert traces.keys() == {key for keys in report.used.values() for key in keys.values()}
    assert all(index.get(key) == trace for key, trace in traces.items()) and not index.outdated()
    runner = project.runner(remote=url)
    word = runner.load(report.outputs["join"][0][1])
    assert word == other.runner().load(expected.outputs["join"][0][1]) and blobs(project.store) == len(WORDS) + 1
    third = Project(project.root, tmp_path / "third", project.log)
    for again in (project.runner(engine=nodes.engine, remote=url), third.runner(remote=url)):
        repeated = again.run(graph(*WORDS, params=params), "all")
        assert repeated.ok and not repeated.ran and repeated.outputs == report.outputs
    assert executed(nodes) == first
    assert open_objects(url).list("leases") == [] and open_objects(url).list("hosts") == []


def test_outputs_of_runs_without_the_remote_travel(tmp_path: Path, nodes: Nodes) -> None:
    """The driver pushes what nodes read and it alone has; nothing that it has runs again."""
    apart(nodes, 1)
    project, url = Project.make(tmp_path / "ray"), str(tmp_path / "remote")
    project.run(*WORDS)
    project.executed()
    project.edit("toy/join.py", "def run", "OTHER = 1\n\n\ndef run")
    report = project.runner(engine=nodes.engine, remote=url).run(graph(*WORDS), "all", force=["join"])
    assert report.ok and report.ran == {"join": 1} and list(executed(nodes).values()) == [1]


def test_lost_objects_are_made_again(tmp_path: Path, nodes: Nodes) -> None:
    """Blobs and leafs that the remote has lost: nodes without them name them, and their producers run once."""
    apart(nodes, 1)
    project, other, url = Project.make(tmp_path / "ray"), Project.make(tmp_path / "inline"), str(tmp_path / "remote")
    first = project.runner(engine=nodes.engine, remote=url).run(graph(*WORDS), "all")
    objects = open_objects(url)
    objects.delete([f"blobs/{name}" for name in objects.list("blobs")])
    before = executed(nodes)
    for path in [path for store in stores(nodes) for path in (store / "blobs").rglob("*") if path.is_file()]:
        path.unlink()
    report = project.runner(engine=nodes.engine, remote=url).run(graph(*WORDS), "all", force=["join"])
    assert report.ok and report.outputs == first.outputs and text_at(project, url, report) == text(other, other.run(*WORDS))
    assert max((executed(nodes) - before).values()) == 1


def text_at(project: Project, url: str, report: Any) -> str:
    """Text of the output of `join`, pulled if need be."""
    return str(project.runner(remote=url).load(report.outputs["join"][0][1]).text)


def test_a_node_lost_in_the_middle_changes_nothing(url: str, tmp_path: Path, nodes: Nodes) -> None:
    """Its store is lost with it; finished tasks do not run again, and the result is that of a clean build."""
    first, *_ = apart(nodes, 3)
    project, clean = Project.make(tmp_path / "ray"), Project.make(tmp_path / "clean")
    params, finished = shout.Params(sleep_s=0.2), list[tuple[str, str]]()
    before: set[tuple[str, str]] = set()

    class Observer(SilentObserver):
        def finished(self, stage: str, shard: str, *_: Any) -> None:
            finished.append((stage, shard))

    def kill() -> None:
        wait_until(lambda: sum(stage == "shout" for stage, _ in finished) >= 6, 60)
        before.update(finished)
        nodes.kill(first)

    killer = threading.Thread(target=kill)
    killer.start()
    report = project.runner(engine=nodes.engine, remote=url).run(graph(*WORDS, params=params), "all", observer=Observer())
    killer.join()
    counts = executed(nodes)
    expected = clean.run(*WORDS, params=params)
    assert report.ok and before and report.used == expected.used and report.outputs == expected.outputs
    assert text_at(project, url, report) == text(clean, expected)
    assert all(counts[f"shout {shard.partition('/')[2]}"] == 1 for stage, shard in before if stage == "shout")
    assert counts.total() <= sum(expected.ran.values()) + 1  # the task that ran on the lost node
    again = project.runner(engine=nodes.engine, remote=url).run(graph(*WORDS, params=params), "all")
    assert again.ok and not again.ran


def test_stage_processes_are_replaced(tmp_path: Path, nodes: Nodes, monkeypatch: pytest.MonkeyPatch) -> None:
    """A process ends between two batches once it has run enough jobs; the results are those of an inline run."""
    nodes.add(num_cpus=1)
    monkeypatch.setattr(ray_engine, "MAX_JOBS", 1)
    project, other = Project.make(tmp_path / "ray"), Project.make(tmp_path / "inline")
    project.edit("toy/shout.py", 'note("shout", part.name)', 'note("shout", str(os.getpid()))')
    other.edit("toy/shout.py", 'note("shout", part.name)', 'note("shout", str(os.getpid()))')
    params = shout.Params(sleep_s=0.6)
    report = project.runner(engine=nodes.engine).run(graph("one two", "three", params=params), "all")
    pids = {line for line in executed(nodes) if line.startswith("shout")}
    assert report.ok and report.outputs == other.run("one two", "three", params=params).outputs and len(pids) > 1


SCRIPT = """
import sys
sys.path[:0] = [sys.argv[3], sys.argv[4]]
from functools import partial
from pathlib import Path
from toy import shout
from toy_project import graph
from runner import Runner
from runner.ray_engine import RayEngine
runner = Runner(Path(sys.argv[1]), Path(sys.argv[2]), "toy.values:CODEC", engine=partial(RayEngine, jobs=2))
runner.run(graph("one", "two", params=shout.Params(sleep_s=60.0)), "all")
"""


def test_sigterm_ends_the_driver_and_its_cluster(tmp_path: Path) -> None:
    """The exit status is 143, and no process of the private cluster remains; finished tasks are kept."""
    project = Project.make(tmp_path)
    words = [sys.executable, "-c", SCRIPT, project.store, project.root, HERE.parents[1], HERE]
    driver = subprocess.Popen(words, env=os.environ | {"TOY_LOG": str(project.log)}, start_new_session=True)
    try:
        wait_until(lambda: project.log.exists() and "shout" in project.log.read_text(), 60)
        started = descendants(driver.pid)
        driver.send_signal(signal.SIGTERM)
        assert driver.wait(60) == 143 and started
        wait_until(lambda: not [pid for pid in started if running(pid)])
    finally:
        driver.kill()
    assert "split" in project.runner().index.stages()


def running(pid: int) -> bool:
    """Return True unless a process has ended; one without a reader of its exit status counts as ended."""
    try:
        return Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()[0] != "Z"
    except FileNotFoundError:
        return False
