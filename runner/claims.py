"""Claims: leases on keys between hosts, made of objects that are created, listed, read, replaced and deleted.

    hosts/OWNER         heartbeat of a run: a counter that grows every few seconds, written by a thread of the scheduler
    leases/KEY/N        claim number N on a key: its owner, and whether the task is done; the highest number holds

A claim is created conditionally, so that one of several wins. An owner is dead when its counter has not changed for `expiry_s` on
the clock of the observer; clocks of different hosts are never compared. Claim N + 1 takes over from a dead owner. An owner
that returns after that executes the task a second time, with the same result. A claim on a finished task stays until no other run
is active, so that a run with an older list of traces does not execute the task again.
"""

from __future__ import annotations

import json
import os
import threading
import time
import uuid
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path
from typing import Literal

from runner.files import host
from runner.objects import RemoteError
from runner.remote import Remote

BEAT_S, EXPIRY_S = 5.0, 60.0
"""time between two heartbeats, and time without one after which an owner is dead"""
OBSERVE_EVERY = 6
"""heartbeats between two looks at those of all others"""
BUSY_S = 1.0
"""time for which a busy key counts as busy without another request"""
ATTEMPTS = 8
"""tries to create a claim while others create and delete claims on the same key"""
State = Literal["held", "busy", "done"]


