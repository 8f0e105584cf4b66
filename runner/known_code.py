"""Fingerprints of stages that earlier processes computed, valid while no source file has changed.

    .cache/specs.json       digest of (function, parameters, codec, worker hook) -> fingerprint and declarations of the stage

The cache holds the stamp and content of every source file that was read for any of the fingerprints, and the module names that were
looked up without success. One changed file, or one module that exists by now, makes all of it invalid.
"""

from __future__ import annotations

import time
from pathlib import Path
from typing import Any, NamedTuple

from runner.canonical import digest
from runner.files import RACY_NS, read_cache, stamp, write_cache
from runner.fingerprint import Fingerprint
from runner.modules import Modules


class KnownStage(NamedTuple):
    """Code and declarations of a stage under some parameters."""

    code: Fingerprint
    declared: dict[str, Any]
    blocks: frozenset[str]


class KnownCode:
    """Cache of the stages of a project; without a path it is empty and stays so."""

    def __init__(self, path: Path | None, modules: Modules) -> None:
        self._path, self._modules = path, modules
        self._known: dict[str, Any] = {}
        self._fresh = False
        self._version = _version(modules)
        saved = read_cache(path) if path is not None else {}
        if saved.get("version") == self._version and modules.assume(saved["files"], saved["missing"]):
            self._known = saved["known"]

    def get(self, key: str) -> KnownStage | None:
        """Code and declarations of a stage; its definitions are not kept here."""
        found = self._known.get(key)
        if found is None:
            return None
        files = {str(self._modules.root / path) for path in found["files"]}
        return KnownStage(Fingerprint(found["digest"], {}, set(found["third_party"]), files), found["declared"],
                          frozenset(found["blocks"]))

    def put(self, key: str, stage: KnownStage) -> None:
        """Add a stage."""
        files = sorted(str(Path(path).relative_to(self._modules.root)) for path in stage.code.files)
        self._known[key] = {"digest": stage.code.digest, "third_party": sorted(stage.code.third_party), "files": files,
                            "declared": stage.declared, "blocks": sorted(stage.blocks)}
        self._fresh = True

    def save(self) -> None:
        """Write the cache, unless a source file is so young that it may change again within its time stamp."""
        if self._path is None or not self._fresh:
            return
        files, missing = self._modules.seen()
        if all(time.time_ns() - stamp[3] > RACY_NS for stamp, _ in files.values()):
            write_cache(self._path, {"version": self._version, "files": files, "missing": missing, "known": self._known})
            self._fresh = False


def _version(modules: Modules) -> str:
    """Version of the analysis: the parser's, and the source files that follow references and read declarations."""
    own = [stamp(Path(__file__).with_name(f"{name}.py")) for name in (
        "fingerprint", "links", "effects", "references", "selection", "keys", "known_code")]
    return digest("afford-analysis", [modules.version, own])
