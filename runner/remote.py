"""A store's blobs and traces behind a URL, shared by several hosts; the local store is the cache in front.

    blobs/ab/cdef...    same layout as in the local store; verified when sent and on arrival
    traces/NAME.log     rows of finished tasks, see `runner.segments`; an object is never changed
    hosts/ leases/      who is running, and who executes which task: `runner.claims`

Only these travel: no caches, compiled kernels, code, or paths. Write access to traces/ means trust, because a trace states what a
task has produced. While the endpoint cannot be reached, nothing is there to pull, and what a run would push is queued in the
folder unpushed/ of the local store; the next run that is online pushes it.
"""

from __future__ import annotations

import json
import os
import time
import uuid
import warnings
from collections.abc import Callable, Iterable, Iterator
from concurrent.futures import ThreadPoolExecutor
from itertools import count, islice
from pathlib import Path
from typing import TypeVar

from blake3 import blake3

from runner.files import DamagedError, host, seal, unique, unseal, write_atomic
from runner.objects import Objects, RemoteError, open_objects, temporary

RETRY_AFTER_S = 20.0
"""time without a request after one has failed"""
TOGETHER = 8
"""segments that are pulled at once"""
MERGE_ABOVE = 4
"""segments of one run are merged at its end when there are more"""
TRAVELLING = ("spec", "artifact", "trace")
"""kinds of rows that are shared; uses, drops and failures concern one store"""
HEAD_BYTES = 33
"""checksum of a row, and the space behind it"""
Result = TypeVar("Result")
Warn = Callable[[str], None]


class RemoteWarning(UserWarning):
    """The remote cannot be used for now; the run continues with the local store."""


