"""Inputs that only the driver's store has, for nodes with stores of their own: leafs, and outputs of runs without the remote."""

from __future__ import annotations

import os
from collections.abc import Iterable
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

from runner.execute import Job
from runner.files import DamagedError
from runner.index import manifest_of
from runner.remote import TOGETHER, Remote, blob_name


class Inputs:
    """Pushes the inputs of jobs to the remote, each one once, before the jobs travel.

    What neither store has is left to the node, which reports it as lost.
    """

    def __init__(self, url: str, store: Path, session: str) -> None:
        self._remote, self._store = Remote.open(url, store, _silent, session), store
        self._shared: set[str] = set()
        """artifacts that the nodes can pull, or that this store does not have"""

    def push(self, jobs: Iterable[Job]) -> None:
        """Push the blobs of inputs that the remote lacks; one that could not be pushed is tried again for the next job."""
        bodies = {digest: body for job in jobs for digest, body in job.manifests.items() if digest not in self._shared}
        blobs = {digest: {entry.blob for entry in manifest_of(body).files if not entry.path} for digest, body in bodies.items()}
        here = [blob for blob in set().union(*blobs.values()) if (self._store / blob_name(blob)).exists()]
        unsent: set[str] = set()
        if here:
            with ThreadPoolExecutor(TOGETHER) as pool:
                unsent = {blob for blob, sent in zip(here, pool.map(self._push, here), strict=True) if not sent}
        self._shared |= {digest for digest, needed in blobs.items() if not needed & unsent}

    def forget(self, job: Job) -> None:
        """Push the inputs of a job again next time: a node could not read one."""
        self._shared -= job.manifests.keys()

    def _push(self, blob: str) -> bool:
        """Push a blob; a damaged one is moved aside, so that the scheduler has it computed again."""
        path = self._store / blob_name(blob)
        try:
            return self._remote.has(blob) or self._remote.push(blob, path)
        except FileNotFoundError:  # moved aside meanwhile
            return False
        except DamagedError:
            (self._store / "damaged").mkdir(exist_ok=True)
            os.replace(path, self._store / "damaged" / blob)
            return False


def _silent(_: str) -> None:
    """Leave the warning to the scheduler, which uses the same remote."""
