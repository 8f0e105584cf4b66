"""Parameters from the command line and from files.

`--set STAGE.PARAM=VALUE`, `--set STAGE.BACKEND.PARAM=VALUE` and `--params FILE` (TOML or JSON). The parameters of a backend are a
block: a field of Params that holds a dataclass. A value is checked against its type, its unit (finite, not negative) and the words
that the stage accepts.
"""

from __future__ import annotations

import ast
import dataclasses
import inspect
import itertools
import json
import math
import re
import sys
import tomllib
import typing
from collections.abc import Iterable, Iterator
from pathlib import Path
from typing import Any, NamedTuple

from commands.errors import UsageError, unknown
from maps.settings import MODES, PRESETS, SYSTEM_OF, Settings


class Parameter(NamedTuple):
    """One parameter of a stage."""

    name: str
    """FIELD or BLOCK.FIELD"""
    type: str
    value: Any
    doc: str
    """string literal under the field"""
    selected: bool
    """False for a parameter of a backend that is not selected"""


def blocks(params: Any) -> dict[str, Any]:
    """Map each field that holds parameters of a backend to its value."""
    values = {field.name: getattr(params, field.name) for field in dataclasses.fields(params)}
    return {name: value for name, value in values.items() if dataclasses.is_dataclass(value)}


def parameters_of(params: Any) -> Iterator[Parameter]:
    """Yield the parameters of a stage: its own, those that it shares with others, then block by block."""
    docs, inside = _docs(type(params)), blocks(params)
    own = inspect.get_annotations(type(params))
    for field in sorted(dataclasses.fields(params), key=lambda field: field.name not in own):
        if field.name not in inside:
            yield Parameter(field.name, str(field.type), getattr(params, field.name), docs.get(field.name, ""), True)
    for name, block in inside.items():
        for one in parameters_of(block):
            yield one._replace(name=f"{name}.{one.name}", selected=is_selected(params, name))


def is_selected(params: Any, block: str) -> bool:
    """Return True for the block of the selected backend, and for a block of no backend."""
    chosen = str(getattr(params, "backend", "")).replace("-", "_")
    return not chosen or block == chosen


def unknown_parameter(where: str, name: str, params: Any) -> UsageError:
    """Usage error for a missing parameter, with its present place or the valid names."""
    homes = {block: f"{where}.{block}.{name}" for block, value in blocks(params).items() if hasattr(value, name)}
    if not homes:
        return unknown(f"parameter of {where}", name, (field.name for field in dataclasses.fields(params)))
    backends = f"backend{'s' if len(homes) > 1 else ''} {' and '.join(homes)}"
    return UsageError(f"{where}.{name} belongs to the {backends}; write {' or '.join(homes.values())}")


def block_without_field(where: str, name: str, params: Any) -> UsageError:
    """Usage error for a block that is set like a single parameter, whose name it may have had before."""
    fields = [f"{where}.{name}.{field.name}" for field in dataclasses.fields(getattr(params, name))]
    before = [f"{where}.{block}.{name}" for block, value in blocks(params).items() if hasattr(value, name)]
    more = f"; the former {where}.{name} is now {' or '.join(before)}" if before else ""
    return UsageError(f"{where}.{name} holds the parameters of the backend {name}; write {' or '.join(fields)}{more}")


def field_types(params: Any) -> dict[str, Any]:
    """Map each field to its type."""
    hints = typing.get_type_hints(type(params))
    return {field.name: hints[field.name] for field in dataclasses.fields(params)}


def _docs(of: type) -> dict[str, str]:
    """Map each field to its doc line, inherited fields included."""
    found: dict[str, str] = {}
    for cls in reversed([one for one in of.__mro__ if dataclasses.is_dataclass(one)]):
        body = ast.parse(inspect.getsource(cls)).body[0]
        assert isinstance(body, ast.ClassDef)
        for field, after in zip(body.body, [*body.body[1:], None], strict=True):
            if isinstance(field, ast.AnnAssign) and isinstance(field.target, ast.Name):
                literal = after.value if isinstance(after, ast.Expr) else None
                doc = " ".join(str(literal.value).split()) if isinstance(literal, ast.Constant) else ""
                found[field.target.id] = doc or found.get(field.target.id, "")  # a field without a doc line inherits one
    return found


