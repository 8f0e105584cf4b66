"""Location-free normal form of a syntax tree: equal for two statements that do the same.

Locations are no part of it. An import is spelled as the names that it binds, and a string that may name project code
("module:attribute") as a slot. `Slots` lists the imported names and these strings in the same order, for the linker to resolve.
Adjacent imports count as one, in the order of the names that they bind.
"""

from __future__ import annotations

import ast
from collections.abc import Callable, Hashable, Iterator
from dataclasses import dataclass, field
from functools import cache
from itertools import groupby
from typing import Any

from runner.names import ENTRY_POINT

IMPORTS = (ast.Import, ast.ImportFrom)


@dataclass
class Slots:
    """Parts of statements that the normal form omits."""

    bindings: Callable[[Any], list[tuple[str, str]]]
    """(bound name, 'module' or 'module:attribute') of an import"""
    imports: list[str] = field(default_factory=list)
    """'module' or 'module:attribute' of every imported name"""
    strings: list[str] = field(default_factory=list)
    """'module:attribute' of every string of this form"""
    home: bool = False
    """True if the statement uses the name of its own module"""
    any_module_name: bool = False
    """True if the statement may use the module name of any object"""


def spell(node: Any, slots: Slots, schema: bool = False) -> Any:
    """Convert a syntax tree to a JSON tree: [kind, field, value, ...], fields sorted, empty ones omitted.

    In a `schema` module the doc line (last positional argument) and the encoding of a field are omitted as well.
    """
    if isinstance(node, ast.AST):
        if schema and isinstance(node, ast.AnnAssign) and isinstance(node.value, ast.Call):
            node = _without_doc(node, node.value)
        _note_names(node, slots)
        out: list[Any] = [type(node).__name__]
        for name in _fields(node.__class__):
            value = getattr(node, name, None)
            if value is not None and value != []:
                out += [name, _constant(value, slots) if isinstance(node, ast.Constant) else spell(value, slots, schema)]
        return out
    if isinstance(node, list):
        return [part for imports, run in groupby(node, lambda item: isinstance(item, IMPORTS))
                for part in (_imports(run, slots) if imports else _others(run, slots, schema))]
    return node


def is_text(statement: ast.AST) -> bool:
    """Return True for a docstring, or a string literal that documents a field."""
    value = statement.value if isinstance(statement, ast.Expr) else None
    return isinstance(value, ast.Constant) and isinstance(value.value, str)


def _others(run: Iterator[Any], slots: Slots, schema: bool) -> list[Any]:
    return [spell(item, slots, schema) for item in run if not is_text(item)]


def _imports(run: Iterator[ast.Import | ast.ImportFrom], slots: Slots) -> list[Any]:
    """Names that imports bind; of two imports of the same name the later one is listed last."""
    found = sorted((binding for node in run for binding in slots.bindings(node)), key=lambda binding: binding[0])
    first = len(slots.imports)
    slots.imports += [target for _, target in found]
    return [["Imports", *([name, first + number] for number, (name, _) in enumerate(found))]]


def _note_names(node: ast.AST, slots: Slots) -> None:
    """Record uses of module names, which are locations."""
    name = node.id if isinstance(node, ast.Name) else node.attr if isinstance(node, ast.Attribute) else getattr(node, "value", "")
    if isinstance(node, ast.Name) and name in ("__name__", "__package__"):
        slots.home = True
    elif isinstance(name, str) and name == "__module__":
        slots.any_module_name = True


@cache
def _fields(kind: Hashable) -> list[str]:
    """Fields of a kind of node that affect execution."""
    assert isinstance(kind, type) and issubclass(kind, ast.AST)
    return sorted(set(kind._fields) - {"ctx", "kind", "type_comment", "type_ignores"})


def _constant(value: Any, slots: Slots) -> list[str | int]:
    """Constant with a tag, so that 1, 1.0, True and '1' differ."""
    if isinstance(value, str) and ":" in value and ENTRY_POINT.fullmatch(value):
        slots.strings.append(value)
        return ["named", len(slots.strings) - 1]
    return [type(value).__name__, value.hex() if isinstance(value, (float, bytes)) else repr(value)]


def _without_doc(node: ast.AnnAssign, call: ast.Call) -> ast.AnnAssign:
    keywords = [keyword for keyword in call.keywords if keyword.arg not in ("doc", "encoding")]
    bare = ast.Call(func=call.func, args=call.args[:-1], keywords=keywords)
    return ast.AnnAssign(target=node.target, annotation=node.annotation, value=bare, simple=node.simple)
