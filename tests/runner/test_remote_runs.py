"""Laws of runs that share a remote: hosts have a store each, and every task is executed once in total."""

from __future__ import annotations

import itertools
import os
import random
import signal
import subprocess
import sys
import threading
import uuid
from collections import Counter
from collections.abc import Iterator
from pathlib import Path

import pytest
from toy import shout
from toy_project import HERE, Project, graph, text, wait_until

from runner import RunReport, StoreError
from runner import claims as claims_module
from runner import objects as objects_module
from runner.objects import open_objects
from runner.remote import RemoteWarning, blob_name, queued
from tests.helpers.object_servers import SERVERS, Server, s3_server, serving

WORDS = ("one two", "three four", "five six", "seven eight")
PARTS = 8
TASKS = {"split": 4, "shout": PARTS, "pair": PARTS, "join": 1}


@pytest.fixture(scope="module", params=SERVERS)
def server(request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory) -> Iterator[Server]:
    with serving(request.param, tmp_path_factory.mktemp(request.param)) as running:
        yield running


@pytest.fixture
def url(server: Server) -> str:
    return f"{server.url}/{uuid.uuid4().hex}"


def hosts(tmp_path: Path, number: int) -> list[Project]:
    """Projects with the same code, a log in common, and a store each."""
    first = Project.make(tmp_path)
    return [Project(first.root, tmp_path / f"store{index}", first.log) for index in range(number)]


def run(project: Project, url: str, **more: object) -> RunReport:
    return project.runner(remote=url).run(graph(*WORDS), "all", **more)  # type: ignore[arg-type]


def start(project: Project, url: str, sleep_s: float = 0.0, jobs: int = 1) -> subprocess.Popen[str]:
    """Start the graph in a process group of its own."""
    environment = os.environ | {"TOY_REMOTE": url, "TOY_LOG": str(project.log)}
    words = [sys.executable, HERE / "toy_main.py", project.store, project.root, str(jobs), str(sleep_s), *WORDS]
    return subprocess.Popen(words, env=environment, stdout=subprocess.PIPE, text=True, start_new_session=True)


def executed(project: Project) -> Counter[str]:
    return Counter({stage: count for stage, count in project.executed().items() if stage in TASKS})


def blobs(project: Project) -> int:
    return sum(path.is_file() for path in (project.store / "blobs").rglob("*"))


def test_another_host_executes_nothing(url: str, tmp_path: Path) -> None:
    """A fresh host has the same outputs, misses nothing, and pulls the bytes of what is read alone."""
    one, two = hosts(tmp_path, 2)
    first = run(one, url)
    assert first.ok and executed(one) == TASKS
    second = run(two, url)
    assert second.ok and not second.ran and second.outputs == first.outputs and not executed(two)
    assert two.runner(remote=url).verify().ok
    before = blobs(two)
    runner = two.runner(remote=url)
    assert runner.load(second.outputs["join"][0][1]) == one.runner().load(first.outputs["join"][0][1])
    assert blobs(two) == before + 1
    assert open_objects(url).list("leases") == [] and open_objects(url).list("hosts") == []
    assert run(two, url).ok and not executed(two)


def test_hosts_that_run_together_share_the_work(url: str, tmp_path: Path) -> None:
    """Both end well, every task is executed once in total, and the outputs are equal."""
    one, two = hosts(tmp_path, 2)
    running = [start(project, url, 0.05) for project in (one, two)]
    for process in running:
        process.communicate(timeout=240)
    assert [process.returncode for process in running] == [0, 0]
    assert executed(one) == TASKS
    reports = [project.runner(remote=url).run(graph(*WORDS, params=shout.Params(sleep_s=0.05)), "all") for project in (one, two)]
    assert reports[0].outputs == reports[1].outputs and not reports[0].ran and not reports[1].ran


