"""One module, read and not imported: its statements as digests, and the names that each of them uses.

A statement belongs to the names it binds. One that does more than bind (a loop, `TABLE["x"] = 1`, a call) belongs to every
name it mentions, and, when it mentions an imported one, to the module as a whole (`effects`). Names are resolved with
Python's scopes, so that a local variable is not taken for a constant of the module. The digest of a statement is taken over
our own spelling of its syntax tree: comments, docstrings and formatting do not count, nor does the version of Python.
"""

from __future__ import annotations

import ast
import re
from collections.abc import Iterator
from dataclasses import dataclass, field
from typing import Any

from runner.canonical import digest
from runner.names import Uses, imports_of, uses_of

REGISTRY_VALUE = re.compile(r"[A-Za-z_][\w.]*:[A-Za-z_]\w*")
DEFINITIONS = (ast.FunctionDef, ast.AsyncFunctionDef, ast.ClassDef)
LITERALS = ("LIBRARIES", "THREADS", "MEMORY_GIB", "MACHINE", "DATA_FILES", "DYNAMIC")


class SourceError(ValueError):
    """Code that cannot be followed statically; the message names file, line and what to do."""


@dataclass
class Module:
    """What is known of a module. References are 'name.attribute...' or, inside functions, '@module:name...' of an import."""

    name: str
    path: str
    statements: list[dict[str, Any]] = field(default_factory=list)
    """digest, refs, hints (names used in annotations only), getattrs (objects of a computed getattr)"""
    items: dict[str, list[int]] = field(default_factory=dict)
    """name -> its statements"""
    imports: dict[str, str] = field(default_factory=dict)
    """name -> 'module' or 'module:attribute'"""
    loads: list[str] = field(default_factory=list)
    """modules that importing this one imports as well"""
    effects: list[int] = field(default_factory=list)
    decorated: list[tuple[int, list[str]]] = field(default_factory=list)
    """definitions with decorators, and the names that those start with"""
    registries: dict[str, dict[str, str]] = field(default_factory=dict)
    literals: dict[str, Any] = field(default_factory=dict)


def parse_module(name: str, path: str, text: str, package: bool, schema: bool) -> Module:
    """Read a module. In a `schema` module the doc line (last positional argument) and the encoding of a field do not count."""
    try:
        tree = ast.parse(text)
    except SyntaxError as error:
        raise SourceError(f"{path}:{error.lineno}: {error.msg}") from error
    module = Module(name, path)
    home = name if package else name.rpartition(".")[0]
    for statement in tree.body:
        if not _is_text(statement):
            _add(module, statement, home, schema)
    return module


def _add(module: Module, statement: ast.stmt, home: str, schema: bool) -> None:
    imports = imports_of(statement, home, f"{module.path}:{statement.lineno}")
    module.imports.update({bound: target for bound, target, _ in imports})
    module.loads += [target.partition(":")[0] for _, target, typing_only in imports if not typing_only]
    module.loads += [target.replace(":", ".") for _, target, typing_only in imports if ":" in target and not typing_only]
    if isinstance(statement, (ast.Import, ast.ImportFrom)) or _is_guard(statement):
        return
    bound = _bound_names(statement)
    if bound is None and imports and not isinstance(statement, (ast.If, ast.Try)):
        raise SourceError(f"{module.path}:{statement.lineno}: an import inside this statement cannot be followed; move it out")
    uses = uses_of(statement, home, f"{module.path}:{statement.lineno}")
    index = len(module.statements)
    module.statements.append({"digest": digest("afford-code", spell(statement, schema)), "refs": sorted(uses.refs),
                              "hints": sorted(uses.hints), "getattrs": sorted(uses.getattrs)})
    for item in bound if bound is not None else _mentioned(statement):
        module.items.setdefault(item, []).append(index)
    if bound is None:
        _effect(module, index, uses)
    elif isinstance(statement, DEFINITIONS):
        parts = (node for decorator in statement.decorator_list for node in ast.walk(decorator))
        names = [node.id for node in parts if isinstance(node, ast.Name)]
        module.decorated += [(index, names)] if names else []
    elif isinstance(statement, (ast.Assign, ast.AnnAssign)) and statement.value is not None and len(bound) == 1:
        _literal(module, bound[0], statement.value)


