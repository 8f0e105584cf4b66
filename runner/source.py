"""Parse one module without importing it: statements as digests, and the names that each statement uses.

A statement belongs to the names that it binds. A statement with effects (a loop, `TABLE["x"] = 1`, a call) belongs to every name in
it, and if it mentions an imported name, to the module as a whole (`effects`). Names are resolved by Python's scoping rules, so that
a local variable is not confused with a constant of the module.

The digest of a statement covers the normal form of its syntax tree (`runner.spelling`). Comments, docstrings, formatting, the
version of Python and the locations of imports do not count.
"""

from __future__ import annotations

import ast
import builtins
import re
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from runner.canonical import digest
from runner.external import COMPUTED, harmless
from runner.names import SourceError, Uses, bindings_of, imports_of, loads_of, uses_of
from runner.scopes import ARGUMENT, DEFINITIONS, arguments_of, roots, scope_of
from runner.spelling import Slots, is_text, spell

__all__ = ["Module", "SourceError", "import_of", "line_of", "parse_module", "untyped", "where"]

REGISTRY_VALUE = re.compile(r"[A-Za-z_][\w.]*:[A-Za-z_]\w*")
DECLARED = "LIBRARIES|THREADS|MEMORY_GIB|MACHINE|GPUS|GPU_SHARED|SCRATCH_GIB|TIMEOUT_S"
LITERALS = re.compile(rf"([A-Z]\w*_)?({DECLARED})|DATA_FILES|DYNAMIC")
PARAMS = "Params"
"""class whose blocks are separate statements, see `runner.selection`"""
BUILTINS = frozenset((*(name for name in dir(builtins) if not name.startswith("_")), "__name__")) - {
    name.partition(".")[2] for name in COMPUTED}
PASSIVE = ("__repr__", "__str__", "__eq__", "__hash__", "__len__", "__bool__")
"""methods that do not run during construction, or have no effect"""
MAIN = "__main__"
"""name of the item for `if __name__ == "__main__":`"""


@dataclass
class Module:
    """Statements and names of a module. References have the form that `runner.names` describes."""

    name: str
    path: str
    statements: list[dict[str, Any]] = field(default_factory=list)
    """each statement has digest, line and refs, and these keys where they apply:
    imports and strings (values of the slots in its normal form), home (it uses the name of its own module), any_module_name (it may
    use the name of any module), started (modules that it only starts as programs); hints (names used only in annotations), getattrs
    (objects of a computed getattr), loads (modules imported inside functions); kind ('class' or 'function'), bases, hook (a class
    with effects on subclass creation), builds (a class with effects on construction), untyped (parameters of `run` without a type);
    sets and does (changes at import, and inside functions), gives (values that functions return), alias (objects that a name may
    refer to), now (references used at import if there is a call), block (name of the field of Params)"""
    items: dict[str, list[int]] = field(default_factory=dict)
    """name -> indices of its statements"""
    imports: dict[str, list[str]] = field(default_factory=dict)
    """name -> 'module' or 'module:attribute' of every import that binds it"""
    typing: list[str] = field(default_factory=list)
    """names imported only for type checkers"""
    loads: list[str] = field(default_factory=list)
    """modules that importing this one imports as well"""
    effects: list[int] = field(default_factory=list)
    decorated: list[tuple[int, list[str]]] = field(default_factory=list)
    """definitions with decorators, and the first names of the decorators"""
    registries: dict[str, dict[str, str]] = field(default_factory=dict)
    literals: dict[str, Any] = field(default_factory=dict)

    @property
    def is_package(self) -> bool:
        """True for a package, which may contain modules."""
        return not self.path.endswith(".py") or self.path.endswith("/__init__.py")


