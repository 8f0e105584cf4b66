"""Parameters from the command line and from files: `--set STAGE.PARAM=VALUE`, `--set STAGE.BACKEND.PARAM=VALUE` and
`--params FILE` (TOML or JSON).
"""

from __future__ import annotations

import dataclasses
import itertools
import json
import tomllib
import typing
from collections.abc import Iterable, Iterator
from pathlib import Path
from typing import Any

from commands.blocks import blocks, not_one_value, refusal, types
from commands.bounds import check
from commands.errors import UsageError, unknown
from maps.settings import PRESETS, SYSTEM_OF, Settings

TRUE, FALSE = ("true", "yes", "on", "1"), ("false", "no", "off", "0")


def settings(sets: Iterable[str], file: Path | None) -> Settings:
    """The defaults, or those of a preset that is named (a variant of a training), then the file, then each `--set` in order;
    UsageError names what does not exist or does not fit.
    """
    changes = [*_from_file(file), *(_split(word) for word in sets)]
    named = {change[0]: PRESETS[change] for change in changes if isinstance(change[2], str) and change in PRESETS}
    chosen = Settings.of(**named)
    for stage, name, value in changes:
        chosen = _change(chosen, stage, name, value)
    return chosen


def columns(sets: Iterable[str], file: Path | None) -> dict[str, Settings]:
    """Settings by the names of their backends: one for each where `--set STAGE.backend=a,b` names several, in their order (all
    combinations where several stages have several); one named '' where none does. UsageError as `settings`.
    """
    choices = [_choices(word) for word in sets]
    found = {}
    for chosen in itertools.product(*choices):
        label = "_".join(word.partition("=")[2] for word, of in zip(chosen, choices, strict=True) if len(of) > 1)
        found[label] = settings(chosen, file)
    return found


def _choices(word: str) -> list[str]:
    """A `--set` for each backend that it names."""
    path, _, value = word.partition("=")
    if not path.endswith(".backend"):
        return [word]
    return [f"{path}={name.strip()}" for name in dict.fromkeys(value.split(","))]


def _from_file(path: Path | None) -> Iterator[tuple[str, str, Any]]:
    if path is None:
        return
    try:
        text = path.read_text()
        tables = json.loads(text) if path.suffix == ".json" else tomllib.loads(text)
    except (OSError, ValueError) as error:
        raise UsageError(f"--params {path}: expected a TOML or JSON file with one table per stage, got: {error}") from error
    if not isinstance(tables, dict):
        raise UsageError(f"--params {path}: expected one table per stage, got {type(tables).__name__}; write it as "
                         '{"mask_densify": {"radius": 10}}')
    for stage, table in tables.items():
        if not isinstance(table, dict):
            raise UsageError(f"--params {path}: {stage}: expected a table of parameters, got {type(table).__name__}")
        yield from ((stage, name, value) for name, value in _flat(table))


def _flat(table: dict[str, Any], above: str = "") -> Iterator[tuple[str, Any]]:
    """Values by name, those of a table of a backend as BACKEND.NAME."""
    for name, value in table.items():
        if isinstance(value, dict):
            yield from _flat(value, f"{above}{name}.")
        else:
            yield above + name, value


def _split(word: str) -> tuple[str, str, str]:
    path, equals, value = word.partition("=")
    stage, dot, name = path.partition(".")
    if not (equals and dot):
        raise UsageError(f"--set {word}: expected STAGE.PARAM=VALUE, e.g. --set mask_densify.radius=10")
    return stage.replace("-", "_"), name.replace("-", "_"), value


TRAINED_BY = {"twohands": "model_train", "sor3d": "sor3d_train", "sor3d_actions": "sor3d_pretrain", "boxes": "boxes_train"}
"""what model_train.backend chose from -> the stage that trains it"""


def _change(chosen: Settings, stage: str, name: str, value: Any) -> Settings:
    if stage not in SYSTEM_OF:
        raise unknown("stage", stage, SYSTEM_OF)
    if (stage, name) == ("model_train", "backend"):
        raise UsageError(f"model_train.backend: model_train trains the two-hand model alone, and {value} is trained by "
                         f"{TRAINED_BY.get(str(value), 'another stage')}; set the parameters of that stage")
    return chosen.with_stages(**{stage: _changed(chosen.params(stage), stage, name, value)})


def _changed(params: Any, where: str, name: str, value: Any) -> Any:
    """`params` with one field changed, of a block where the name is BLOCK.FIELD."""
    name, _, inner = name.partition(".")
    kinds = types(params)
    if name not in kinds:
        raise refusal(where, name, params)
    if name in blocks(params):
        if not inner:
            raise not_one_value(where, name, params)
        fitted = _changed(getattr(params, name), f"{where}.{name}", inner, value)
    elif inner:
        raise UsageError(f"{where}.{name}.{inner}: {where}.{name} is one value and has no parameters; write {where}.{name}")
    else:
        fitted = _fit(f"{where}.{name}", value, kinds[name])
        check(where, name, fitted, params)
    try:
        return dataclasses.replace(params, **{name: fitted})
    except ValueError as error:
        raise UsageError(f"{where}.{name}: {error}") from error


def _fit(where: str, value: Any, kind: Any) -> Any:
    """`value` (text, or a parsed value) as `kind`; UsageError says what was expected."""
    try:
        return _convert(value, kind)
    except (TypeError, ValueError) as error:
        shown = getattr(kind, "__name__", None) if not typing.get_args(kind) else str(kind).replace("typing.", "")
        raise UsageError(f"{where}: expected {shown}, got {value!r}") from error


def _convert(value: Any, kind: Any) -> Any:
    origin, parts = typing.get_origin(kind), typing.get_args(kind)
    if origin is tuple:
        items = _items(value) if isinstance(value, str) else list(value)
        if parts[1:] != (...,) and len(items) != len(parts):
            raise ValueError(value)
        return tuple(_convert(item, parts[0]) for item in items)
    if origin is typing.Literal:
        if value not in parts:
            raise ValueError(value)
        return value
    if kind is bool:
        word = str(value).lower()
        if word not in TRUE + FALSE:
            raise ValueError(value)
        return word in TRUE
    if kind in (int, float):
        if isinstance(value, bool) or (kind is int and isinstance(value, float)):
            raise TypeError(value)
        return kind(value)
    if not isinstance(value, str):
        raise TypeError(value)
    return value


def _items(text: str) -> list[Any]:
    """`a,b`, or a list as JSON has it: `["a", "b"]`."""
    return json.loads(text) if text.strip().startswith("[") else [word.strip() for word in text.split(",") if word.strip()]
