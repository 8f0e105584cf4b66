"""Part of the engine inside a worker of Ray: unpack code, keep one stage process, send it batches, report its results.

Stages run in a process of their own, as under the pool, because a Ray worker has imported Ray's own libraries, and because a stage
that crashes then ends neither the Ray worker nor the report of its neighbours. This module travels by value, so it may import
nothing but the standard library, Ray and blake3.
"""

from __future__ import annotations

import json
import os
import platform
import select
import shutil
import signal
import socket
import struct
import subprocess
import sys
import tempfile
import time
import uuid
import zlib
from collections.abc import Iterator
from contextlib import suppress
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

HEAD, HEAD_BYTES = "<IB", 5
"""head of a frame between the two processes: size of the payload, kind"""
DONE, PROGRESS, REFUSED, MEMORY = 1, 2, 3, 4
STEPS, SIZE = "<QQ", "<d"
"""payloads of PROGRESS, and of MEMORY: size of the stage process, MiB, before the last result of a batch"""
REPORT_S = 0.5
"""interval of reports while a batch runs"""
GATHER_S, GATHER_SHARE = (0.002, 0.1), 0.3
"""limits of the pause between two reads, and its share of the time that the rest of the batch will take, so that many short jobs
cost few reads and the last one is not reported late"""
INLINE_BYTES = 60_000
"""a report below this size travels inside Ray's reply, and so is not lost with the node's object store"""
MAX_CODE_AGE_S = 14 * 86_400
HIDDEN = "RAY_"
"""prefix of the variables of Ray's own worker (its token among them), which a stage does not see"""


class NodeError(ValueError):
    """This node cannot run the batch; the message says what to do."""


@dataclass
class Report:
    """News of a batch: results in order, progress, and the job that runs now (-1: none to report)."""

    running: int = -1
    done: list[bytes] = field(default_factory=list)
    progress: tuple[Any, ...] = ()
    """(done, total) of the job that runs"""
    died: str = ""
    refused: str = ""
    size: int = 0

    def plain(self) -> tuple[Any, ...]:
        """The report as a plain tuple, which Ray encodes fastest."""
        return self.running, self.done, self.progress, self.died, self.refused


_SLOTS: list[Slot] = []
"""the stage process of this Ray worker, if one is alive"""
_READY: dict[str, Any] = {}
"""digests of parcels that this node has -> what a stage process needs to start"""


def run_batch(digest: str, parcel: list[Any], batch: bytes, count: int) -> Iterator[tuple[Any, ...]]:
    """Run one batch of `count` jobs, in order; yield reports (`Report.plain`).

    `parcel` holds a reference to (setting, files, compressed code), fetched once by a Ray worker.
    """
    slot = None
    try:
        slot = _slot(digest, parcel)
        yield from (report.plain() for report in slot.run(batch, count))
    except (NodeError, OSError) as error:
        yield Report(refused=f"node {socket.gethostname()}: {error}").plain()
    except BaseException:  # the driver ends the batch: KeyboardInterrupt, GeneratorExit
        if slot is not None:
            slot.kill()
        raise


def _slot(digest: str, parcel: list[Any]) -> Slot:
    """Stage process for this code and these GPUs; the one of the last batch if it fits."""
    start = {**_ready(digest, parcel), "gpus": os.environ.get("CUDA_VISIBLE_DEVICES")}
    if _SLOTS and (_SLOTS[0].start != start or not _SLOTS[0].alive() or _SLOTS[0].is_due()):
        _SLOTS.pop().retire()
    if not _SLOTS:
        _SLOTS.append(Slot(start))
    return _SLOTS[0]


def _ready(digest: str, parcel: list[Any]) -> dict[str, Any]:
    """Settings of the stage process, once the code and the store are there; NodeError when they cannot be."""
    if digest not in _READY:
        import ray

        setting, files, data = ray.get(parcel[0])
        if setting["python"] != platform.python_version():
            raise NodeError(f"runs Python {platform.python_version()}, the driver {setting['python']}; install the same")
        root, engine = code_folders(digest, setting, files, data)
        store = store_folder(setting)
        environment = {name: value.replace(setting["store"], store, 1) for name, value in setting["environment"].items()}
        _READY[digest] = {**setting, "root": root, "engine": engine, "store": store, "environment": environment,
                          "former": setting["root"]}
    return dict(_READY[digest])