def parse_module(name: str, path: str, text: str, package: bool, schema: bool) -> Module:
    """Parse a module.

    In a `schema` module the doc line (last positional argument) and the encoding of a field do not count.
    """
    module = Module(name, path)
    for statement in _parsed(path, text).body:
        if not is_text(statement):
            _add(module, statement, _home(name, package), schema)
    for found in module.statements:
        found["refs"] = [ref for ref in found["refs"] if not _is_plain(module, ref)]
        for key in ("sets", "does", "gives", "alias"):
            found[key] = sorted(entry for entry in found[key] if not _harmless(module, entry))
        calls = any(entry.endswith("()") for entry in found["sets"])
        found["now"] = [ref for ref in found["refs"] if ref in found["now"]] if calls else []
    module.statements = [{key: value for key, value in found.items() if value or key == "refs"} for found in module.statements]
    return module


def line_of(module: Module, statement: dict[str, Any], ref: str) -> int:
    """Line of a reference, read from the file again for an error message."""
    at: int = statement["line"]
    tree = _parsed(module.path, Path(module.path).read_text(encoding="utf-8"))
    home = _home(module.name, module.is_package)
    for found in (node for node in tree.body if node.lineno == at):
        uses = uses_of(found, home, f"{module.path}:{at}")
        return {**uses.sets, **uses.getattrs, **uses.hints, **uses.refs}.get(ref, at)
    return at


def where(module: Module, name: str) -> str:
    """'file:line' of the first statement of a name."""
    return f"{module.path}:{module.statements[module.items[name][0]]['line']}"


def import_of(module: Module, target: str) -> str:
    """'file:line' of the import of a module, read from the file again for an error message."""
    tree = _parsed(module.path, Path(module.path).read_text(encoding="utf-8"))
    home = _home(module.name, module.is_package)
    lines = (node.lineno for node in ast.walk(tree) if isinstance(node, (ast.Import, ast.ImportFrom))
             and target in loads_of(node, home))
    return f"{module.path}:{next(lines, 1)}"


def untyped(module: Module, name: str) -> list[str]:
    """Parameters of a stage, except `ctx`, without a specific class."""
    return [arg for index in module.items.get(name, ()) for arg in module.statements[index].get("untyped", ()) if arg != "ctx"]


def _parsed(path: str, text: str) -> ast.Module:
    try:
        return ast.parse(text)
    except SyntaxError as error:
        raise SourceError(f"{path}:{error.lineno}: {error.msg}") from error


def _home(name: str, package: bool) -> str:
    return name if package else name.rpartition(".")[0]


def _add(module: Module, statement: ast.stmt, home: str, schema: bool) -> None:
    at = f"{module.path}:{statement.lineno}"
    imported = _imports(module, statement, home, at)
    if isinstance(statement, (ast.Import, ast.ImportFrom)) or _is_guard(statement, "TYPE_CHECKING", "typing.TYPE_CHECKING"):
        return
    blocks: list[tuple[ast.stmt, str]] = []
    if isinstance(statement, ast.ClassDef) and statement.name == PARAMS and not schema:
        statement, blocks = _parted(statement)
    bound = _bound_names(statement)
    if bound is None and imported and not isinstance(statement, (ast.If, ast.Try)):
        raise SourceError(f"{at}: an import inside this statement cannot be followed; move it out of the statement")
    index, main = len(module.statements), _is_guard(statement, "__name__ == '__main__'")
    uses = _keep(module, statement, home, schema, main)
    for item in [MAIN] if main else bound if bound is not None else _mentioned(statement) | set(imported):
        module.items.setdefault(item, []).append(index)
    for block, name in blocks:
        module.items[PARAMS].append(len(module.statements))
        _keep(module, block, home, schema, block=name)
    if bound is None and not main:
        _effect(module, index, uses)
    elif isinstance(statement, DEFINITIONS):
        names = [node.id for part in _decorators(statement) for node in ast.walk(part) if isinstance(node, ast.Name)]
        module.decorated += [(index, names)] if names else []
    elif isinstance(statement, (ast.Assign, ast.AnnAssign)) and statement.value is not None and bound and len(bound) == 1:
        _literal(module, bound[0], statement.value)


