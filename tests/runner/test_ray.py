"""The Ray engine gives the bytes of an inline run, ships the code of the stages, and survives the loss of a node."""

from __future__ import annotations

import os
import socket
import sys
import threading
from collections import Counter
from collections.abc import Callable, Iterator
from dataclasses import replace
from functools import partial
from importlib.util import find_spec
from pathlib import Path
from typing import Any

import pytest
from toy import shout
from toy_project import Project, graph, text, wait_until

from runner import ray_node
from runner.engines import Inline
from runner.execute import Job
from runner.ray_code import Parcels, pack
from runner.ray_engine import RayEngine, RayError, load_ray
from runner.report import SilentObserver
from tests.helpers.ray_nodes import Nodes, descendants, ray_nodes

needs_ray = pytest.mark.skipif(find_spec("ray") is None, reason="needs the extra ray")
WORDS = ("one", "two", "three", "four")


@pytest.fixture
def nodes(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Nodes]:
    with ray_nodes(tmp_path, monkeypatch) as running:
        yield running


def blobs(project: Project) -> set[str]:
    return {path.name for path in (project.store / "blobs").rglob("*") if path.is_file()}


@needs_ray
@pytest.mark.slow
def test_bytes_are_those_of_an_inline_run_and_a_failure_stays_in_its_shard(tmp_path: Path, nodes: Nodes) -> None:
    """A stage that raises, and one whose process is killed, fail alone; nodes do not see the code, and unpack it."""
    nodes.add(num_cpus=2)
    project, other = Project.make(tmp_path / "ray"), Project.make(tmp_path / "inline")
    seen: list[str] = []

    def hidden(*arguments: Any) -> RayEngine:
        engine = nodes.engine(*arguments)
        setting = engine.setting()
        engine.setting = lambda: {**setting, "root": "/nowhere/code"}  # type: ignore[method-assign]
        return engine

    class Observer(SilentObserver):
        def started(self, stage: str, shard: str, *_: Any) -> None:
            seen.append(stage)

    report = project.runner(engine=hidden).run(graph(*WORDS, "bad", "kill"), "all", observer=Observer())
    assert sorted({failure.shard.partition("/")[0] for failure in report.failures}) == ["w4", "w5"]
    assert any("refused" in failure.message for failure in report.failures)
    assert any("SIGKILL" in failure.message for failure in report.failures)
    assert report.ran == {"split": 6, "shout": 8, "pair": 8, "join": 1} and seen.count("shout") >= 12
    again = project.runner(engine=nodes.engine).run(graph(*WORDS), "all")
    inline = other.run(*WORDS)
    assert again.cached == {"split": 4, "shout": 8, "pair": 8, "join": 1} and not again.ran
    assert again.used == inline.used and again.outputs == inline.outputs
    assert text(project, again) == text(other, inline)
    assert blobs(other) <= blobs(project)
    assert list((nodes.folder / f"afford-ray-{os.getuid()}" / "code").glob("*/root/toy/shout.py"))


@needs_ray
@pytest.mark.slow
def test_a_node_lost_in_the_middle_changes_nothing(tmp_path: Path, nodes: Nodes, capsys: pytest.CaptureFixture[str]) -> None:
    """Three nodes, one killed while its tasks run: the result is that of a clean build, and no finished task runs again."""
    first, *_ = [nodes.add(num_cpus=1) for _ in range(3)]
    project, clean = Project.make(tmp_path / "ray"), Project.make(tmp_path / "clean")
    words = [f"word{i}" for i in range(10)]
    params = shout.Params(sleep_s=0.2)
    finished: list[tuple[str, str]] = []

    class Observer(SilentObserver):
        def finished(self, stage: str, shard: str, result: Any, *_: Any) -> None:
            finished.append((stage, shard))

    def kill() -> None:
        wait_until(lambda: sum(stage == "shout" for stage, _ in finished) >= 6)
        before.update(finished)
        nodes.cluster.remove_node(first, allow_graceful=False)

    before: set[tuple[str, str]] = set()
    killer = threading.Thread(target=kill)
    killer.start()
    report = project.runner(engine=nodes.engine).run(graph(*words, params=params), "all", observer=Observer())
    killer.join()
    executed = Counter(nodes.log.read_text().split("\n")[:-1])
    assert report.ok and before and capsys.readouterr().out == ""
    expected = clean.run(*words, params=params)
    assert report.used == expected.used and report.outputs == expected.outputs and text(project, report) == text(clean, expected)
    assert all(executed[f"shout {shard.partition('/')[2]}"] == 1 for stage, shard in before if stage == "shout")
    assert sum(executed.values()) <= sum(expected.ran.values()) + 3  # tasks that ran on the lost node