class Claims:
    """Claims of one run, the owner.

    The scheduler calls `register` and `close`; its workers use the same owner and send no heartbeats. While the remote cannot be
    used, every claim is held: hosts that cannot coordinate execute a task each, with the same result.
    """

    def __init__(self, remote: Remote, owner: str = "", beat_s: float | None = None, expiry_s: float | None = None,
                 busy_s: float | None = None, clock: Callable[[], float] = time.monotonic, machine: str = "") -> None:  # fmt: skip
        self._remote, self._objects = remote, remote.objects
        self.machine = machine or machine_name()
        self.owner = owner or f"{self.machine}.{os.getpid()}.{uuid.uuid4().hex[:12]}"
        self._beat_s = BEAT_S if beat_s is None else beat_s
        self._expiry_s = EXPIRY_S if expiry_s is None else expiry_s
        self._busy_s, self._clock = BUSY_S if busy_s is None else busy_s, clock
        self._numbers: dict[str, int] = {}
        """key -> number of the claim of this process"""
        self._busy: dict[str, float] = {}
        """key -> end of the time for which it counts as busy"""
        self._counters: dict[str, tuple[bytes | None, float]] = {}
        """other owner -> content of its heartbeat, and when it was seen first"""
        self._count, self._stop = 0, threading.Event()
        self._thread: threading.Thread | None = None

    # -- the run ---------------------------------------------------------------------------------------------------

    def register(self) -> None:
        """Write the first heartbeat, and start the thread that writes the next ones.

        RemoteError when the endpoint ignores the condition of a conditional creation.
        """
        if not self._remote.attempt(self._register, True):
            raise RemoteError(f"{self._remote} ignores the condition If-None-Match, without which hosts cannot share it; "
                              "use a storage that supports conditional writes", offline=False)  # fmt: skip
        self._thread = threading.Thread(target=self._beat, name="afford-heartbeat", daemon=True)
        self._thread.start()

    def _register(self) -> bool:
        """False when the second creation of an object succeeds."""
        name = f"hosts/{self.owner}"
        self._objects.create(name, b"0")
        if self._objects.create(name, b"0"):
            return False
        self._observe()
        return True

    def _beat(self) -> None:
        while not self._stop.wait(self._beat_s):
            self.beat()

    def beat(self) -> None:
        """Write a heartbeat."""
        self._count += 1
        self._remote.attempt(lambda: self._objects.put(f"hosts/{self.owner}", str(self._count).encode()), None)
        if self._count % OBSERVE_EVERY == 0:
            self._remote.attempt(self._observe, None)

    def _observe(self) -> None:
        """Note the heartbeats of all others, of which some may be dead."""
        for other in self._others():
            self._is_dead(other)

    def close(self) -> None:
        """Stop the heartbeats; delete what this run and dead ones have left, unless another run is active."""
        self._stop.set()
        if self._thread is not None:
            self._thread.join()
            self._thread = None
        self._remote.attempt(self._collect, None)

    def _collect(self) -> None:
        leases = self._objects.list("leases")  # before the owners: a run that registers later is not in this list
        others = self._others()
        dead = [other for other in others if self._is_dead(other)]
        if len(dead) == len(others):
            self._objects.delete([f"leases/{name}" for name in leases])
        self._objects.delete([f"hosts/{owner}" for owner in (*dead, self.owner)])

    def _others(self) -> list[str]:
        return [name for name in self._objects.list("hosts") if name != self.owner]

    # -- one key ---------------------------------------------------------------------------------------------------

    def acquire(self, key: str, again: bool = False) -> State:
        """Claim a key: 'held' by this run, 'busy' elsewhere, or 'done' by a run that has pushed its rows.

        `again` claims a finished task, whose rows or blobs are damaged or gone.
        """
        if self._clock() < self._busy.get(key, float("-inf")):
            return "busy"
        state: State = self._remote.attempt(lambda: self._acquire(key, again), "held")
        if state == "busy":
            self._busy[key] = self._clock() + self._busy_s
        else:
            self._busy.pop(key, None)
        return state

    def _acquire(self, key: str, again: bool) -> State:
        number = 1
        for _ in range(ATTEMPTS):
            if self._objects.create(f"leases/{key}/{number}", _claim(self.owner)):
                self._numbers[key] = number
                return "held"
            number, owner, done = self._highest(key)
            if done and not again:
                return "done"
            if owner == self.owner and not done:
                self._numbers[key] = number
                return "held"
            if owner and not done and not self._is_dead(owner):
                return "busy"
            number += 1
        return "busy"

    def _highest(self, key: str) -> tuple[int, str, bool]:
        """(number, owner, done) of the claim that holds; (0, '', False) when all are gone."""
        numbers = [int(name) for name in self._objects.list(f"leases/{key}") if name.isdigit()]
        content = self._objects.get(f"leases/{key}/{max(numbers)}") if numbers else None
        if content is None:
            return 0, "", False
        return max(numbers), *_claimed(content)

    def release(self, key: str, done: bool = False) -> None:
        """Give a claim back; `done` when the rows of the task have been pushed."""
        number = self._numbers.pop(key, 0)
        if number:
            self._remote.attempt(lambda: self._release(key, number, done), None)

    def _release(self, key: str, number: int, done: bool) -> None:
        if done:
            self._objects.put(f"leases/{key}/{number}", _claim(self.owner, done=True))
        elif self._highest(key)[0] == number:  # else another host has declared this one dead, and holds the key now
            for lower in range(1, number + 1):
                self._objects.delete([f"leases/{key}/{lower}"])

    def _is_dead(self, owner: str) -> bool:
        """Return True when an owner has ended, or its heartbeat has not changed for `expiry_s` of the own clock."""
        if has_ended(owner, self.machine):
            return True
        now, content = self._clock(), self._objects.get(f"hosts/{owner}")
        if content is None:
            return True
        known = self._counters.get(owner)
        if known is None or known[0] != content:
            self._counters[owner] = content, now
            return False
        return now - known[1] >= self._expiry_s


def _claim(owner: str, done: bool = False) -> bytes:
    return json.dumps({"owner": owner, "done": done}).encode()


def _claimed(content: bytes) -> tuple[str, bool]:
    """(owner, done) of a claim; a damaged one has no owner, and is taken over."""
    try:
        tree = json.loads(content)
        return str(tree["owner"]), tree["done"] is True
    except (ValueError, TypeError, KeyError):
        return "", False


def has_ended(owner: str, machine: str) -> bool:
    """Return True when an owner is a process of this machine that does not exist any more."""
    at, _, rest = owner.rpartition(".")[0].rpartition(".")
    if at != machine or not rest.isdigit():
        return False
    try:
        os.kill(int(rest), 0)
    except ProcessLookupError:
        return True
    except PermissionError:
        return False
    return False


def machine_name() -> str:
    """Name of this machine since its start, and of this space of process ids: containers on one machine differ."""
    boot, space = "", ""
    with suppress(OSError):
        boot = Path("/proc/sys/kernel/random/boot_id").read_text(encoding="ascii")[:8]
        space = str(os.stat("/proc/self/ns/pid").st_ino)
    return "-".join(part for part in (host(), boot, space) if part) if boot else f"{host()}-{uuid.getnode():x}"