def _keep(module: Module, statement: ast.stmt, home: str, schema: bool, main: bool = False, **more: Any) -> Uses:
    """Add a statement, with its digest and uses, to the module."""
    at = f"{module.path}:{statement.lineno}"
    uses, slots = uses_of(statement, home, at), Slots(lambda node: bindings_of(node, home, at))
    module.statements.append({
        "digest": digest("afford-code", spell(statement, slots, schema)), "line": statement.lineno, "refs": sorted(uses.refs),
        "imports": slots.imports, "strings": slots.strings, "home": slots.home and not main,
        "any_module_name": slots.any_module_name, "started": sorted(uses.started()),
        "hints": sorted(uses.hints), "getattrs": sorted(uses.getattrs),
        "loads": sorted(uses.loads), **_class(statement), **_function(statement), "sets": uses.sets, "does": uses.does,
        "gives": uses.gives, "alias": _alias(statement), "now": uses.now, **more})
    return uses


def _parted(whole: ast.ClassDef) -> tuple[ast.ClassDef, list[tuple[ast.stmt, str]]]:
    """Split a class into the class without backend blocks, and one class per block with its name."""
    rest, blocks = list[ast.stmt](), list[tuple[ast.stmt, str]]()
    for part in whole.body:
        if _is_block(part):
            at = ast.Expr(ast.Constant(sum(not is_text(other) for other in rest)))  # its position among the other fields
            alone = ast.ClassDef(whole.name, [], [], [part, ast.copy_location(at, part)], [])
            blocks.append((ast.copy_location(alone, part), part.target.id))  # type: ignore[attr-defined]  # see _is_block
        else:
            rest.append(part)
    return ast.copy_location(ast.ClassDef(whole.name, whole.bases, whole.keywords, rest, whole.decorator_list), whole), blocks


def _is_block(part: ast.stmt) -> bool:
    """Return True for a field whose annotation names another class."""
    return isinstance(part, ast.AnnAssign) and isinstance(part.target, ast.Name) and any(
        isinstance(node, ast.Name) and node.id not in BUILTINS for node in ast.walk(part.annotation))


def _imports(module: Module, statement: ast.stmt, home: str, at: str) -> list[str]:
    """Record the imports of a statement; return the names that they bind."""
    found = imports_of(statement, home, at)
    for bound, target, loads, typing_only in found:
        targets = module.imports.setdefault(bound, [])
        targets += [target] if target not in targets else []
        if typing_only:
            module.typing.append(bound)
        else:
            module.loads += [name for name in loads if name not in module.loads]
    return [bound for bound, _, _, _ in found]


def _effect(module: Module, index: int, uses: Uses) -> None:
    if any(ref.partition(".")[0] in module.imports or ref.startswith("@") for ref in uses.refs):
        module.effects.append(index)


def _alias(statement: ast.stmt) -> set[str]:
    """Objects to which the names that a statement binds may refer, except definitions."""
    if isinstance(statement, DEFINITIONS):
        return set()
    assigned = scope_of([statement], [], lambda _: ()).assigned
    return {root for values in assigned.values() for value in values for root in roots(value, lambda _: None)}


def _class(statement: ast.stmt) -> dict[str, Any]:
    """Bases and metaclass of a class, and flags for effects on subclass creation and construction."""
    if not isinstance(statement, ast.ClassDef):
        return {}
    bases = [ast.unparse(base) for base in (*statement.bases, *(keyword.value for keyword in statement.keywords))]
    own = {node.name for node in statement.body if isinstance(node, ast.FunctionDef)}
    factory = any(keyword.arg == "default_factory" for node in statement.body if isinstance(node, (ast.Assign, ast.AnnAssign))
                  and isinstance(node.value, ast.Call) for keyword in node.value.keywords)
    return {"kind": "class", "bases": bases, "hook": "__init_subclass__" in own or "type" in bases,
            "builds": factory or any(name.startswith("__") and name not in PASSIVE for name in own)}


