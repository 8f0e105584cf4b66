"""Words for what differs between two tasks: parameters, definitions of code, libraries, inputs."""

from __future__ import annotations

import json
from collections.abc import Mapping
from typing import Any

from runner.fingerprint import changed

SHOWN = 3
"""definitions that are named; the others are counted"""


def definition_changes(old: Mapping[str, str] | None, new: Mapping[str, str] | None) -> str:
    """Names of definitions that differ; None stands for definitions that were not kept."""
    if old is None or new is None:
        return "the previous definitions were not kept"
    names = changed(old, new)
    if not names:
        return "same definitions, reached through other names"
    more = f" and {len(names) - SHOWN} more" if len(names) > SHOWN else ""
    return ", ".join(names[:SHOWN]) + more


def parameter_changes(old: Any, new: Any) -> str:
    """'name old -> new' for every parameter that differs, given two canonical trees."""
    return pairs(_flat(old), _flat(new))


def pairs(old: Mapping[str, Any], new: Mapping[str, Any]) -> str:
    """'name old -> new' for every entry that differs."""
    return ", ".join(f"{name} {_show(old, name)} -> {_show(new, name)}" for name in differing(old, new))


def differing(old: Mapping[str, Any], new: Mapping[str, Any]) -> list[str]:
    """Names whose values differ, or that only one table has."""
    return [name for name in sorted({*old, *new}) if (name in old) != (name in new) or old.get(name) != new.get(name)]


def _flat(tree: Any) -> dict[str, Any]:
    """Parameters by name; those of a block as 'block.name'."""
    found: dict[str, Any] = {}
    for name, value in tree["fields"].items() if tree else ():
        is_block = isinstance(value, dict) and "fields" in value
        found |= {f"{name}.{inner}": part for inner, part in _flat(value).items()} if is_block else {name: value}
    return found


def _show(table: Mapping[str, Any], name: str) -> str:
    return json.dumps(table[name]) if name in table else "(none)"