def _effect(module: Module, index: int, uses: Uses) -> None:
    if any(ref.partition(".")[0] in module.imports or ref.startswith("@") for ref in uses.refs):
        module.effects.append(index)


def _literal(module: Module, name: str, value: ast.expr) -> None:
    """Remember registries and the declarations that the runner reads."""
    try:
        literal = ast.literal_eval(value)
    except ValueError:
        return
    if name in LITERALS:
        module.literals[name] = list(literal) if isinstance(literal, tuple) else literal
    if isinstance(literal, dict) and literal and all(
            isinstance(k, str) and isinstance(v, str) and REGISTRY_VALUE.fullmatch(v) for k, v in literal.items()):
        module.registries[name] = literal


def _bound_names(statement: ast.stmt) -> list[str] | None:
    """Names that a plain definition binds; None for a statement that does something else or more."""
    if isinstance(statement, DEFINITIONS):
        return [statement.name]
    if isinstance(statement, ast.AnnAssign):
        return [statement.target.id] if isinstance(statement.target, ast.Name) else None
    if isinstance(statement, ast.Assign):
        names = [name for target in statement.targets for name in _targets(target)]
        return None if "" in names else names
    return [] if isinstance(statement, ast.Pass) else None


def _targets(target: ast.expr) -> Iterator[str]:
    """Names in an assignment's target; '' for anything that is not a name."""
    if isinstance(target, (ast.Tuple, ast.List)):
        for element in target.elts:
            yield from _targets(element)
    elif isinstance(target, ast.Starred):
        yield from _targets(target.value)
    else:
        yield target.id if isinstance(target, ast.Name) else ""


def _mentioned(statement: ast.stmt) -> set[str]:
    """Every name in a statement, and every name that it defines."""
    names = {node.id for node in ast.walk(statement) if isinstance(node, ast.Name)}
    return names | {node.name for node in ast.walk(statement) if isinstance(node, DEFINITIONS)}


def _is_text(statement: ast.AST) -> bool:
    """A docstring, or a string literal that documents a field."""
    value = statement.value if isinstance(statement, ast.Expr) else None
    return isinstance(value, ast.Constant) and isinstance(value.value, str)


def _is_guard(statement: ast.stmt) -> bool:
    """`if TYPE_CHECKING:` and `if __name__ == "__main__":` run in no worker."""
    return isinstance(statement, ast.If) and not statement.orelse and ast.unparse(statement.test) in (
        "TYPE_CHECKING", "typing.TYPE_CHECKING", "__name__ == '__main__'")


def spell(node: Any, schema: bool = False) -> Any:
    """A syntax tree as a JSON tree: [kind, field, value, ...], fields sorted, empty ones left out."""
    if isinstance(node, ast.AST):
        if schema and isinstance(node, ast.AnnAssign) and isinstance(node.value, ast.Call):
            node = _without_doc(node, node.value)
        out: list[Any] = [type(node).__name__]
        for name in sorted(node._fields):
            value = getattr(node, name, None)
            if name not in ("ctx", "kind", "type_comment", "type_ignores") and value is not None and value != []:
                out += [name, _constant(value) if isinstance(node, ast.Constant) else spell(value, schema)]
        return out
    if isinstance(node, list):
        return [spell(item, schema) for item in node if not _is_text(item)]
    return node


def _constant(value: Any) -> list[str]:
    """Tagged, so that 1, 1.0, True and '1' differ."""
    return [type(value).__name__, value.hex() if isinstance(value, (float, bytes)) else repr(value)]


def _without_doc(node: ast.AnnAssign, call: ast.Call) -> ast.AnnAssign:
    keywords = [keyword for keyword in call.keywords if keyword.arg not in ("doc", "encoding")]
    bare = ast.Call(func=call.func, args=call.args[:-1], keywords=keywords)
    return ast.AnnAssign(target=node.target, annotation=node.annotation, value=bare, simple=node.simple)
