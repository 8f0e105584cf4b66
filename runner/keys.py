"""Task keys: the digest of everything that an output depends on, and of nothing else."""

from __future__ import annotations

import os
import re
import sys
from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import cache
from pathlib import Path
from typing import Any

from blake3 import blake3

from runner.canonical import canonical, digest
from runner.codec import resolve
from runner.files import Source
from runner.fingerprint import Fingerprint, fingerprint, merged
from runner.graph import Node
from runner.known_code import KnownCode, KnownStage
from runner.modules import Modules
from runner.resources import Resources, resources_of
from runner.selection import declarations, select_of, unselected, without_blocks

VECTORS = ("avx2", "fma", "avx512f", "avx512_bf16", "amx_bf16", "asimd", "sve", "bf16")
"""CPU flags by which numeric libraries choose kernels, and which therefore affect the last bits"""
CPUINFO, NVIDIA = Path("/proc/cpuinfo"), Path("/proc/driver/nvidia")


@dataclass(frozen=True)
class StageSpec:
    """Properties that all shards of a stage share."""

    name: str
    function: str
    """'module:function' for the worker's import; not part of the key"""
    params: Any
    """canonical JSON tree"""
    code: Fingerprint
    """fingerprint of the stage, of the codec for the schemas that the stage uses, and of the worker's preparation"""
    libraries: dict[str, str]
    threads: int
    memory_gib: float
    sources: tuple[Source, ...]
    """files that the fingerprint covers, as they were read"""
    machine: str = ""
    """kind of machine, for stages that declare MACHINE; '' for all others"""
    blocks: frozenset[str] = frozenset()
    """fields of Params that hold parameters of backends that are not selected; not part of the key"""
    resources: Resources = Resources()
    timeout_s: float = 0.0
    digest: str = ""
    """digest of the parts that all keys of the stage share"""


class CodeFingerprints:
    """Fingerprints of the code that determines a task's bytes: stage, codec, worker preparation.

    `codec` and `worker` are "module:attribute"; their code counts only if it is under the root of `modules`. Definitions in
    schema packages count where a stage uses them, and through the schemas of its inputs (`task_key`).
    """

    def __init__(self, modules: Modules, codec: str, worker: str | None, cache: Path | None = None) -> None:
        self.modules, self.known = modules, KnownCode(cache, modules)
        self._codec, self._worker = codec, worker
        self._memo: dict[Any, Fingerprint] = {}

    def stage(self, function: str, params: Any, tree: Any) -> KnownStage:
        """Code and declarations of a stage, from the cache if possible; `tree` is the canonical form of the parameters."""
        key = digest("afford-stage", [function, tree, self._codec, self._worker])
        found = self.known.get(key)
        if found is None:
            module, select = function.partition(":")[0], select_of(params)
            declared, blocks = declarations(self.modules, module, select), unselected(self.modules, module, select)
            found = KnownStage(self.of(function, params), declared, blocks)
            self.known.put(key, found)
        return found

    def of(self, function: str, params: Any) -> Fingerprint:
        """Fingerprint 'module:function' under these Params; SourceError when some code cannot be followed."""
        stage = fingerprint(self.modules, function, select_of(params))
        return merged([stage, *self._codec_of(stage), *self._worker_of()])

    def _codec_of(self, stage: Fingerprint) -> list[Fingerprint]:
        """Fingerprint the registry entries that the codec selects (`Codec.selects`) for the schemas in the stage."""
        if not self._ours(self._codec):
            return []
        selects = getattr(resolve(self._codec), "selects", None)
        select = selects(frozenset(name.partition(":")[2] for name in stage.definitions)) if selects else {}
        memo = tuple(sorted(select.items()))
        if memo not in self._memo:
            self._memo[memo] = fingerprint(self.modules, self._codec, select, excluded=self.modules.schemas)
        return [self._memo[memo]]

    def _worker_of(self) -> list[Fingerprint]:
        if self._worker is None or not self._ours(self._worker):
            return []
        if "worker" not in self._memo:
            self._memo["worker"] = fingerprint(self.modules, self._worker, {})
        return [self._memo["worker"]]

    def _ours(self, reference: str) -> bool:
        return self.modules.get(reference.partition(":")[0]) is not None


def stage_spec(node: Node, codes: CodeFingerprints) -> StageSpec:
    """Read a stage's code and declarations.

    ValueError when the code cannot be followed or a library is not installed.
    """
    function, params = f"{node.value.__module__}:{node.value.__qualname__}", _params(node)
    code, declared, blocks = codes.stage(function, node.params, params)
    spec = StageSpec(
        name=node.name, function=function, params=without_blocks(params, node.params, blocks), code=code,
        libraries={name: _version(node.name, name) for name in sorted(declared["LIBRARIES"])},
        threads=declared["THREADS"], memory_gib=declared["MEMORY_GIB"],
        sources=tuple(codes.modules.source(path) for path in sorted(code.files) if not os.path.isdir(path)),
        machine=_machine(declared["MACHINE"], node, blocks), blocks=blocks,
        resources=resources_of(declared, node.params, blocks), timeout_s=declared["TIMEOUT_S"])
    return replace(spec, digest=spec_digest(spec))