@needs_ray
@pytest.mark.slow
def test_resources_decide_where_a_task_runs(tmp_path: Path, nodes: Nodes) -> None:
    """A stage that declares a GPU fails with advice while no node has one, and then sees exactly the GPU that Ray chose."""
    nodes.add(num_cpus=1)
    project = Project.make(tmp_path / "ray")
    project.edit("toy/shout.py", 'LIBRARIES = ("blake3",)', 'LIBRARIES = ("blake3",)\nGPUS = 1')
    project.edit("toy/shout.py", 'note("shout", part.name)', 'note("shout", os.environ["CUDA_VISIBLE_DEVICES"])')
    report = project.runner(engine=nodes.engine).run(graph("one"), "all")
    assert len(report.failures) == 2 and "GPU" in report.failures[0].message
    nodes.add(num_cpus=1, num_gpus=1)
    report = project.runner(engine=nodes.engine).run(graph("one"), "all")
    assert report.ok and report.ran["shout"] == 2
    assert {line.split()[1] for line in nodes.log.read_text().split("\n") if line.startswith("shout")} == {"0"}


@needs_ray
@pytest.mark.slow
def test_an_ended_job_is_not_reported_and_its_neighbours_come_back(tmp_path: Path, nodes: Nodes) -> None:
    """`end` kills the stage process; jobs of the batch that had no result are returned."""
    nodes.add(num_cpus=1)
    project = Project.make(tmp_path / "ray")
    jobs = jobs_of(project, *WORDS[:3], sleep_s=2.0)
    engine = nodes.engine(project.runner().worker_spec)
    try:
        engine.submit(jobs)
        found: list[Any] = []
        while not any(what == "started" for what, _, _ in found):
            found += engine.wait(10.0)
        engine.end(jobs[0].key)
        while sum(what == "done" for what, _, _ in found) < len(jobs) - 1:
            found += engine.wait(10.0)
        done = {key: result.status for what, key, result in found if what == "done"}
        assert done == {job.key: "returned" for job in jobs[1:]}
        assert engine.wait(0.0) == []
    finally:
        engine.close()


@needs_ray
@pytest.mark.slow
def test_a_private_cluster_listens_on_this_machine_only(tmp_path: Path) -> None:
    """Every listening socket of the processes that it starts is bound to 127.0.0.1, and all of them end with it."""
    project = Project.make(tmp_path / "ray")
    engine = RayEngine(project.runner().worker_spec, jobs=1)
    try:
        pids = descendants(os.getpid())
        addresses = listening(pids)
        assert pids and addresses and {address for address, _ in addresses} <= {"127.0.0.1"}
        folder = Path(engine.folder)
        assert folder.stat().st_mode & 0o077 == 0
        secret = os.environ.get("RAY_AUTH_TOKEN", "")
        logs = [path for path in folder.rglob("*") if path.is_file()]
        assert secret and logs and not any(secret.encode() in path.read_bytes() for path in logs)
    finally:
        engine.close()
    wait_until(lambda: not descendants(os.getpid()) & pids)
    assert not folder.exists()


def jobs_of(project: Project, *words: str, sleep_s: float) -> list[Job]:
    """Jobs of the stage `shout`, as a scheduler would submit them."""
    found: list[Job] = []

    class Recorder(Inline):
        def submit(self, jobs: list[Job], gpus: tuple[str, ...] = ()) -> None:
            found.extend(job for job in jobs if job.spec.stage == "shout")
            super().submit(jobs)

    project.runner(engine=Recorder).run(graph(*words, params=shout.Params()), "all")
    spec = replace(found[0].spec, params=shout.Params(sleep_s=sleep_s))
    return [replace(job, spec=spec, force=True) for job in found[: len(words)]]


def listening(pids: set[int]) -> set[tuple[str, int]]:
    """(address, port) of the listening TCP sockets of processes."""
    inodes = set()
    for pid in pids:
        for link in Path("/proc", str(pid), "fd").iterdir():
            try:
                inodes.add(os.readlink(link))
            except OSError:
                continue  # closed meanwhile
    found = set()
    for table, digits in (("tcp", 8), ("tcp6", 32)):
        for line in Path("/proc/net", table).read_text().split("\n")[1:-1]:
            fields = line.split()
            address, _, port = fields[1].partition(":")
            if fields[3] == "0A" and f"socket:[{fields[9]}]" in inodes:
                last = bytes.fromhex(address[digits - 8 :])[::-1]
                found.add((".".join(map(str, last)), int(port, 16)))
    return found


# -- without Ray ---------------------------------------------------------------------------------------------------------


def test_a_missing_package_is_one_sentence(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "ray", None)
    with pytest.raises(RayError, match="make setup EXTRA=ray"):
        load_ray(None)


def test_a_client_address_is_refused() -> None:
    with pytest.raises(RayError, match="HOST:PORT"):
        load_ray("ray://127.0.0.1:10001")


