"""A content-hashed DAG engine: results are cached under the digest of their code, parameters and inputs.

    graph = Graph()                                         runner/graph.py: leaf, add, each, collect, pick, first, target, publish
    runner = Runner(store, root, codec="afford.codecs:CODEC", worker="afford.common.worker:prepare", jobs=2, memory_gib=6.0)
    report = runner.run(graph, "dataset", shards=None, only=None, force=(), observer=None, limit_s=None)  -> RunReport
    runner.plan(graph, "dataset")                           -> list[TaskPlan], without executing anything
    runner.explain(graph, "dataset", stage=None, shard=None)-> list[TaskPlan], with the reason of every task
    runner.load(digest) / runner.files(digest)              -> value / {name: verified path}
    runner.lineage(digest or path) / runner.verify() / runner.gc() / runner.disk_usage() / with runner.reading(): ...
    with RunLog(store, "dataset", observer=...) as log: ...     runner/history.py: the record of a run; past_runs reads it
    runner.hash_file(path)                                  -> (digest, size), remembered by size, mtime and inode

Modules in reading order: graph (the DAG), source, names, scopes, references, effects, links and fingerprint (code as content), keys
and task_planner (keys and reasons), segments and index (key -> output), store (blobs), lease (one run per key), execute (one task),
engines (where tasks run), walk (propagation of outcomes), schedule (order and budget), runner (the verbs), upkeep (verify,
lineage), garbage (gc), history, past_runs and run_diff (records of runs).
"""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from runner.codec import Codec
    from runner.graph import Graph, GraphError, Handle
    from runner.report import Failure, Observer, Reason, RunReport, TaskPlan
    from runner.runner import NothingOptionalError, Runner, UnknownNameError
    from runner.source import SourceError
    from runner.store import LostError, StoreError, is_store
    from runner.walk import UnknownShardError

__all__ = ["Codec", "Failure", "Graph", "GraphError", "Handle", "LostError", "NothingOptionalError", "Observer", "Reason",
           "RunReport", "Runner", "SourceError", "StoreError", "TaskPlan", "UnknownNameError", "UnknownShardError", "is_store"]
HOMES = {"codec": ("Codec",), "graph": ("Graph", "GraphError", "Handle"), "source": ("SourceError",),
         "report": ("Failure", "Observer", "Reason", "RunReport", "TaskPlan"),
         "runner": ("NothingOptionalError", "Runner", "UnknownNameError"),
         "store": ("LostError", "StoreError", "is_store"), "walk": ("UnknownShardError",)}  # fmt: skip
"""module -> its public names; each is imported on first use, so that reading a map does not load the engine"""


def __getattr__(name: str) -> Any:
    home = next((module for module, names in HOMES.items() if name in names), None)
    if home is None:
        raise AttributeError(f"module 'runner' has no attribute {name!r}")
    return getattr(import_module(f"runner.{home}"), name)
