"""Parameters of one backend: a field of Params that holds a dataclass, whose fields are STAGE.BLOCK.FIELD on the command line."""

from __future__ import annotations

import ast
import dataclasses
import inspect
import typing
from collections.abc import Iterator
from typing import Any, NamedTuple

from commands.errors import UsageError, unknown


class Described(NamedTuple):
    """One parameter of a stage."""

    name: str
    """FIELD, or BLOCK.FIELD"""
    type: str
    value: Any
    doc: str
    """the string literal under the field"""
    selected: bool
    """False for a parameter of a backend that is not selected"""


def blocks(params: Any) -> dict[str, Any]:
    """Name -> value of the fields that hold parameters of their own."""
    values = {field.name: getattr(params, field.name) for field in dataclasses.fields(params)}
    return {name: value for name, value in values.items() if dataclasses.is_dataclass(value)}


def described(params: Any) -> Iterator[Described]:
    """Every parameter of a stage: what the stage itself declares, what it shares with others, then block by block."""
    docs, inside = _docs(type(params)), blocks(params)
    own = inspect.get_annotations(type(params))
    for field in sorted(dataclasses.fields(params), key=lambda field: field.name not in own):
        if field.name not in inside:
            yield Described(field.name, str(field.type), getattr(params, field.name), docs.get(field.name, ""), True)
    for name, block in inside.items():
        for one in described(block):
            yield one._replace(name=f"{name}.{one.name}", selected=is_selected(params, name))


def is_selected(params: Any, block: str) -> bool:
    """Whether a block is that of the chosen backend; a block of no backend always counts."""
    chosen = str(getattr(params, "backend", "")).replace("-", "_")
    return not chosen or block == chosen


def refusal(where: str, name: str, params: Any) -> UsageError:
    """For a parameter that is not there: where it is now, or the names that there are."""
    homes = {block: f"{where}.{block}.{name}" for block, value in blocks(params).items() if hasattr(value, name)}
    if not homes:
        return unknown(f"parameter of {where}", name, (field.name for field in dataclasses.fields(params)))
    backends = f"backend{'s' if len(homes) > 1 else ''} {' and '.join(homes)}"
    return UsageError(f"{where}.{name} is a parameter of the {backends}; write {' or '.join(homes.values())}")


def not_one_value(where: str, name: str, params: Any) -> UsageError:
    """For a block that is set as if it were one parameter, which may have had its name before."""
    fields = [f"{where}.{name}.{field.name}" for field in dataclasses.fields(getattr(params, name))]
    before = [f"{where}.{block}.{name}" for block, value in blocks(params).items() if hasattr(value, name)]
    more = f"; what was {where}.{name} is {' or '.join(before)}" if before else ""
    return UsageError(f"{where}.{name} holds the parameters of the backend {name}; write {' or '.join(fields)}{more}")


def types(params: Any) -> dict[str, Any]:
    """Field -> type."""
    hints = typing.get_type_hints(type(params))
    return {field.name: hints[field.name] for field in dataclasses.fields(params)}


def _docs(of: type) -> dict[str, str]:
    """Field -> doc line, also of the classes that it inherits from."""
    found: dict[str, str] = {}
    for cls in reversed([one for one in of.__mro__ if dataclasses.is_dataclass(one)]):
        body = ast.parse(inspect.getsource(cls)).body[0]
        assert isinstance(body, ast.ClassDef)
        for field, after in zip(body.body, [*body.body[1:], None], strict=True):
            if isinstance(field, ast.AnnAssign) and isinstance(field.target, ast.Name):
                literal = after.value if isinstance(after, ast.Expr) else None
                doc = " ".join(str(literal.value).split()) if isinstance(literal, ast.Constant) else ""
                found[field.target.id] = doc or found.get(field.target.id, "")  # another default alone keeps the doc line
    return found