class Remote:
    """Blobs and traces behind a URL, for one local store.

    Requests that fail after `connect` cause one call of `warn`. Then reads find nothing and pushes are queued; a request is tried
    again after RETRY_AFTER_S.
    """

    def __init__(self, objects: Objects, local: Path, warn: Warn | None = None, session: str = "") -> None:
        self.objects, self._local = objects, local
        self._warn: Warn = warn or (lambda text: warnings.warn(text, RemoteWarning, stacklevel=4))
        self._session = session or f"{host()}-{os.getpid()}-{uuid.uuid4().hex[:8]}"
        self._random, self._numbers = uuid.uuid4().hex[:8], count()
        self._warned, self._retry_at = False, 0.0
        self._seen = _Names(local / ".cache" / f"remote-{blake3(objects.url.encode()).hexdigest(8)}")

    @classmethod
    def open(cls, url: str, local: Path, warn: Warn | None = None, session: str = "") -> Remote:
        """Open the remote of the local store at `local`; no request is sent.

        `session` begins the names of all segments of one run. ValueError for a URL that cannot be used, see `runner.objects`.
        """
        return cls(open_objects(url), local, warn, session)

    def __repr__(self) -> str:
        return f"Remote({self.objects.url!r})"

    def __str__(self) -> str:
        return self.objects.url

    @property
    def online(self) -> bool:
        """False for some time after a request has failed."""
        return time.monotonic() >= self._retry_at

    def connect(self) -> bool:
        """Send a first request; False when the endpoint cannot be reached.

        RemoteError when it refuses: wrong credentials, or no such bucket.
        """
        try:
            self.objects.list("hosts")
        except RemoteError as error:
            if not error.offline:
                raise
            self._fail(error)
        return self.online

    def attempt(self, call: Callable[[], Result], otherwise: Result) -> Result:
        """Result of a call that sends requests; `otherwise` while the remote cannot be used."""
        if not self.online:
            return otherwise
        try:
            return call()
        except RemoteError as error:
            self._fail(error)
            return otherwise

    def _fail(self, error: RemoteError) -> None:
        self._retry_at = time.monotonic() + RETRY_AFTER_S
        if not self._warned:
            self._warned = True
            self._warn(f"the remote cannot be used, and the run continues with the local store alone: {error}")

    # -- blobs -----------------------------------------------------------------------------------------------------

    def has(self, blob: str) -> bool:
        """Return True when the remote has a blob."""
        return self.attempt(lambda: self.objects.has(blob_name(blob)), False)

    def pull(self, blob: str, place: Path) -> bool:
        """Write a blob to `place`, verified and read-only; False when the remote does not have it.

        DamagedError when its bytes do not match, twice in a row. The damaged object is then deleted, so that the next push
        replaces it.
        """
        return self.attempt(lambda: self._pull(blob, place), False)

    def _pull(self, blob: str, place: Path) -> bool:
        for _ in range(2):  # a second time: the bytes may have been damaged on the way
            arrived = temporary(place)
            found = self.objects.download(blob_name(blob), arrived)
            if found is None:
                return False
            if found == blob:
                arrived.chmod(0o444)
                os.replace(arrived, place)
                return True
            arrived.unlink()
        self.attempt(lambda: self.objects.delete([blob_name(blob)]), None)
        raise DamagedError(f"blob {blob[:12]} of {self} does not match its digest")

    def push(self, blob: str, path: Path, replace: bool = False) -> bool:
        """Send a blob; True when the remote has it afterwards, False when the remote cannot be used.

        An object that is there is left as it is, unless `replace` is set. DamagedError when the file does not match its name.
        """
        return self.attempt(lambda: self._push(blob, path, replace), False)

    def _push(self, blob: str, path: Path, replace: bool = False) -> bool:
        self.objects.upload(blob_name(blob), path, blob, replace)
        return True

    # -- traces ----------------------------------------------------------------------------------------------------

    def segments(self) -> list[str]:
        """Names of the segments of all hosts; none while the remote cannot be used."""
        return self.attempt(lambda: self.objects.list("traces"), [])

    def pull_segment(self, name: str) -> bytes:
        """Rows of a segment; b"" when it is gone, or while the remote cannot be used."""
        return self.attempt(lambda: self.objects.get(f"traces/{name}"), None) or b""

    def _push_rows(self, rows: bytes) -> bool:
        name = f"{self._session}-{os.getpid()}-{self._random}-{next(self._numbers):06d}.log"
        self.objects.create(f"traces/{name}", rows)  # the name is random: what is there is the same object, after a retry
        self._seen.add([name])
        return True

    def new_segments(self) -> Iterator[tuple[str, bytes]]:
        """Yield (name, travelling rows) of the segments that are new to the local store.

        The caller stores the rows and then calls `note`.
        """
        seen = self._seen.read()
        names = iter([name for name in self.segments() if name not in seen])
        with ThreadPoolExecutor(TOGETHER) as pool:
            while chunk := list(islice(names, 16 * TOGETHER)):
                for name, rows in zip(chunk, pool.map(self.pull_segment, chunk), strict=True):
                    if rows:
                        yield name, travelling(rows)

    def note(self, names: Iterable[str]) -> None:
        """Record that the local store has the rows of these segments."""
        self._seen.add(names)

    def merge(self) -> None:
        """Merge the segments of this run, at its end, into one, so that other hosts send fewer requests."""
        self.attempt(self._merge, None)

    def _merge(self) -> None:
        names = [name for name in self.objects.list("traces") if name.startswith(f"{self._session}-")]
        if len(names) <= MERGE_ABOVE:
            return
        parts = {name: self.objects.get(f"traces/{name}") for name in names}
        self._push_rows(b"".join(rows for rows in parts.values() if rows))
        self.objects.delete([f"traces/{name}" for name in names])

    # -- results of a task: blobs first, then rows -----------------------------------------------------------------

    def publish(self, blobs: Iterable[str], rows: bytes) -> bool:
        """Push the blobs of the local store that finished tasks have made, then their rows.

        False when the remote cannot be used; then they are queued.
        """
        wanted = sorted(set(blobs))
        if self.attempt(lambda: self._publish(wanted, rows), False):
            return True
        tree = {"remote": self.objects.url, "blobs": wanted, "rows": rows.decode()}
        write_atomic(self._local / "unpushed" / unique("rows")[1:], seal(tree, "unpushed"))
        return False

    def _publish(self, blobs: Iterable[str], rows: bytes) -> bool:
        for blob in blobs:
            path = self._local / blob_name(blob)
            if path.exists():  # one that was dropped in the meantime is made again when it is needed
                self._push(blob, path)
        chosen = travelling(rows)
        return not chosen or self._push_rows(chosen)

    def flush(self) -> int:
        """Push what earlier runs have queued for this URL; return the number of entries that remain."""
        remaining = 0
        for path in queued(self._local):
            try:
                tree = unseal(path.read_bytes(), "unpushed")
            except FileNotFoundError:  # another run has pushed it
                continue
            except DamagedError:
                self._warn(f"{path.name} in the folder unpushed is damaged; its results stay in the local store alone")
                path.unlink(missing_ok=True)
                continue
            if tree["remote"] != self.objects.url:
                continue
            if self.attempt(lambda tree=tree: self._publish(tree["blobs"], tree["rows"].encode()), False):  # type: ignore[misc]
                path.unlink(missing_ok=True)
            else:
                remaining += 1
        return remaining


class _Names:
    """Names of segments whose rows the local store has: a file to which all processes append lines."""

    def __init__(self, path: Path) -> None:
        self._path = path

    def read(self) -> set[str]:
        """Names; a file that is gone counts as empty, and all segments are pulled again."""
        try:
            return set(self._path.read_text(encoding="utf-8", errors="replace").split("\n"))
        except FileNotFoundError:
            return set()

    def add(self, names: Iterable[str]) -> None:
        """Append names."""
        self._path.parent.mkdir(parents=True, exist_ok=True)
        with open(self._path, "ab", buffering=0) as file:
            file.write("".join(f"{name}\n" for name in names).encode())


def blob_name(blob: str) -> str:
    """Name of the object of a blob, and its path in a store."""
    return f"blobs/{blob[:2]}/{blob[2:]}"


def queued(local: Path) -> list[Path]:
    """Entries of the queue of a store, oldest name first."""
    folder = local / "unpushed"
    return sorted(path for path in folder.iterdir() if path.name[0] != ".") if folder.is_dir() else []


def travelling(rows: bytes) -> bytes:
    """Complete lines of the kinds that are shared, without artifacts that have files outside the store."""
    return b"".join(line + b"\n" for line in rows.split(b"\n")[:-1] if _travels(line))


def _travels(line: bytes) -> bool:
    try:
        row = json.loads(line[HEAD_BYTES:])
    except ValueError:  # damaged: the reader of the segment counts it
        return False
    if not isinstance(row, list) or not row or row[0] not in TRAVELLING:
        return False
    return row[0] != "artifact" or all(len(file) <= 4 for file in row[3])


