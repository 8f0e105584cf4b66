"""Which names of the outside does a statement use? Python's scopes, applied to a syntax tree."""

from __future__ import annotations

import ast
from collections.abc import Iterable
from dataclasses import dataclass, field

FUNCTIONS = (ast.FunctionDef, ast.AsyncFunctionDef, ast.Lambda)
COMPREHENSIONS = (ast.ListComp, ast.SetComp, ast.DictComp, ast.GeneratorExp)


class StarImportError(ValueError):
    """`from x import *` hides what is used."""


@dataclass
class Uses:
    """References of a statement, see runner.source.Module."""

    refs: set[str] = field(default_factory=set)
    hints: set[str] = field(default_factory=set)
    getattrs: set[str] = field(default_factory=set)


def uses_of(statement: ast.stmt, home: str, where: str) -> Uses:
    """Everything that a statement refers to outside itself. `home` is the package that relative imports start from."""
    visitor = _Visitor(home, where)
    visitor.visit(statement)
    return visitor.uses


def imports_of(statement: ast.stmt, home: str, where: str) -> list[tuple[str, str, bool]]:
    """(bound name, 'module' or 'module:attribute', for type checkers only) of the imports that run with the module."""
    found: list[tuple[str, str, bool]] = []
    if isinstance(statement, (ast.Import, ast.ImportFrom)):
        found += [(bound, target, False) for bound, target in _import(statement, home, where)]
    elif not isinstance(statement, (*FUNCTIONS, ast.ClassDef)):
        typing_only = isinstance(statement, ast.If) and "TYPE_CHECKING" in ast.unparse(statement.test)
        for child in ast.iter_child_nodes(statement):
            if isinstance(child, (ast.stmt, ast.ExceptHandler)):
                found += [(b, t, typing_only or only) for b, t, only in imports_of(child, home, where)]  # type: ignore[arg-type]
    return found


def _import(node: ast.Import | ast.ImportFrom, home: str, where: str) -> list[tuple[str, str]]:
    if isinstance(node, ast.Import):
        return [(a.asname, a.name) if a.asname else (a.name.partition(".")[0], a.name.partition(".")[0]) for a in node.names]
    base = node.module or ""
    if node.level:
        parts = home.split(".")
        base = ".".join([*parts[: len(parts) - node.level + 1], *([base] if base else [])])
    if any(alias.name == "*" for alias in node.names):
        raise StarImportError(f"{where}: 'from {base} import *' hides what is used; name what you need")
    return [(alias.asname or alias.name, f"{base}:{alias.name}") for alias in node.names]


class _Scope(dict[str, str | None]):
    """Local names: None, or what an import inside the function binds them to."""

    def __init__(self, names: Iterable[str], is_class: bool = False) -> None:
        super().__init__(dict.fromkeys(names))
        self.is_class = is_class