def _function(statement: ast.stmt) -> dict[str, Any]:
    """Parameters of a stage of type Any, or without type although the body calls a method of them."""
    if not isinstance(statement, (ast.FunctionDef, ast.AsyncFunctionDef)):
        return {}
    if statement.name != "run":
        return {"kind": "function"}
    arguments = arguments_of(statement.args)
    bare = {arg.arg for arg in arguments if arg.annotation is None}
    called = {node.func.value.id for node in (ast.walk(statement) if bare else ()) if isinstance(node, ast.Call)
              and isinstance(node.func, ast.Attribute) and isinstance(node.func.value, ast.Name)}
    loose = [arg.arg for arg in arguments if arg.annotation and _is_any(arg.annotation)]
    return {"kind": "function", "untyped": [*loose, *sorted(bare & called)]}


def _is_any(hint: ast.expr) -> bool:
    return any((isinstance(node, ast.Name) and node.id == "Any") or (isinstance(node, ast.Attribute) and node.attr == "Any")
               or (isinstance(node, ast.Constant) and isinstance(node.value, str) and "Any" in re.findall(r"\w+", node.value))
               for node in ast.walk(hint))


def _decorators(statement: ast.stmt) -> Iterator[ast.expr]:
    """Decorators of a definition, and of definitions in a class body."""
    if isinstance(statement, DEFINITIONS):
        yield from statement.decorator_list
    if isinstance(statement, ast.ClassDef):
        for inner in statement.body:
            yield from _decorators(inner)


def _harmless(module: Module, entry: str) -> bool:
    """Return True when a change affects only a value that a function of a library or of Python returned."""
    if entry.startswith(ARGUMENT):
        return False
    if entry.startswith("@"):
        return harmless(entry[1:].replace(":", "."))
    plain = entry.partition(".")[0].rstrip("!()")
    if plain in module.imports:
        return all(harmless(target.replace(":", ".") + entry[len(plain):]) for target in module.imports[plain])
    return plain not in module.items and plain in BUILTINS and plain not in ("map", "filter")


def _is_plain(module: Module, ref: str) -> bool:
    """Return True for a reference to a built-in name."""
    name = ref.partition(".")[0]
    return name in BUILTINS and name not in module.items and name not in module.imports


def _literal(module: Module, name: str, value: ast.expr) -> None:
    """Record registries and the declarations that the runner reads."""
    try:
        literal = ast.literal_eval(value)
    except ValueError:
        return
    if LITERALS.fullmatch(name):
        module.literals[name] = _listed(literal)
    if isinstance(literal, dict) and literal and all(
            isinstance(k, str) and isinstance(v, str) and REGISTRY_VALUE.fullmatch(v) for k, v in literal.items()):
        module.registries[name] = literal


def _listed(literal: Any) -> Any:
    """Convert a literal to JSON types."""
    if isinstance(literal, dict):
        return {key: _listed(value) for key, value in literal.items()}
    return [_listed(value) for value in literal] if isinstance(literal, tuple) else literal


def _bound_names(statement: ast.stmt) -> list[str] | None:
    """Names that a plain definition binds; None for a statement with other effects."""
    if isinstance(statement, DEFINITIONS):
        return [statement.name]
    if isinstance(statement, ast.AnnAssign):
        return [statement.target.id] if isinstance(statement.target, ast.Name) else None
    if isinstance(statement, ast.Assign):
        names = [name for target in statement.targets for name in _targets(target)]
        return None if "" in names else names
    return [] if isinstance(statement, ast.Pass) else None


def _targets(target: ast.expr) -> Iterator[str]:
    """Names in the target of an assignment; '' for anything but a name."""
    if isinstance(target, (ast.Tuple, ast.List)):
        for element in target.elts:
            yield from _targets(element)
    elif isinstance(target, ast.Starred):
        yield from _targets(target.value)
    else:
        yield target.id if isinstance(target, ast.Name) else ""


def _mentioned(statement: ast.stmt) -> set[str]:
    """Names in a statement, and names that it defines."""
    names = {node.id for node in ast.walk(statement) if isinstance(node, ast.Name)}
    return names | {node.name for node in ast.walk(statement) if isinstance(node, DEFINITIONS)}


def _is_guard(statement: ast.stmt, *tests: str) -> bool:
    """Return True for `if` statements with one of these tests, such as `TYPE_CHECKING`."""
    return isinstance(statement, ast.If) and not statement.orelse and ast.unparse(statement.test) in tests
