"""Laws of claims between hosts: one holds a key, the dead give it back, and clocks that disagree change nothing."""

from __future__ import annotations

import os
import subprocess
import sys
import threading
import uuid
from collections.abc import Iterator
from pathlib import Path

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from runner.claims import Claims, has_ended, machine_name
from runner.objects import Objects, RemoteError
from runner.remote import Remote
from tests.helpers.object_servers import SERVERS, Server, serving

KEY = "ab" * 32


@pytest.fixture(scope="module", params=SERVERS)
def server(request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory) -> Iterator[Server]:
    with serving(request.param, tmp_path_factory.mktemp(request.param)) as running:
        yield running


class Host:
    """A host with a clock of its own, whose heartbeats are written by the test; it has no thread."""

    def __init__(self, url: str, place: Path, name: str, offset: float = 0.0) -> None:
        self.now = offset
        remote = Remote.open(url, place)
        self.claims = Claims(remote, machine=name, expiry_s=60.0, busy_s=0.0, clock=lambda: self.now)
        remote.attempt(self.claims._register, None)

    def wait(self, seconds: float) -> None:
        self.now += seconds


def hosts(server: Server, place: Path, *offsets: float) -> list[Host]:
    url = f"{server.url}/{uuid.uuid4().hex}"
    return [Host(url, place, f"host{number}", offset) for number, offset in enumerate(offsets)]


def leases(host: Host) -> list[str]:
    return host.claims._objects.list("leases")


def test_one_of_several_holds_a_key(server: Server, tmp_path: Path) -> None:
    """Four hosts claim six keys at once; the holder holds again, and the key is busy for others until it is released."""
    all_hosts, held = hosts(server, tmp_path, 0, 0, 0, 0), list[str]()
    keys = [f"{number:02d}" * 32 for number in range(6)]

    def claim(host: Host) -> None:
        held.extend(key for key in keys if host.claims.acquire(key) == "held")

    threads = [threading.Thread(target=claim, args=(host,)) for host in all_hosts]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert sorted(held) == keys
    states = [host.claims.acquire(keys[0]) for host in all_hosts]
    assert sorted(states) == ["busy", "busy", "busy", "held"]
    all_hosts[states.index("held")].claims.release(keys[0])
    assert all_hosts[states.index("busy")].claims.acquire(keys[0]) == "held"


@pytest.mark.parametrize("offsets", [(0, 0, 0), (0, 7200, -7200), (1e9, 0, 86400)])
def test_the_claim_of_a_dead_owner_is_taken_over(server: Server, tmp_path: Path, offsets: tuple[float, ...]) -> None:
    """One of two takes over, once the heartbeat has been still for the expiry; clocks of hosts may disagree."""
    dead, one, two = hosts(server, tmp_path, *offsets)
    assert dead.claims.acquire(KEY) == "held"
    for _ in range(3):
        one.wait(50)
        two.wait(50)
        dead.claims.beat()
        assert one.claims.acquire(KEY) == "busy" and two.claims.acquire(KEY) == "busy"
    one.wait(61)
    assert one.claims.acquire(KEY) == "held"
    two.wait(61)
    one.claims.beat()
    assert two.claims.acquire(KEY) == "busy"


def test_an_owner_that_returns_does_no_harm(server: Server, tmp_path: Path) -> None:
    """The owner cannot release the claim of the host that took over, and finds the key busy, later done."""
    late, one, two = hosts(server, tmp_path, 0, 0, 0)
    assert late.claims.acquire(KEY) == "held" and one.claims.acquire(KEY) == "busy"
    one.wait(61)
    assert one.claims.acquire(KEY) == "held"
    late.claims.beat()
    late.claims.release(KEY)
    assert two.claims.acquire(KEY) == "busy" and late.claims.acquire(KEY) == "busy"
    one.claims.release(KEY, done=True)
    assert two.claims.acquire(KEY) == "done" and late.claims.acquire(KEY) == "done"


def test_a_finished_task_is_claimed_again_on_request(server: Server, tmp_path: Path) -> None:
    """Its rows or blobs may be damaged; only one host holds it then."""
    one, two, three = hosts(server, tmp_path, 0, 0, 0)
    assert one.claims.acquire(KEY) == "held"
    one.claims.release(KEY, done=True)
    assert two.claims.acquire(KEY) == "done" and two.claims.acquire(KEY, again=True) == "held"
    assert three.claims.acquire(KEY, again=True) == "busy" and one.claims.acquire(KEY) == "busy"
    two.claims.release(KEY, done=True)
    assert one.claims.acquire(KEY) == "done"


def test_the_last_run_collects_claims_and_owners(server: Server, tmp_path: Path) -> None:
    """Finished claims stay while another run is active; dead owners and their claims are collected by the last one."""
    one, two, dead = hosts(server, tmp_path, 0, 0, 0)
    for number, host in enumerate((one, two, dead)):
        assert host.claims.acquire(f"{number:02d}" * 32) == "held"
        if host is not dead:
            host.claims.release(f"{number:02d}" * 32, done=True)
    one.claims.close()
    assert len(leases(two)) == 3 and two.claims._others() == [dead.claims.owner]
    two.claims._observe()
    two.wait(61)
    two.claims.close()
    assert leases(two) == [] and two.claims._objects.list("hosts") == []