def spec_digest(spec: StageSpec) -> str:
    """Digest of what all keys of a stage share: code, parameters, libraries, threads, kind of machine."""
    machine = {"machine": spec.machine} if spec.machine else {}
    return digest("afford-spec", {"code": spec.code.digest, "params": spec.params, "libraries": spec.libraries,
                                  "threads": spec.threads, **machine})


UNSET = (False, None, 0, "", "cpu")
"""values of a parameter that MACHINE names under which the bytes do not depend on the kind of machine"""


def _machine(declared: bool | list[str], node: Node, blocks: frozenset[str]) -> str:
    """Kind of machine, if MACHINE is True or one of the Params fields that it names is set, to another device than the CPU."""
    named = [] if isinstance(declared, bool) else [name for name in declared if name.partition(".")[0] not in blocks]
    return machine_kind() if declared is True or any(_field(node, name) not in UNSET for name in named) else ""


def _field(node: Node, name: str) -> Any:
    """Value of a parameter, by its name or by 'block.name'."""
    value = node.params
    for part in name.split("."):
        if not hasattr(value, part):
            raise ValueError(f"{node.name}: MACHINE names {name!r}, which is no field of its Params; correct the name")
        value = getattr(value, part)
    return value


def task_key(spec: str, inputs: Mapping[str, str], schemas: str) -> str:
    """Key of one shard: digest of the spec, the artifact of each argument, and the text of `schema_text`."""
    rows = "\n".join([f"{name}={inputs[name]}" for name in sorted(inputs)]) if len(inputs) > 1 else "".join(
        [f"{name}={artifact}" for name, artifact in inputs.items()])
    return blake3(f"afford-task\0{spec}\0{schemas}\0{rows}".encode()).hexdigest()


def schema_text(schemas: Mapping[str, str]) -> str:
    """Schemas of all inputs, as text: name and version of each."""
    return "\n".join(f"{kind}={schemas[kind]}" for kind in sorted(schemas))


def seed_of(params: Any, inputs: Mapping[str, str]) -> int:
    """Seed of a task's global random states: 63 bits of the digest of its parameters and inputs.

    The code and the key of the task have no influence.
    """
    return int(digest("afford-seed", {"params": params, "inputs": dict(inputs)})[:16], 16) >> 1


@cache
def machine_kind() -> str:
    """Kind of machine for which byte equality is promised.

    It consists of architecture, vector units (those of bfloat16 decide mixed precision), GPU, driver and Python version. Every
    trace records it, and it is part of the key of stages that declare MACHINE.
    """
    import platform  # only where a stage depends on the machine

    parts = [platform.machine(), sys.platform, f"python{sys.version_info[0]}.{sys.version_info[1]}", *_vectors(), *_gpus()]
    forced = os.environ.get("OPENBLAS_CORETYPE")
    return " ".join([*parts, f"openblas={forced}"] if forced else parts)


def _vectors() -> list[str]:
    """CPU flags among VECTORS; none where the system does not list them (not Linux)."""
    if not CPUINFO.exists():
        return []
    lines = CPUINFO.read_text(encoding="utf-8", errors="replace").splitlines()
    flags = {flag for line in lines[:64] if line.lower().startswith(("flags", "features")) for flag in line.split()}
    return [name for name in VECTORS if name in flags]


def _gpus() -> list[str]:
    """Models and driver of NVIDIA GPUs, as the kernel module lists them."""
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


@cache
def _installed() -> dict[str, str]:
    """Map each installed distribution to its version, by the names of the folders with their metadata."""
    found: dict[str, str] = {}
    for folder in sys.path:
        for name in os.listdir(folder) if os.path.isdir(folder) else ():
            distribution, dash, version = name.removesuffix(".dist-info").rpartition("-")
            if dash and name.endswith(".dist-info"):
                found.setdefault(_normal(distribution), version)
    return found


def _normal(distribution: str) -> str:
    return re.sub(r"[-_.]+", "-", distribution).lower()


def _version(stage: str, library: str) -> str:
    found = installed_version(library)
    if found is None:
        raise ValueError(f"{stage}: LIBRARIES names {library!r}, which is not installed; install it (an extra of the project "
                         "may bring it), or correct the name (it is the name of the distribution, e.g. opencv-python-headless)")
    return found


def installed_version(library: str) -> str | None:
    """Version of a distribution; None when it is not installed."""
    if library not in _versions:
        found = _installed().get(_normal(library)) or _read_version(library)
        if found is None:
            return None
        _versions[library] = found
    return _versions[library]


def _read_version(library: str) -> str | None:
    """Version of a distribution whose metadata have another form."""
    from importlib import metadata  # 15 ms, and rarely needed

    try:
        return metadata.version(library)
    except metadata.PackageNotFoundError:
        return None
