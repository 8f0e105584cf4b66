"""Keys: the digest of everything that an output depends on, and of nothing else."""

from __future__ import annotations

import os
import platform
import sys
from collections.abc import Mapping
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Any

from runner.canonical import canonical, digest
from runner.codec import resolve
from runner.files import Stamp
from runner.fingerprint import Fingerprint, fingerprint, merged
from runner.graph import Node
from runner.modules import Modules
from runner.selection import declarations, select_of, unselected, without

VECTORS = ("avx2", "fma", "avx512f", "avx512_bf16", "amx_bf16", "asimd", "sve", "bf16")
"""flags of a CPU that decide which kernels numeric libraries choose, and so last bits"""
CPUINFO, NVIDIA = Path("/proc/cpuinfo"), Path("/proc/driver/nvidia")


@dataclass(frozen=True)
class StageSpec:
    """What is the same for every shard of a stage."""

    name: str
    function: str
    """'module:function', where a worker finds it; in no key"""
    params: Any
    """canonical JSON tree"""
    code: Fingerprint
    """of the stage, of the codec for the schemas that occur in it, and of the worker's preparation"""
    libraries: dict[str, str]
    threads: int
    memory_gib: float
    sources: tuple[tuple[str, Stamp], ...]
    """files behind the fingerprint, with their stamps when they were read for it"""
    machine: str = ""
    """the kind of machine, of stages that declare MACHINE; '' of all others"""
    blocks: frozenset[str] = frozenset()
    """fields of Params with the parameters of backends that are not selected; in no key"""


class Codes:
    """Fingerprints of the code that decides the bytes of a task: its stage, the codec, the preparation of its worker.

    codec, worker: "module:attribute"; code of these that is not under the root of `modules` does not count. Definitions in schema
    packages count where a stage uses them, and through the schemas of its inputs (`task_key`).
    """

    def __init__(self, modules: Modules, codec: str, worker: str | None) -> None:
        self.modules = modules
        self._codec, self._worker = codec, worker
        self._memo: dict[Any, Fingerprint] = {}

    def of(self, function: str, params: Any) -> Fingerprint:
        """Of 'module:function' under these Params; SourceError when some code cannot be followed."""
        stage = fingerprint(self.modules, function, select_of(params))
        return merged([stage, *self._codec_of(stage), *self._worker_of()])

    def _codec_of(self, stage: Fingerprint) -> list[Fingerprint]:
        """What the codec selects in its registries (`Codec.selects`) follows from the schemas that occur in the stage."""
        if not self._ours(self._codec):
            return []
        selects = getattr(resolve(self._codec), "selects", None)
        select = selects(frozenset(name.partition(":")[2] for name in stage.definitions)) if selects else {}
        memo = tuple(sorted(select.items()))
        if memo not in self._memo:
            self._memo[memo] = fingerprint(self.modules, self._codec, select, apart=self.modules.schemas)
        return [self._memo[memo]]

    def _worker_of(self) -> list[Fingerprint]:
        if self._worker is None or not self._ours(self._worker):
            return []
        if "worker" not in self._memo:
            self._memo["worker"] = fingerprint(self.modules, self._worker, {})
        return [self._memo["worker"]]

    def _ours(self, reference: str) -> bool:
        return self.modules.get(reference.partition(":")[0]) is not None


def stage_spec(node: Node, codes: Codes) -> StageSpec:
    """Read a stage's code and declarations; ValueError when it cannot be followed or a library is not installed."""
    function = f"{node.value.__module__}:{node.value.__qualname__}"
    module, select = node.value.__module__, select_of(node.params)
    declared, blocks = declarations(codes.modules, module, select), unselected(codes.modules, module, select)
    code = codes.of(function, node.params)
    return StageSpec(
        name=node.name, function=function, params=without(_params(node), node.params, blocks), code=code,
        libraries={name: _version(node.name, name) for name in sorted(declared["LIBRARIES"])},
        threads=declared["THREADS"], memory_gib=declared["MEMORY_GIB"],
        sources=tuple((path, codes.modules.stamp(path)) for path in sorted(code.files) if not os.path.isdir(path)),
        machine=_machine(declared["MACHINE"], node, blocks), blocks=blocks)


def _machine(declared: bool | list[str], node: Node, blocks: frozenset[str]) -> str:
    """MACHINE of a stage is True, or names fields of its Params that make its bytes depend on the kind of machine."""
    named = [] if isinstance(declared, bool) else [name for name in declared if name.partition(".")[0] not in blocks]
    return machine_kind() if declared is True or any(_field(node, name) for name in named) else ""


def _field(node: Node, name: str) -> Any:
    """A parameter by its name, or by 'block.name'."""
    value = node.params
    for part in name.split("."):
        if not hasattr(value, part):
            raise ValueError(f"{node.name}: MACHINE names {name!r}, which is no field of its Params; correct the name")
        value = getattr(value, part)
    return value


def task_key(spec: StageSpec, inputs: Mapping[str, str], schemas: Mapping[str, str]) -> str:
    """The key of one shard: `inputs` argument -> artifact digest, `schemas` kind -> version of the kinds in them."""
    machine = {"machine": spec.machine} if spec.machine else {}
    return digest("afford-task", {
        "code": spec.code.digest, "params": spec.params, "inputs": dict(inputs),
        "schemas": dict(schemas), "libraries": spec.libraries, "threads": spec.threads, **machine})


def seed_of(params: Any, inputs: Mapping[str, str]) -> int:
    """The seed of a task's global random states: 63 bits of the digest of its parameters and inputs, whatever its code and key."""
    return int(digest("afford-seed", {"params": params, "inputs": dict(inputs)})[:16], 16) >> 1


@cache
def machine_kind() -> str:
    """What byte equality is promised for: architecture, vector units (those of bfloat16 decide mixed precision), GPU and driver,
    version of Python. It is recorded, and part of the key of stages that declare MACHINE.
    """
    parts = [platform.machine(), sys.platform, f"python{sys.version_info[0]}.{sys.version_info[1]}", *_vectors(), *_gpus()]
    forced = os.environ.get("OPENBLAS_CORETYPE")
    return " ".join([*parts, f"openblas={forced}"] if forced else parts)


def _vectors() -> list[str]:
    """Where the system does not say (not Linux), none are known."""
    if not CPUINFO.exists():
        return []
    lines = CPUINFO.read_text(encoding="utf-8", errors="replace").splitlines()
    flags = {flag for line in lines[:64] if line.lower().startswith(("flags", "features")) for flag in line.split()}
    return [name for name in VECTORS if name in flags]


def _gpus() -> list[str]:
    """Models and driver of NVIDIA's GPUs, as the kernel module states them."""
    version = NVIDIA / "version"
    if not version.exists():
        return []
    driver = next((word for word in version.read_text().split() if word[:1].isdigit() and "." in word), "unknown")
    infos = sorted((NVIDIA / "gpus").glob("*/information"))
    models = {line.partition(":")[2].strip() for info in infos for line in info.read_text().splitlines()[:1]}
    return [f"driver{driver}", *sorted(model.replace(" ", "-") for model in models)]


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
