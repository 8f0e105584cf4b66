"""Main loop of a stage process under a Ray worker: receives batches, executes them in order, and sends one frame per result."""

from __future__ import annotations

import json
import os
import pickle
import signal
import socket
import struct
import threading
from collections.abc import Collection
from dataclasses import replace
from pathlib import Path
from typing import Any

from runner.execute import Job, JobResult, JobSpec, WorkerSpec, Workplace, execute
from runner.files import host
from runner.keys import installed_version, machine_kind
from runner.memory import resident_mib
from runner.ray_node import DONE, HEAD, HEAD_BYTES, MEMORY, PROGRESS, REFUSED, SIZE, STEPS
from runner.segments import OtherRuns, encode
from runner.store import prepare_store
from runner.worker import die_with_parent, load_from_source


def main(socket_fd: str, lifeline_fd: str) -> None:
    """Run batches until the Ray worker closes the connection.

    `lifeline_fd` is a pipe whose other end only the Ray worker holds. Output of stages and libraries goes to stderr, which is
    Ray's log of that worker.
    """
    os.dup2(2, 1)
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    signal.signal(signal.SIGTERM, signal.SIG_DFL)
    threading.Thread(target=die_with_parent, args=(int(lifeline_fd),), daemon=True).start()
    channel = Channel(socket.socket(fileno=int(socket_fd)))
    start = json.loads(channel.receive())
    load_from_source(Path(start["root"]))
    executor = _opened(start, channel)
    while executor is not None and (batch := channel.receive()):
        jobs, suspects = pickle.loads(batch)  # from the driver's memory, never from a disk
        for job in jobs:
            result = executor.run(job, suspects, channel)
            if job is jobs[-1]:
                channel.send(MEMORY, struct.pack(SIZE, resident_mib()))
            channel.send(DONE, pickle.dumps(tuple(vars(result).values()), 5))
    if executor is not None:
        executor.place.close()


def _opened(start: dict[str, Any], channel: Channel) -> Executor | None:
    """Open the store with its codec; None, and the reason to the driver, when that fails on this node."""
    try:
        return Executor(start)
    except Exception as error:
        channel.send(REFUSED, f"the code cannot start ({type(error).__name__}: {error}); install the driver's libraries".encode())
        return None


class Channel:
    """Frames to and from the Ray worker, see `runner.ray_node`."""

    def __init__(self, connection: socket.socket) -> None:
        self._connection = connection

    def receive(self) -> bytes:
        """Return the next payload; b'' at the end."""
        head = self._exactly(HEAD_BYTES)
        return self._exactly(struct.unpack(HEAD, head)[0]) if head else b""

    def send(self, kind: int, payload: bytes) -> None:
        """Send one frame."""
        self._connection.sendall(struct.pack(HEAD, len(payload), kind) + payload)

    def progress(self, done: int, total: int) -> None:
        """Report the progress of the job that runs."""
        self.send(PROGRESS, struct.pack(STEPS, done, total))

    def _exactly(self, size: int) -> bytes:
        data = bytearray()
        while len(data) < size:
            more = self._connection.recv(min(size - len(data), 1 << 20))
            if not more:
                return b""
            data += more
        return bytes(data)


class Executor:
    """Executes jobs on this node, whose code and store may have other paths than the driver's."""

    def __init__(self, start: dict[str, Any]) -> None:
        spec = WorkerSpec(Path(start["store"]), start["codec"], start["worker"], Path(start["root"]), tuple(start["schemas"]),
                          start["remote"], start["session"], start["owner"])
        if spec.remote:
            prepare_store(spec.store)  # the folder of this node
        self.place = Workplace(spec, start["offsets"])
        self._others, self._all = self.place.others, OtherRuns(spec.store, "none", start["offsets"])
        self._all.bodies = self._others.bodies  # where the catalog finds them
        if spec.remote:
            self._others = self._all = NoRuns(spec.store, "none", {})
        self._checked: tuple[JobSpec | None, str] = (None, "")
        self._reported: JobSpec | None = None
        """spec of the last batch, once a result has carried its row to the driver"""
        if self.place.shared is not None:
            self.place.shared.remote.flush()  # what earlier batches on this node could not push

    def run(self, job: Job, suspects: Collection[str], channel: Channel) -> JobResult:
        """Execute a job, if the libraries and the kind of machine are those in its key.

        A suspect ran on a node that was lost, and so perhaps to its end: the outputs of this run are looked up for it, too.
        """
        if self._checked[0] is not job.spec:
            self._checked = job.spec, differing(job.spec)
        if self._checked[1]:
            return JobResult(job.key, "failed", message=self._checked[1])
        self.place.others = self._all if job.key in suspects else self._others
        result = execute(job, self.place, channel.progress)
        return result if self.place.shared is None or not result.rows else self._detached(job, result)

    def _detached(self, job: Job, result: JobResult) -> JobResult:
        """Result whose rows stand alone, since the driver does not see the segments of this node.

        The first ones of a batch begin with the row of its spec, since results of an earlier batch may not have arrived.
        """
        rows, spec = result.rows, encode(job.spec.row)
        if self._reported is not job.spec and not rows.startswith(spec):
            rows = spec + rows
        self._reported = job.spec
        return replace(result, rows=rows, segment="", start=0)


class NoRuns(OtherRuns):
    """Results of other runs on a node with a store of its own: none, since no scheduler reads that store.

    The claims in the remote say which tasks are done.
    """

    def output(self, key: str) -> str | None:
        """Find nothing."""
        return None


def differing(spec: JobSpec) -> str:
    """Name what this node has otherwise than the key says, a library or the kind of machine; '' when nothing differs."""
    for name, version in spec.libraries.items():
        found = installed_version(name)
        if found != version:
            return f"node {host()} has {name} {found or 'none'}, the driver {version}; install the driver's versions on every node"
    if spec.machine and spec.machine != machine_kind():
        return (f"the output of {spec.stage} depends on the kind of machine; node {host()} is of the kind {machine_kind()!r}, the "
                f"driver {spec.machine!r}: start the command on a machine of the nodes' kind")
    return ""