def test_a_killed_host_gives_its_tasks_back(url: str, tmp_path: Path) -> None:
    """The other one finishes everything, and no finished task is executed again."""
    one, two = hosts(tmp_path, 2)
    killed = start(one, url, 0.1)
    wait_until(lambda: one.log.exists() and one.log.read_text().count("shout") >= 2, 60)
    other = start(two, url, 0.1)
    wait_until(lambda: one.log.read_text().count("shout") >= 4, 60)
    os.killpg(killed.pid, signal.SIGKILL)
    killed.communicate()
    other.communicate(timeout=240)
    assert other.returncode == 0
    done = executed(one)
    assert done.total() - sum(TASKS.values()) in (0, 1) and all(done[stage] >= TASKS[stage] for stage in TASKS)
    assert open_objects(url).list("leases") == []


def test_damaged_blobs_of_the_remote_are_healed(url: str, tmp_path: Path) -> None:
    """Flipped, missing and empty ones: the host that meets one runs its producer again, and replaces it."""
    one, two, three = hosts(tmp_path, 3)
    first = run(one, url)
    objects = open_objects(url)
    names = objects.list("blobs")
    for number, name in enumerate(names):
        data = objects.get(f"blobs/{name}") or b""
        if number % 3 == 0:
            objects.put(f"blobs/{name}", bytes([data[0] ^ 1]) + data[1:])
        elif number % 3 == 1:
            objects.put(f"blobs/{name}", b"")
        else:
            objects.delete([f"blobs/{name}"])
    executed(one)
    assert run(two, url).ok
    report = run(two, url, force=("join",))
    assert report.ok and report.outputs == first.outputs and text(two, report) == text(one, first)
    assert executed(two)["join"] == 1
    again = run(three, url, force=("join",))
    assert again.ok and text(three, again) == text(one, first) and executed(three) == {"join": 1}


def test_damaged_traces_of_the_remote_are_healed(url: str, tmp_path: Path) -> None:
    """A flipped row is lost, its task runs again, and a new segment records it."""
    one, two, three = hosts(tmp_path, 3)
    first = run(one, url)
    objects = open_objects(url)
    for name in objects.list("traces"):
        lines = (objects.get(f"traces/{name}") or b"").split(b"\n")
        objects.put(f"traces/{name}", b"\n".join(line.replace(b'"shout"', b'"shouT"') for line in lines))
    executed(one)
    assert run(two, url).outputs == first.outputs and executed(two)["shout"] == PARTS
    assert run(three, url).outputs == first.outputs and not executed(three)


def test_a_claim_of_a_finished_task_without_rows_does_not_block(url: str, tmp_path: Path) -> None:
    """Another run is active, so claims stay, but the rows are gone."""
    one, two = hosts(tmp_path, 2)
    open_objects(url).put("hosts/elsewhere.1.00", b"0")
    first = run(one, url)
    objects = open_objects(url)
    assert len(objects.list("leases")) == sum(TASKS.values())
    objects.delete([f"traces/{name}" for name in objects.list("traces")])
    executed(one)
    assert run(two, url).outputs == first.outputs and executed(two) == TASKS