NOT_NEGATIVE = ("_px", "_px855", "_s", "_frames", "_hz", "_share", "_mm", "_fraction", "seed", "radius")
"""suffixes of parameters that are at least 0"""
POSITIVE = ("width_px", "height_px", "size_px", "side_px", "atlas_px", "texture_px", "focal_px", "rate_hz", "batch",
            "stride_frames", "supersample")  # fmt: skip
"""suffixes of parameters that are above 0"""
TRAINING = ("steps", "accumulate", "devices", "val_samples", "hypotheses")
"""training parameters that are at least 1"""
SEQUENCES = ("sor3d_train", "sor3d_pretrain", "boxes_train")
"""stages that train on RGB-D sequences"""
TRAININGS = ("model_train", *SEQUENCES)
DEVICE = re.compile(r"cpu|cuda(:\d+)?")
CHOICES: dict[tuple[str, str], tuple[str, ...]] = {
    ("dataset_pack", "split_by"): ("video", "participant"),
    ("dataset_pack", "made"): ("extracted", "rendered"),
    ("model_train", "variant"): ("small", "lite", "clip", "vlm"),
    ("model_train", "recipe"): ("quick", "release"),
    ("model_train", "target"): ("affordance", "object"),
    ("model_train", "split_by"): ("given", "video", "object"),
    ("model_train", "loss_mode"): ("paper", "code"),
    ("model_train", "mask_loss"): ("", "bce", "focal"),
    **{(stage, "variant"): ("small", "paper") for stage in SEQUENCES},
    **{(stage, "row"): ("rgb", "rgb_attention", "rgb_attention_flow2d", "rgbd", "rgbd_attention", "rgbd_attention_flow3d")
       for stage in SEQUENCES},
}
"""(file of a stage, parameter) -> accepted words, where no registry of the stage lists them"""
SHARED_CHOICES: dict[str, tuple[str, ...]] = {
    "dtype": ("float32", "bfloat16", "float16"),
    "engine": ("bullet", "mujoco"), "engines": ("bullet", "mujoco"), "proof_engines": ("bullet", "mujoco"),
}  # fmt: skip
"""parameter -> accepted words, the same in every stage"""


def check_value(stage: str, name: str, value: Any, params: Any) -> None:
    """Raise UsageError when a parameter cannot have `value`, which has the right type already.

    `params` is the dataclass of the parameter.
    """
    module = type(params).__module__
    file = module.rpartition(".")[2]
    known = CHOICES.get((file, name)) or vars(sys.modules[module]).get(registry(name)) or SHARED_CHOICES.get(name)
    for one in value if isinstance(value, tuple) else (value,):
        if isinstance(one, str):
            _word(stage, name, one, known)
        elif not isinstance(one, bool):
            _number(f"{stage}.{name}", name, one, file in TRAININGS and name in TRAINING)


def registry(name: str) -> str:
    """Constant that lists the choices of a parameter: backend -> BACKENDS, policy -> POLICIES."""
    return (name.removesuffix("y") + "ies" if name.endswith("y") else name + "s").upper()


def _word(stage: str, name: str, word: str, known: Iterable[str] | None) -> None:
    if known and word not in known:
        raise unknown(f"{name} of {stage}", word, known)
    if name == "device" and not DEVICE.fullmatch(word):
        raise UsageError(f"{stage}.{name}: expected cpu, cuda or cuda:N, got {word!r}")


def _number(where: str, name: str, number: float, counted: bool) -> None:
    if not math.isfinite(number):
        raise UsageError(f"{where}: expected a finite number, got {number}")
    if counted or name.endswith(POSITIVE):
        if number <= 0:
            raise UsageError(f"{where}: expected {'1 or more' if isinstance(number, int) else 'more than 0'}, got {number}")
    elif name.endswith(NOT_NEGATIVE) and number < 0:
        raise UsageError(f"{where}: expected 0 or more, got {number}")
    if name.endswith("_fraction") and number >= 1:
        raise UsageError(f"{where}: expected a share below 1, got {number}")