def base_folder() -> Path:
    """Folder of this user on this node, private; NodeError when it has another owner."""
    base = Path(tempfile.gettempdir()) / f"afford-ray-{os.getuid()}"
    base.mkdir(mode=0o700, exist_ok=True)
    if base.lstat().st_uid != os.getuid() or base.is_symlink():
        raise NodeError(f"{base} belongs to another user; remove it, or set TMPDIR for Ray's workers")
    return base


def store_folder(setting: dict[str, Any]) -> str:
    """Folder of the store on this node: the shared one, or with a remote a local cache of its own."""
    from blake3 import blake3

    if not setting["remote"]:
        if not os.path.exists(os.path.join(setting["store"], setting["token"])):
            raise NodeError(f"does not see the store {setting['store']} of the driver; mount that folder at the same path on every "
                            "node, or use a remote store (--remote URL)")
        return str(setting["store"])
    name = blake3(f"{setting['store']}\0{setting['remote']}".encode()).hexdigest()[:16]
    store = base_folder() / "stores" / name
    store.mkdir(parents=True, exist_ok=True)
    return str(store)


# -- code ----------------------------------------------------------------------------------------------------------------


def code_folders(digest: str, setting: dict[str, Any], files: list[Any], data: bytes) -> tuple[str, str]:
    """(root, folder of the runner) with exactly these files: the driver's own where this node sees them, else unpacked ones."""
    here = {"root": setting["root"], "engine": setting["engine"]}
    if holds(here, files):
        return here["root"], here["engine"]
    folder = base_folder() / "code" / digest
    there = {"root": str(folder / "root"), "engine": str(folder / "engine")}
    if not holds(there, files):
        _unpack(folder, files, data)
    os.utime(folder)  # young: in use
    return there["root"], there["engine"]


def holds(places: dict[str, str], files: list[Any]) -> bool:
    """Return True when every file is there with these bytes."""
    from blake3 import blake3

    try:
        return all(blake3(Path(places[place], inside).read_bytes()).hexdigest() == found for place, inside, found, _ in files)
    except OSError:
        return False


def _unpack(folder: Path, files: list[Any], data: bytes) -> None:
    """Write the files into a new folder, verify them, and give it its name; remove code that was not used for long."""
    folder.parent.mkdir(parents=True, exist_ok=True)
    fresh = folder.with_name(f".{folder.name[:16]}.{os.getpid()}-{uuid.uuid4().hex[:8]}")
    content, at = zlib.decompress(data), 0
    for place, inside, _, size in files:
        path = fresh / place / inside
        if fresh not in Path(os.path.normpath(path)).parents:
            raise NodeError(f"the code names a file outside its folder: {inside}")
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_bytes(content[at : at + size])
        at += size
    (fresh / "root").mkdir(exist_ok=True)
    if not holds({"root": str(fresh / "root"), "engine": str(fresh / "engine")}, files):
        raise NodeError(f"the code in {fresh} differs from what the driver sent; run again")
    if folder.exists():  # damaged: `holds` was false
        os.rename(folder, folder.with_name(f".damaged-{uuid.uuid4().hex[:8]}"))
    with suppress(FileExistsError, OSError):  # another worker of this node was faster, with the same files
        os.rename(fresh, folder)
    for old in folder.parent.iterdir():
        if old == fresh or old.name.startswith(".damaged-") or old.lstat().st_mtime < time.time() - MAX_CODE_AGE_S:
            shutil.rmtree(old, ignore_errors=True)


# -- the stage process -----------------------------------------------------------------------------------------------------


