"""Why a task runs: the new key's parts against those of the last trace of the same shard, in a fixed order."""

from __future__ import annotations

import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from runner.files import DamagedError, seal, unseal, write_atomic
from runner.fingerprint import changed
from runner.keys import StageSpec
from runner.report import Reason
from runner.traces import Trace

SHOWN = 3


def compare(last: Trace | None, spec: StageSpec, inputs: Mapping[str, str], schemas: Mapping[str, str], store: Path) -> Reason:
    """The first thing that differs from `last`: parameters, code, libraries, threads, machine, schemas, inputs."""
    if last is None:
        return Reason("first run")
    if last.params != spec.params:
        return Reason("parameter changed", _params(last.params, spec.params))
    if last.code != spec.code.digest:
        return Reason("code changed", _code(last, spec, store))
    if last.libraries != spec.libraries:
        return Reason("library version changed", _pairs(last.libraries, spec.libraries))
    if last.threads != spec.threads:
        return Reason("threads changed", f"{last.threads} -> {spec.threads}")
    if spec.machine and last.machine != spec.machine:
        return Reason("machine changed", f"{last.machine} -> {spec.machine}")
    if last.inputs != dict(inputs):
        return Reason("input changed", ", ".join(_differing(last.inputs, inputs)))
    if last.schemas != dict(schemas):
        return Reason("schema changed", ", ".join(_differing(last.schemas, schemas)))
    return Reason("output lost")


def keep_definitions(store: Path, spec: StageSpec) -> None:
    """Remember the definitions behind a fingerprint, so that the next change can be named."""
    if kept_definitions(store, spec.code.digest) is None:
        write_atomic(store / "code" / f"{spec.code.digest}.json", seal(spec.code.definitions, f"code {spec.code.digest}"))


def kept_definitions(store: Path, code: str) -> dict[str, str] | None:
    """The definitions behind a fingerprint; None where they were not kept, or are damaged."""
    try:
        return dict(unseal((store / "code" / f"{code}.json").read_bytes(), f"code {code}"))
    except (FileNotFoundError, DamagedError):
        return None


def _code(last: Trace, spec: StageSpec, store: Path) -> str:
    old = kept_definitions(store, last.code)
    if old is None:
        return "its former definitions were not kept"
    names = changed(old, spec.code.definitions)
    if not names:
        return "the same definitions, reached by other names"
    more = f" and {len(names) - SHOWN} more" if len(names) > SHOWN else ""
    return ", ".join(names[:SHOWN]) + more


def _params(old: Any, new: Any) -> str:
    return _pairs(_flat(old), _flat(new))


def _flat(tree: Any) -> dict[str, Any]:
    """Parameters by name, those of a block as 'block.name'."""
    found: dict[str, Any] = {}
    for name, value in tree["fields"].items() if tree else ():
        is_block = isinstance(value, dict) and "fields" in value
        found |= {f"{name}.{inner}": part for inner, part in _flat(value).items()} if is_block else {name: value}
    return found


def _pairs(old: Mapping[str, Any], new: Mapping[str, Any]) -> str:
    return ", ".join(f"{name} {_show(old, name)} -> {_show(new, name)}" for name in _differing(old, new))


def _show(table: Mapping[str, Any], name: str) -> str:
    return json.dumps(table[name]) if name in table else "(none)"


def _differing(old: Mapping[str, Any], new: Mapping[str, Any]) -> list[str]:
    return [name for name in sorted({*old, *new}) if (name in old) != (name in new) or old.get(name) != new.get(name)]