TRUE, FALSE = ("true", "yes", "on", "1"), ("false", "no", "off", "0")


def settings(sets: Iterable[str], file: Path | None) -> Settings:
    """Build the settings: defaults or the named preset with its mode, then the file, then each `--set` in order.

    UsageError for what does not exist or does not fit.
    """
    changes = [*_from_file(file), *(_split(word) for word in sets)]
    named = {change[0]: PRESETS[change] for change in changes if isinstance(change[2], str) and change in PRESETS}
    for change in changes:
        if isinstance(change[2], str) and change in MODES and change[0] in named:
            named[change[0]] = dataclasses.replace(named[change[0]], **MODES[change])
    chosen = Settings.of(**named)
    for stage, name, value in changes:
        chosen = _change(chosen, stage, name, value)
    return chosen


def columns(sets: Iterable[str], file: Path | None) -> dict[str, Settings]:
    """Settings by label: one per backend for `--set STAGE.backend=a,b`, all combinations for several stages.

    Without such a list, one entry labelled ''. UsageError as `settings`.
    """
    choices = [_choices(word) for word in sets]
    found = {}
    for chosen in itertools.product(*choices):
        label = "_".join(word.partition("=")[2] for word, of in zip(chosen, choices, strict=True) if len(of) > 1)
        found[label] = settings(chosen, file)
    return found


def _choices(word: str) -> list[str]:
    """Split a `--set` of several backends into one `--set` for each."""
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
        raise UsageError(f"--params {path}: not a TOML or JSON file with one table per stage: {error}") from error
    if not isinstance(tables, dict):
        raise UsageError(f"--params {path}: expected one table per stage, got {type(tables).__name__}; write it as "
                         '{"mask_densify": {"radius": 10}}')
    for stage, table in tables.items():
        if not isinstance(table, dict):
            raise UsageError(f"--params {path}: {stage}: expected a table of parameters, got {type(table).__name__}")
        yield from ((stage, name, value) for name, value in _flat(table))


def _flat(table: dict[str, Any], above: str = "") -> Iterator[tuple[str, Any]]:
    """Yield values by name; those in the table of a backend as BACKEND.NAME."""
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
"""former model_train.backend -> stage that trains it now"""


def _change(chosen: Settings, stage: str, name: str, value: Any) -> Settings:
    if stage not in SYSTEM_OF:
        raise unknown("stage", stage, SYSTEM_OF)
    if (stage, name) == ("model_train", "backend"):
        raise UsageError(f"model_train.backend: model_train trains only the two-hand model; {value} is trained by "
                         f"{TRAINED_BY.get(str(value), 'another stage')}, so set the parameters of that stage")
    if (stage, name) == ("hand_detect", "finder"):
        name, value = "backend", "landmarks" if value == "none" else value
    return chosen.with_stages(**{stage: _changed(chosen.params(stage), stage, name, value)})


def _changed(params: Any, where: str, name: str, value: Any) -> Any:
    """Copy `params` with one field changed, also of a block (BLOCK.FIELD)."""
    name, _, inner = name.partition(".")
    kinds = field_types(params)
    if name not in kinds:
        raise unknown_parameter(where, name, params)
    if name in blocks(params):
        if not inner:
            raise block_without_field(where, name, params)
        fitted = _changed(getattr(params, name), f"{where}.{name}", inner, value)
    elif inner:
        raise UsageError(f"{where}.{name}.{inner}: {where}.{name} is one value and has no parameters; write {where}.{name}")
    else:
        fitted = _fit(f"{where}.{name}", value, kinds[name])
        check_value(where, name, fitted, params)
    try:
        return dataclasses.replace(params, **{name: fitted})
    except ValueError as error:
        raise UsageError(f"{where}.{name}: {error}") from error


def _fit(where: str, value: Any, kind: Any) -> Any:
    """Convert `value` (text, or a parsed value) to the type `kind`; UsageError states the expected type."""
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
    """Split `a,b`, or parse a JSON list: `["a", "b"]`."""
    return json.loads(text) if text.strip().startswith("[") else [word.strip() for word in text.split(",") if word.strip()]
