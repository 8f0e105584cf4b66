"""Private Ray cluster of small nodes on 127.0.0.1, which a test adds and kills."""

from __future__ import annotations

import os
import shutil
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import pytest
from toy_project import wait_until

from runner.ray_engine import RayEngine, load_ray

STORE_BYTES = 80 << 20
"""Ray's object store of a node: the least that it accepts"""


@dataclass
class Nodes:
    """Cluster of small nodes on 127.0.0.1; the head runs no tasks."""

    cluster: Any
    folder: Path
    """temporary folder of the nodes"""
    log: Path
    """file in which the stages on the nodes note their executions"""

    def add(self, folder: Path | None = None, **resources: Any) -> Any:
        """Start a node; `folder` is its own folder of temporary files, in which it keeps code and stores."""
        os.environ["TOY_LOG"], os.environ["TMPDIR"] = str(self.log), str(folder or self.folder)
        node = self.cluster.add_node(object_store_memory=STORE_BYTES, include_dashboard=False, **resources)
        wait_until(lambda: node.unique_id is not None)
        os.environ["TMPDIR"] = str(self.folder)
        return node

    def kill(self, node: Any) -> None:
        """End a node with all its processes."""
        self.cluster.remove_node(node, allow_graceful=False)

    def engine(self, *arguments: Any) -> RayEngine:
        """Engine that runs on these nodes."""
        return RayEngine(*arguments, address=self.cluster.address)


@contextmanager
def ray_nodes(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Nodes]:
    """Start a cluster whose head runs no tasks."""
    monkeypatch.setenv("TOY_LOG", str(tmp_path / "log"))
    short = Path(tempfile.mkdtemp(prefix="ray", dir="/tmp"))  # the path of a socket has at most 107 bytes
    monkeypatch.setenv("TMPDIR", str(short))
    load_ray(None)
    from ray.cluster_utils import Cluster

    cluster = Cluster(initialize_head=True, head_node_args={
        "num_cpus": 0, "object_store_memory": STORE_BYTES, "include_dashboard": False})
    try:
        yield Nodes(cluster, short, tmp_path / "log")
    finally:
        cluster.shutdown()
        shutil.rmtree(short, ignore_errors=True)


def descendants(pid: int) -> set[int]:
    """Processes started by a process, directly or not."""
    parents: dict[int, int] = {}
    for entry in Path("/proc").iterdir():
        if entry.name.isdigit():
            try:
                parents[int(entry.name)] = int((entry / "stat").read_text().rpartition(")")[2].split()[1])
            except OSError:
                continue  # it has ended
    found: set[int] = set()
    while more := {child for child, parent in parents.items() if parent in found | {pid}} - found:
        found |= more
    return found
