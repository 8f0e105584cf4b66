"""Disk usage of a store by stage."""

from __future__ import annotations

import os
from dataclasses import dataclass, field
from pathlib import Path

from runner.garbage import ELSEWHERE, stored
from runner.index import Index
from runner.store import Store

ROOMS = ("traces", "code", "runs", "scratch", "damaged", ".cache")


@dataclass
class StageUse:
    """Artifacts of one stage in the store."""

    results: int = 0
    """stored results, one for each key"""
    artifacts: int = 0
    """different plain artifacts"""
    files: int = 0
    """blobs, each counted for the stage that made it first"""
    bytes: int = 0
    shared_bytes: int = 0
    """bytes of its artifacts that are counted for another stage"""
    dropped: int = 0
    """artifacts without bytes"""


@dataclass
class DiskUse:
    """Disk usage of a store. Every blob is counted once; files outside the store are not counted."""

    stages: dict[str, StageUse] = field(default_factory=dict)
    """the largest first; `(no stage)` for blobs that belong to no result"""
    rooms: dict[str, int] = field(default_factory=dict)
    """folder -> bytes, without blobs"""

    @property
    def bytes(self) -> int:
        """Bytes of the whole store."""
        return sum(use.bytes for use in self.stages.values()) + sum(self.rooms.values())


def disk_usage(store: Store, index: Index) -> DiskUse:
    """Count blobs by the stage that made them first."""
    sizes = {path.parent.name + path.name: path.stat().st_size for path in stored(store.root / "blobs")}
    stages: dict[str, StageUse] = {}
    owners: dict[str, str] = {}
    seen: set[tuple[str, str]] = set()
    """(stage, artifact or blob) that are counted"""
    for stage, output in index.results():
        use = stages.setdefault(stage, StageUse())
        use.results += 1
        for digest, found in store.closure(output):
            if found is not None and found.children is None and (stage, digest) not in seen:
                seen.add((stage, digest))
                _count(use, stage, {entry.blob for entry in found.files if not entry.path}, owners, sizes, seen)
    rest = sizes.keys() - owners.keys()
    if rest:
        stages[ELSEWHERE] = StageUse(files=len(rest), bytes=sum(sizes[blob] for blob in rest))
    ordered = dict(sorted(stages.items(), key=lambda item: (-item[1].bytes, item[0])))
    return DiskUse(ordered, {room: _folder_bytes(store.root / room) for room in ROOMS})


def _count(use: StageUse, stage: str, blobs: set[str], owners: dict[str, str], sizes: dict[str, int],
           seen: set[tuple[str, str]]) -> None:  # fmt: skip
    """Count one artifact of a stage."""
    use.artifacts += 1
    use.dropped += bool(blobs - sizes.keys())
    for blob in blobs & sizes.keys():
        if (stage, blob) in seen:
            continue
        seen.add((stage, blob))
        if owners.setdefault(blob, stage) == stage:
            use.files, use.bytes = use.files + 1, use.bytes + sizes[blob]
        else:
            use.shared_bytes += sizes[blob]


def _folder_bytes(folder: Path) -> int:
    files = (path for path in folder.rglob("*") if path.is_file() and not path.is_symlink())
    return sum(os.stat(path).st_size for path in files)