class Slot:
    """Stage process of one Ray worker; it ends with it, and with the batch that the driver ends."""

    def __init__(self, start: dict[str, Any]) -> None:
        self.start = start
        ours, theirs = socket.socketpair()
        read, self._lifeline = os.pipe()
        paths = [start["root"], start["engine"]]
        code = f"import sys; sys.path[:0] = {paths!r}; from runner.ray_child import main; main(*sys.argv[1:])"
        variables = {name: value for name, value in os.environ.items() if not name.startswith(HIDDEN)}
        self._process = subprocess.Popen(
            [sys.executable, "-c", code, str(theirs.fileno()), str(read)], pass_fds=(theirs.fileno(), read),
            stdin=subprocess.DEVNULL, start_new_session=True, env=variables | start["environment"])
        theirs.close()
        os.close(read)
        self._socket, self._buffer, self._closed = ours, bytearray(), False
        self._finished, self._resident_mib, self._first_mib = 0, 0.0, 0.0
        self._send(json.dumps(start).encode())

    def alive(self) -> bool:
        """Return True while the process runs."""
        return self._process.poll() is None

    def is_due(self) -> bool:
        """Return True when the process has run many jobs, or has grown since its first batch, and is to be replaced."""
        grown_mib = self._resident_mib - self._first_mib
        return self._finished >= self.start["max_jobs"] or grown_mib > self.start["max_growth_mib"]

    def run(self, batch: bytes, count: int) -> Iterator[Report]:
        """Run a batch; yield a report every half second while there is news, and at the end."""
        self._send(batch)
        report, done, told = Report(), 0, -1
        began = reported = time.monotonic()
        while done < count and not (report.died or report.refused):
            if self._read(REPORT_S):
                done += self._frames(report)
            now = time.monotonic()
            if done < count and (now - reported > REPORT_S or report.size > INLINE_BYTES):
                report.running = -1 if done == told else done
                if report.done or report.progress or report.running >= 0:
                    yield report
                told, reported, report = done, now, Report()
            elif done < count and report.done:
                rest_s = (now - began) / done * (count - done)
                time.sleep(min(max(GATHER_SHARE * rest_s, GATHER_S[0]), GATHER_S[1]))
        if report.died or report.refused:
            self.kill()
        yield report

    def kill(self) -> None:
        """End the process and every process that its stage has started; they share a process group."""
        with suppress(ProcessLookupError):
            os.killpg(self._process.pid, signal.SIGKILL)
        self._close()

    def retire(self) -> None:
        """End an idle process."""
        self._socket.shutdown(socket.SHUT_WR)
        with suppress(subprocess.TimeoutExpired):
            self._process.wait(5)
        self.kill()

    def _close(self) -> None:
        self._process.wait()
        self._socket.close()
        if self._lifeline >= 0:
            os.close(self._lifeline)
        self._lifeline = -1
        if self in _SLOTS:
            _SLOTS.remove(self)

    def _send(self, data: bytes) -> None:
        with suppress(BrokenPipeError, ConnectionResetError):  # a dead process is reported when its answer is read
            self._socket.sendall(struct.pack(HEAD, len(data), 0) + data)

    def _read(self, patience_s: float) -> bool:
        if not select.select([self._socket], [], [], patience_s)[0]:
            return False
        try:
            data = self._socket.recv(1 << 18)
        except ConnectionResetError:
            data = b""
        self._buffer += data
        self._closed = not data
        return True

    def _frames(self, report: Report) -> int:
        """Move complete frames into the report; return the number of results."""
        before, at, buffer = len(report.done), 0, self._buffer
        while len(buffer) - at >= HEAD_BYTES:
            size, kind = struct.unpack_from(HEAD, buffer, at)
            if len(buffer) - at < HEAD_BYTES + size:
                break
            payload = bytes(buffer[at + HEAD_BYTES : at + HEAD_BYTES + size])
            at += HEAD_BYTES + size
            if kind == DONE:
                report.done.append(payload)
                report.size += size
                report.progress = ()
            elif kind == PROGRESS:
                report.progress = struct.unpack(STEPS, payload)
            elif kind == MEMORY:
                self._resident_mib = struct.unpack(SIZE, payload)[0]
                self._first_mib = self._first_mib or self._resident_mib
            else:
                report.refused = f"node {socket.gethostname()}: {payload.decode()}"
        del buffer[:at]
        if self._closed and not report.refused:
            report.died = self._death()
        self._finished += len(report.done) - before
        return len(report.done) - before

    def _death(self) -> str:
        """Cause of the end of the process, in words."""
        with suppress(subprocess.TimeoutExpired):
            self._process.wait(5)
        status = self._process.poll()
        if status is None:
            return "the worker process closed its connection before the task was done"
        how = f"signal {signal.Signals(-status).name}" if status < 0 else f"exit status {status}"
        hint = "; the usual cause is lack of memory: raise MEMORY_GIB of the stage" if status == -signal.SIGKILL else ""
        return f"the worker process ended with {how} on node {socket.gethostname()} before the task was done{hint}"