@needs_ray
def test_an_address_where_nothing_listens_is_one_sentence(tmp_path: Path) -> None:
    """A malformed address, too; Ray itself would try for minutes."""
    spec = Project.make(tmp_path).runner().worker_spec
    with socket.socket() as closed:
        closed.bind(("127.0.0.1", 0))
        for address, words in ((f"127.0.0.1:{closed.getsockname()[1]}", "no Ray cluster answers"), ("here", "expected HOST:PORT")):
            with pytest.raises(RayError, match=words):
                RayEngine(spec, address=address)


def parcels(root: Path) -> Parcels:
    return Parcels(root, None, ("schemas",), ["toy.values"])


def test_a_parcel_holds_what_a_stage_loads_and_nothing_else(tmp_path: Path) -> None:
    """The stage's module, what it imports, their packages, and the runner; not the other stages."""
    root = Project.make(tmp_path).root
    parcel = parcels(root).of([str(root / "toy" / "shout.py")])
    inside = {path for place, path, _, _ in parcel.files if place == "root"}
    assert {"toy/shout.py", "toy/helper.py", "toy/log.py", "toy/values.py"} <= inside
    assert not inside & {"toy/join.py", "toy/wide.py"}
    assert "runner/execute.py" in {path for place, path, _, _ in parcel.files if place == "engine"}


def test_the_name_of_a_parcel_is_the_digest_of_its_files(tmp_path: Path) -> None:
    """Same files, same name; another byte, another name; a further stage, a parcel that holds both."""
    project = Project.make(tmp_path)
    sources = [str(project.root / "toy" / "shout.py")]
    first, same = parcels(project.root).of(sources), parcels(project.root)
    assert same.of(sources) == first and same.of(sources) is same.of(sources)
    grown = same.of([str(project.root / "toy" / "join.py")])
    assert set(first.files) < set(grown.files) and grown.digest != first.digest
    project.edit("toy/helper.py", '"!"', '"?"')
    assert parcels(project.root).of(sources).digest != first.digest


@pytest.fixture
def node(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.setattr(ray_node.tempfile, "gettempdir", lambda: str(tmp_path / "node"))
    (tmp_path / "node").mkdir()
    return tmp_path / "node"


Unpack = Callable[[], tuple[str, str]]


@pytest.fixture
def unpack(tmp_path: Path, node: Path) -> Unpack:
    root = Project.make(tmp_path).root
    parcel = parcels(root).of([str(root / "toy" / "shout.py")])
    places = {"root": "/nowhere", "engine": "/nowhere"}
    return partial(ray_node.code_folders, parcel.digest, places, list(parcel.files), parcel.data)


def test_code_is_unpacked_once_under_its_digest_and_mended_when_damaged(unpack: Unpack, node: Path) -> None:
    root, engine = unpack()
    file = Path(root) / "toy" / "shout.py"
    before = file.stat().st_ino
    assert node in file.parents and (Path(engine) / "runner" / "execute.py").is_file()
    assert unpack() == (root, engine) and file.stat().st_ino == before
    file.write_text("changed")
    assert unpack() == (root, engine) and "note" in file.read_text()
    assert sorted(path.name for path in Path(root).parent.parent.iterdir()) == [Path(root).parent.name]


def test_a_node_that_sees_the_same_files_uses_them(tmp_path: Path, node: Path) -> None:
    root = Project.make(tmp_path).root
    parcel = parcels(root).of([str(root / "toy" / "shout.py")])
    engine = str(Path(ray_node.__file__).parent.parent)
    assert ray_node.code_folders(parcel.digest, {"root": str(root), "engine": engine}, list(parcel.files), parcel.data) == (
        str(root), engine)
    assert not list(node.iterdir())


def test_a_file_outside_the_folder_is_refused(tmp_path: Path, node: Path) -> None:
    root = Project.make(tmp_path).root
    parcel = pack(root, Path(ray_node.__file__).parent.parent, [str(root / "toy" / "log.py")])
    files = [("root", "../../../outside.py", found, size) if place == "root" else (place, inside, found, size)
             for place, inside, found, size in parcel.files]
    with pytest.raises(ray_node.NodeError, match="outside"):
        ray_node.code_folders(parcel.digest, {"root": "/nowhere", "engine": "/nowhere"}, files, parcel.data)
    assert not list(node.rglob("outside.py"))


def test_a_node_without_the_shared_store_says_what_to_do(tmp_path: Path) -> None:
    with pytest.raises(ray_node.NodeError, match="--remote"):
        ray_node.store_folder({"store": str(tmp_path / "none"), "token": "leases/x", "remote": None})


def test_a_remote_store_gives_each_node_a_folder_of_its_own(node: Path) -> None:
    one, two = (ray_node.store_folder({"store": "/driver/store", "token": "", "remote": url}) for url in ("s3://a", "s3://b"))
    assert one != two and node in Path(one).parents and Path(two).is_dir()