def test_a_dead_host_elsewhere_gives_its_task_back(url: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """A host elsewhere holds a key: while its heartbeat grows, everything else is executed; when it stops, that task is, too."""
    monkeypatch.setattr(claims_module, "EXPIRY_S", 1.0)
    monkeypatch.setattr(claims_module, "BUSY_S", 0.05)
    alone, one = hosts(tmp_path, 2)
    first = alone.run(*WORDS)
    key = first.used["shout"]["w0/w0.0"]
    executed(alone)
    objects, stop, others_done = open_objects(url), threading.Event(), PARTS - 1
    objects.create("hosts/elsewhere.1.00", b"0")
    objects.create(f"leases/{key}/1", b'{"owner": "elsewhere.1.00", "done": false}')

    def beat() -> None:
        for number in itertools.count(1):
            objects.put("hosts/elsewhere.1.00", str(number).encode())
            if stop.wait(0.05):
                return

    def watch() -> None:
        wait_until(lambda: one.log.exists() and one.log.read_text().count("pair") == others_done, 60)
        stop.set()

    threads = [threading.Thread(target=beat), threading.Thread(target=watch)]
    for thread in threads:
        thread.start()
    report = run(one, url)
    assert stop.is_set() and report.ok and report.outputs == first.outputs and executed(one) == TASKS
    for thread in threads:
        thread.join()


@pytest.mark.parametrize("seed", range(4))
def test_random_damage_of_the_remote_is_healed(url: str, tmp_path: Path, seed: int) -> None:
    """Flips, cuts, insertions and deletions of a third of all objects: a fresh host has the outputs of a clean build."""
    one, two, three = hosts(tmp_path, 3)
    open_objects(url).put("hosts/elsewhere.1.00", b"0")  # an active run, so that claims stay
    first, draw, objects = run(one, url), random.Random(seed), open_objects(url)
    names = [f"{place}/{name}" for place in ("blobs", "traces", "leases") for name in objects.list(place)]
    for name in draw.sample(names, len(names) // 3):
        data = objects.get(name) or b""
        at = draw.randrange(len(data) + 1)
        flipped = data[:at] + bytes([draw.randrange(256)]) + data[at + 1 :]
        changed = draw.choice([flipped, data[:at], data[:at] + b"\n" + data[at:], None])
        objects.delete([name]) if changed is None else objects.put(name, changed)
    report = run(two, url)
    assert report.ok and report.outputs == first.outputs
    assert two.runner(remote=url).run(graph(*WORDS), "all", force=["join"]).ok and text(two, report) == text(one, first)
    again = run(three, url, force=("join",))
    assert again.ok and again.outputs == first.outputs and text(three, again) == text(one, first)


def test_a_run_without_its_remote_continues(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """One warning; the next run that is online pushes the results."""
    one, two = hosts(tmp_path, 2)
    with s3_server() as server, monkeypatch.context() as patch:
        for name, value in server.environment.items():
            patch.setenv(name, value)
        url = f"{server.url}/x"
        with monkeypatch.context() as offline:
            offline.setenv("AWS_ENDPOINT_URL", "http://127.0.0.1:9")
            offline.setattr(objects_module, "RETRY", {"max_retries": 0})
            with pytest.warns(RemoteWarning) as caught:
                first = run(one, url)
        assert len(caught) == 1 and first.ok and executed(one) == TASKS and len(queued(one.store)) == sum(TASKS.values())
        assert run(one, url).ok and queued(one.store) == [] and not executed(one)
        assert run(two, url).outputs == first.outputs and not executed(two)


def test_remotes_that_refuse_are_errors(server: Server, tmp_path: Path) -> None:
    """A missing bucket stops the run before any task, in one sentence; a bad URL does so when the runner is created."""
    one = hosts(tmp_path, 1)[0]
    with pytest.raises(ValueError, match="unknown scheme"):
        run(one, "ftp://x/y")
    if server.environment:
        with pytest.raises(StoreError, match="create it first"):
            run(one, server.url.partition("://")[0] + "://there-is-none/x")
    assert not executed(one)


def test_credentials_and_paths_are_not_shared(server: Server, url: str, tmp_path: Path) -> None:
    """Objects hold neither secrets of the environment nor the folders of the host."""
    one = hosts(tmp_path, 1)[0]
    assert run(one, url).ok
    objects = open_objects(url)
    data = b"".join(objects.get(f"traces/{name}") or b"" for name in objects.list("traces"))
    assert data and not [word for word in (*server.secrets, str(tmp_path), os.environ.get("HOME", "?")) if word.encode() in data]
    local = b"".join(path.read_bytes() for path in one.store.rglob("*") if path.is_file())
    assert not [word for word in server.secrets if word.encode() in local]
    assert blob_name("ab" * 32).startswith("blobs/ab/ab")