class _Visitor(ast.NodeVisitor):
    def __init__(self, home: str, where: str) -> None:
        self.home, self.where, self.uses = home, where, Uses()
        self.scopes: list[_Scope] = []
        self.target = self.uses.refs

    def use(self, name: str, chain: list[str]) -> None:
        for depth, scope in enumerate(reversed(self.scopes)):
            if name in scope and not (scope.is_class and depth):
                if scope[name] is not None:
                    self.target.add(".".join([f"@{scope[name]}", *chain]))
                return
        self.target.add(".".join([name, *chain]))

    def visit_Name(self, node: ast.Name) -> None:
        self.use(node.id, [])

    def visit_Attribute(self, node: ast.Attribute) -> None:
        chain: list[str] = []
        at: ast.expr = node
        while isinstance(at, ast.Attribute):
            chain.insert(0, at.attr)
            at = at.value
        if isinstance(at, ast.Name):
            self.use(at.id, chain)
        else:
            self.visit(at)

    def visit_Call(self, node: ast.Call) -> None:
        plain = isinstance(node.func, ast.Name) and node.func.id == "getattr" and len(node.args) > 1
        if not (plain and isinstance(node.args[0], ast.Name)):
            self.generic_visit(node)
            return
        self._getattr(node.args[0].id, node.args[1])
        for rest in node.args[1:]:
            self.visit(rest)

    def _getattr(self, name: str, attribute: ast.expr) -> None:
        if isinstance(attribute, ast.Constant) and isinstance(attribute.value, str):
            self.use(name, [attribute.value])
            return
        target, self.target = self.target, self.uses.getattrs
        self.use(name, [])
        self.target = target

    def visit_FunctionDef(self, node: ast.FunctionDef | ast.AsyncFunctionDef) -> None:
        for outside in (*node.decorator_list, *_defaults(node.args)):
            self.visit(outside)
        for hint in (*(arg.annotation for arg in _args(node.args)), node.returns):
            self._hint(hint)
        self._inside(node.body, [arg.arg for arg in _args(node.args)])

    visit_AsyncFunctionDef = visit_FunctionDef  # noqa: N815 (ast.NodeVisitor's names)

    def visit_Lambda(self, node: ast.Lambda) -> None:
        for default in _defaults(node.args):
            self.visit(default)
        self._inside([node.body], [arg.arg for arg in _args(node.args)])

    def visit_ClassDef(self, node: ast.ClassDef) -> None:
        for outside in (*node.decorator_list, *node.bases, *node.keywords):
            self.visit(outside)
        self._inside(node.body, [], is_class=True)

    def visit_AnnAssign(self, node: ast.AnnAssign) -> None:
        self._hint(node.annotation)
        self.visit(node.target)
        if node.value:
            self.visit(node.value)

    def visit_Import(self, node: ast.Import | ast.ImportFrom) -> None:
        for bound, target in _import(node, self.home, self.where):
            if self.scopes:
                self.scopes[-1][bound] = target

    visit_ImportFrom = visit_Import  # noqa: N815

    def _comprehension(self, node: ast.ListComp | ast.SetComp | ast.GeneratorExp | ast.DictComp) -> None:
        self.visit(node.generators[0].iter)
        self.scopes.append(_Scope(name for generator in node.generators for name in _stored(generator.target)))
        for i, generator in enumerate(node.generators):
            for part in (*generator.ifs, *([generator.iter] if i else [])):
                self.visit(part)
        for part in (node.key, node.value) if isinstance(node, ast.DictComp) else (node.elt,):
            self.visit(part)
        self.scopes.pop()

    visit_ListComp = visit_SetComp = visit_GeneratorExp = visit_DictComp = _comprehension  # noqa: N815

    def _inside(self, body: list[ast.stmt] | list[ast.expr], arguments: list[str], is_class: bool = False) -> None:
        scope = _Scope(arguments, is_class)
        outer: set[str] = set()
        for statement in body:
            _bind(statement, scope, outer)
        for name in outer:
            scope.pop(name, None)
        self.scopes.append(scope)
        for node in _local_imports(body):
            self.visit(node)
        for statement in body:
            self.visit(statement)
        self.scopes.pop()

    def _hint(self, node: ast.expr | None) -> None:
        if node is None:
            return
        target, self.target = self.target, self.uses.hints
        for part in ast.walk(node):
            if isinstance(part, ast.Constant) and isinstance(part.value, str):
                self._quoted(part.value)
        self.visit(node)
        self.target = target

    def _quoted(self, text: str) -> None:
        try:
            self.visit(ast.parse(text, mode="eval").body)
        except SyntaxError:
            return  # a literal string in an annotation, not a type


def _args(args: ast.arguments) -> list[ast.arg]:
    return [*args.posonlyargs, *args.args, *args.kwonlyargs, *(arg for arg in (args.vararg, args.kwarg) if arg)]


def _defaults(args: ast.arguments) -> list[ast.expr]:
    return [*args.defaults, *(default for default in args.kw_defaults if default)]


def _stored(node: ast.AST) -> list[str]:
    return [part.id for part in ast.walk(node) if isinstance(part, ast.Name) and isinstance(part.ctx, (ast.Store, ast.Del))]


def _local_imports(body: Iterable[ast.AST]) -> Iterable[ast.Import | ast.ImportFrom]:
    """Imports of one scope, which hold for all of it wherever they stand."""
    for node in body:
        if isinstance(node, (ast.Import, ast.ImportFrom)):
            yield node
        elif not isinstance(node, (*FUNCTIONS, ast.ClassDef)):
            yield from _local_imports(ast.iter_child_nodes(node))


def _bind(node: ast.AST, scope: _Scope, outer: set[str]) -> None:
    """Names that a statement binds in its own scope; `global` and `nonlocal` ones apart."""
    if isinstance(node, (ast.FunctionDef, ast.AsyncFunctionDef, ast.ClassDef)):
        scope[node.name] = None
        return
    if isinstance(node, (ast.Global, ast.Nonlocal)):
        outer.update(node.names)
    elif isinstance(node, ast.Name) and isinstance(node.ctx, (ast.Store, ast.Del)):
        scope[node.id] = None
    elif isinstance(node, (ast.ExceptHandler, ast.MatchAs, ast.MatchStar)) and node.name:
        scope[node.name] = None
    elif isinstance(node, ast.MatchMapping) and node.rest:
        scope[node.rest] = None
    elif isinstance(node, ast.Lambda):
        return
    elif isinstance(node, COMPREHENSIONS):
        for part in ast.walk(node):
            if isinstance(part, ast.NamedExpr):
                scope[part.target.id] = None
        return
    for child in ast.iter_child_nodes(node):
        _bind(child, scope, outer)
