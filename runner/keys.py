"""Keys: the digest of everything that an output depends on, and of nothing else."""

from __future__ import annotations

import dataclasses
import platform
import sys
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from runner.canonical import canonical, digest
from runner.files import Stamp, stamp
from runner.fingerprint import Fingerprint, declarations, fingerprint
from runner.graph import Node
from runner.modules import Modules


@dataclass(frozen=True)
class StageSpec:
    """What is the same for every shard of a stage."""

    name: str
    function: str
    """'module:function', the identity of the stage: two names for one function share what they made"""
    params: Any
    """canonical JSON tree"""
    code: Fingerprint
    libraries: dict[str, str]
    threads: int
    memory_gib: float
    sources: tuple[tuple[str, Stamp], ...]
    """files behind the fingerprint, with their stamps when it was taken"""


def stage_spec(node: Node, modules: Modules) -> StageSpec:
    """Read a stage's code and declarations; ValueError when it cannot be followed or a library is not installed."""
    function = f"{node.value.__module__}:{node.value.__qualname__}"
    select = {} if node.params is None else {f.name: getattr(node.params, f.name) for f in dataclasses.fields(node.params)}
    declared = declarations(modules, node.value.__module__)
    code = fingerprint(modules, function, select)
    return StageSpec(
        name=node.name, function=function, params=_params(node), code=code,
        libraries={name: _version(node.name, name) for name in sorted(declared["LIBRARIES"])},
        threads=declared["THREADS"], memory_gib=declared["MEMORY_GIB"],
        sources=tuple((path, stamp(path)) for path in sorted(code.files) if path.endswith(".py")))  # type: ignore[arg-type]


def task_key(spec: StageSpec, inputs: Mapping[str, str], schemas: Mapping[str, str]) -> str:
    """The key of one shard: `inputs` argument -> artifact digest, `schemas` kind -> version of the kinds in them."""
    return digest("afford-task", {
        "stage": spec.function, "code": spec.code.digest, "params": spec.params, "inputs": dict(inputs),
        "schemas": dict(schemas), "libraries": spec.libraries, "threads": spec.threads})


def seed_of(key: str) -> int:
    """The seed of a task's global random states: 63 bits of its key."""
    return int(key[:16], 16) >> 1


def machine_kind() -> str:
    """What byte equality is promised for: the architecture and the version of Python; recorded, never part of a key."""
    return f"{platform.machine()} {sys.platform} python{sys.version_info[0]}.{sys.version_info[1]}"


def _params(node: Node) -> Any:
    try:
        return canonical(node.params)
    except TypeError as error:
        raise ValueError(f"{node.name}: parameters: {error}") from error


_versions: dict[str, str] = {}


def _version(stage: str, library: str) -> str:
    from importlib import metadata  # 15 ms, and only needed when a stage declares libraries

    if library not in _versions:
        try:
            _versions[library] = metadata.version(library)
        except metadata.PackageNotFoundError:
            raise ValueError(f"{stage}: LIBRARIES names {library!r}, which is not installed; install it, or correct the name "
                             "(it is the name of the distribution, e.g. opencv-python-headless)") from None
    return _versions[library]