def test_busy_keys_cost_few_requests(server: Server, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """A busy key is busy for a while without another request."""
    one, two = hosts(server, tmp_path, 0, 0)
    monkeypatch.setattr(two.claims, "_busy_s", 1.0)
    assert one.claims.acquire(KEY) == "held" and two.claims.acquire(KEY) == "busy"
    one.claims.release(KEY)
    assert two.claims.acquire(KEY) == "busy"
    two.wait(1.5)
    assert two.claims.acquire(KEY) == "held"


def test_damaged_claims_are_taken_over(server: Server, tmp_path: Path) -> None:
    """A claim whose owner cannot be read does not hold."""
    one, _ = hosts(server, tmp_path, 0, 0)
    one.claims._objects.put(f"leases/{KEY}/1", b"{torn")
    assert one.claims.acquire(KEY) == "held" and leases(one) == [f"{KEY}/1", f"{KEY}/2"]


def test_the_thread_writes_heartbeats(server: Server, tmp_path: Path) -> None:
    """Heartbeats begin with registering and end with closing."""
    remote = Remote.open(f"{server.url}/{uuid.uuid4().hex}", tmp_path)
    claims, written = Claims(remote, beat_s=0.01), threading.Event()
    beat = claims.beat

    def noted() -> None:
        beat()
        written.set()

    claims.beat = noted  # type: ignore[method-assign]
    claims.register()
    assert written.wait(30) and int(remote.objects.get(f"hosts/{claims.owner}") or b"0") >= 1
    claims.close()
    assert remote.objects.list("hosts") == [] and not [t for t in threading.enumerate() if t.name == "afford-heartbeat"]


def test_workers_claim_for_their_scheduler(server: Server, tmp_path: Path) -> None:
    """The same owner holds a key in every process; only the scheduler writes heartbeats."""
    one, two = hosts(server, tmp_path, 0, 0)
    worker = Claims(Remote.open(one.claims._objects.url, tmp_path), owner=one.claims.owner, machine="host0")
    assert worker.acquire(KEY) == "held" and one.claims.acquire(KEY) == "held" and two.claims.acquire(KEY) == "busy"
    worker.release(KEY, done=True)
    assert two.claims.acquire(KEY) == "done"


def test_offline_claims_are_held(server: Server, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """A run without its remote executes its tasks, and releases nothing when the remote returns."""
    one, two = hosts(server, tmp_path, 0, 0)
    monkeypatch.setattr(one.claims._remote, "_retry_at", float("inf"))
    assert one.claims.acquire(KEY) == "held"
    one.claims.beat()
    monkeypatch.setattr(one.claims._remote, "_retry_at", 0.0)
    one.claims.release(KEY, done=True)
    assert leases(two) == [] and two.claims.acquire(KEY) == "held"


def test_endpoints_without_conditions_are_refused(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Hosts would execute tasks twice."""

    def ignores(self: Objects, name: str, data: bytes) -> bool:
        self.put(name, data)
        return True

    monkeypatch.setattr(Objects, "create", ignores)
    with pytest.raises(RemoteError, match="If-None-Match"):
        Claims(Remote.open(str(tmp_path / "remote"), tmp_path)).register()


def test_ended_processes_of_this_machine_are_dead_at_once(tmp_path: Path) -> None:
    """Their process id is gone; nothing is concluded about other machines."""
    process = subprocess.Popen([sys.executable, "-c", ""])
    process.wait()
    here = machine_name()
    assert has_ended(f"{here}.{process.pid}.00", here) and not has_ended(f"{here}.{os.getpid()}.00", here)
    assert not has_ended(f"elsewhere.{process.pid}.00", here) and not has_ended("nonsense", here)
    remote = Remote.open(str(tmp_path / "remote"), tmp_path)
    assert Claims(remote, owner=f"{here}.{process.pid}.00").acquire(KEY) == "held"
    assert Claims(remote).acquire(KEY) == "held"


@settings(deadline=None, max_examples=40)
@given(st.lists(st.tuples(st.integers(0, 2), st.sampled_from(["acquire", "fail", "finish", "pause", "wait"])), max_size=40))
def test_a_key_is_held_by_one_living_host(tmp_path_factory: pytest.TempPathFactory, steps: list[tuple[int, str]]) -> None:
    """Any steps of three hosts, of which some pause, keep this true; a finished task is not claimed again."""
    place = tmp_path_factory.mktemp("steps")
    three = hosts(Server(str(place)), place, 0.0, 1e6, -1e6)
    held, paused, done = set[int](), set[int](), False
    for number, step in steps:
        host = three[number]
        if step == "wait":  # time passes for all; who is not paused sends heartbeats, and the others observe
            for other in set(range(3)) - paused:
                three[other].claims.beat()
            for observer in three:
                observer.wait(31)
                observer.claims._observe()
        elif step == "pause":
            paused.symmetric_difference_update({number})
            host.claims.beat()
        elif number in paused:
            continue
        elif step == "acquire":
            state = host.claims.acquire(KEY)
            assert (state == "done") == (done and state != "busy")
            if state == "held":
                assert not (held - {number} - paused)
                held = {number}
            assert state != "busy" or held - {number}
        elif number in held:
            host.claims.release(KEY, done=step == "finish")
            done = done or step == "finish"
            held.discard(number)
