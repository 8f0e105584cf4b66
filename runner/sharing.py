"""Results and claims that a run shares with other hosts through a remote: in its scheduler, and in its workers."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

from runner.claims import Claims, State
from runner.index import Index
from runner.remote import HEAD_BYTES, Remote
from runner.segments import decode, lines


class SharedRun:
    """Scheduler's side: registers the run, and adds the rows of other hosts to the index."""

    def __init__(self, remote: Remote, index: Index) -> None:
        self._remote, self._index, self._claims = remote, index, Claims(remote)

    @property
    def owner(self) -> str:
        """Name under which all workers of the run claim keys."""
        return self._claims.owner

    def begin(self) -> None:
        """Register the run, and push what earlier ones have queued; rows that are pulled after that miss no finished task.

        RemoteError when the endpoint refuses requests.
        """
        if self._remote.connect():
            self._claims.register()
            self._remote.flush()

    def refresh(self) -> None:
        """Add the rows of other hosts. What is known here stays: a task may give other bytes on another kind of machine."""
        for name, data in self._remote.new_segments():
            rows = [row for _, line in lines(data) if (row := decode(line)) is not None]
            fresh = [row for row in rows if not self._knows(row)]
            if fresh:
                self._index.append(*fresh)
            self._remote.note([name])

    def take(self, rows: bytes) -> None:
        """Add the rows of a task that this run has executed on another host, in a store of its own."""
        found = [row for _, line in lines(rows) if (row := decode(line)) is not None]
        self._index.append(*[row for row in found if row[0] not in ("spec", "artifact") or not self._knows(row)])

    def _knows(self, row: list[Any]) -> bool:
        """Return True when the index has the subject of a row."""
        known = {"spec": self._index.has_spec, "artifact": self._index.has_artifact, "trace": self._index.__contains__}
        return known[row[0]](row[1])

    def end(self) -> None:
        """Push what is still queued, merge the segments of the run, and end its heartbeats."""
        self._remote.flush()
        self._remote.merge()
        self._claims.close()


class SharedTasks:
    """Worker's side: claims keys for its run, and pushes results."""

    def __init__(self, url: str, store: Path, session: str, owner: str) -> None:
        self.remote = Remote.open(url, store, _silent, session)
        self._claims = Claims(self.remote, owner)

    def acquire(self, key: str, again: bool) -> State:
        """Claim a key; `again` also when a run has finished the task, since its bytes are gone."""
        return self._claims.acquire(key, again)

    def release(self, key: str, rows: bytes) -> None:
        """Push the blobs and rows of a finished task, and give its key back; no rows stand for a task that has failed."""
        try:
            pushed = bool(rows) and self.remote.publish(_blobs(rows), rows)
        except BaseException:
            self._claims.release(key)
            raise
        self._claims.release(key, done=pushed)


def _blobs(rows: bytes) -> list[str]:
    """Digests of the blobs of all artifacts in encoded rows."""
    found: list[Any] = [json.loads(line[HEAD_BYTES:]) for _, line in lines(rows)]
    return [file[1] for row in found if row[0] == "artifact" for file in row[3] if len(file) <= 4]


def _silent(_: str) -> None:
    """Leave the warning to the scheduler, which uses the same remote."""
