"""Names outside a statement that it uses, and outside objects that it changes, by Python's scoping rules.

References are 'name.attribute...', '@module:name...' for an import inside a function, '=module:name' for a string that names code
(an entry point), and '.attribute' for an attribute, of any object, that no fingerprint can trace (`UNSEEN`).
"""

from __future__ import annotations

import ast
import re
from collections import Counter
from dataclasses import dataclass, field

from runner.scopes import ARGUMENT, CALLED, FUNCTIONS, READS, Scope, arguments_of, defaults_of, roots, scope_of

ENTRY_POINT = re.compile(r"[A-Za-z_][\w.]*:[A-Za-z_]\w*")
UNSEEN = frozenset(("__doc__", "__subclasses__", "__globals__", "__code__", "exec_module", "load_module", "f_globals", "f_locals"))
SETTERS = ("setattr", "delattr", "__setattr__", "__delattr__", "__setitem__", "__delitem__")


class SourceError(ValueError):
    """Code that cannot be followed statically; the message has file, line and advice."""


@dataclass
class Uses:
    """References of a statement, each with the line of its first use; see `runner.source.Module`."""

    refs: dict[str, int] = field(default_factory=dict)
    hints: dict[str, int] = field(default_factory=dict)
    getattrs: dict[str, int] = field(default_factory=dict)
    loads: set[str] = field(default_factory=set)
    sets: dict[str, int] = field(default_factory=dict)
    does: set[str] = field(default_factory=set)
    now: set[str] = field(default_factory=set)
    gives: set[str] = field(default_factory=set)
    names: Counter[str] = field(default_factory=Counter)
    """'module.__name__' -> number of uses"""
    starts: Counter[str] = field(default_factory=Counter)
    """'module.__name__' -> number of uses after `-m` in a command line"""

    def started(self) -> set[str]:
        """'module.__name__' references that are used only to start the module."""
        return {ref for ref, count in self.starts.items() if self.names[ref] == count}


def uses_of(statement: ast.stmt, home: str, where: str) -> Uses:
    """References of a statement to names outside it.

    `home` is the package from which relative imports start.
    """
    visitor = _Visitor(home, where)
    visitor.visit(statement)
    return visitor.uses


def imports_of(statement: ast.stmt, home: str, where: str) -> list[tuple[str, str, list[str], bool]]:
    """Imports that run when the module is imported, also inside `if` and `try`.

    Each is (bound name, 'module' or 'module:attribute', modules that it loads, True for type checkers only).
    """
    found: list[tuple[str, str, list[str], bool]] = []
    if isinstance(statement, (ast.Import, ast.ImportFrom)):
        loads = loads_of(statement, home)
        found += [(bound, target, loads, False) for bound, target in bindings_of(statement, home, where)]
    elif not isinstance(statement, (*FUNCTIONS, ast.ClassDef)):
        typing_only = isinstance(statement, ast.If) and ast.unparse(statement.test) in ("TYPE_CHECKING", "typing.TYPE_CHECKING")
        unseen = {id(child) for child in statement.body} if typing_only else set()  # type: ignore[attr-defined]
        for child in ast.iter_child_nodes(statement):
            if isinstance(child, (ast.stmt, ast.ExceptHandler)):
                found += [(b, t, loads, only or id(child) in unseen)
                          for b, t, loads, only in imports_of(child, home, where)]  # type: ignore[arg-type]  # a handler has a body
    return found


def bindings_of(node: ast.Import | ast.ImportFrom, home: str, where: str) -> list[tuple[str, str]]:
    """(bound name, 'module' or 'module:attribute') for every name of one import."""
    if isinstance(node, ast.Import):
        return [(a.asname, a.name) if a.asname else (a.name.partition(".")[0], a.name.partition(".")[0]) for a in node.names]
    base = _base(node, home)
    if any(alias.name == "*" for alias in node.names):
        raise SourceError(f"{where}: 'from {base} import *' hides the used names; import them by name")
    return [(alias.asname or alias.name, f"{base}:{alias.name}") for alias in node.names]


def loads_of(node: ast.Import | ast.ImportFrom, home: str) -> list[str]:
    """Modules that one import runs: full dotted names, and possible modules inside a package."""
    if isinstance(node, ast.Import):
        return [alias.name for alias in node.names]
    base = _base(node, home)
    return [base, *(f"{base}.{alias.name}" for alias in node.names)]


def _base(node: ast.ImportFrom, home: str) -> str:
    if not node.level:
        return node.module or ""
    parts = home.split(".")
    return ".".join([*parts[: len(parts) - node.level + 1], *([node.module] if node.module else [])])


class _Visitor(ast.NodeVisitor):
    def __init__(self, home: str, where: str) -> None:
        self.home, self.where, self.uses = home, where, Uses()
        self.scopes: list[Scope] = []
        self.inside = 0
        self.target = self.uses.refs

    def find(self, name: str) -> Scope | None:
        """Scope of a local name; None for a name of the module or of Python."""
        for depth, scope in enumerate(reversed(self.scopes)):
            if name in scope and not (scope.is_class and depth):
                return scope
        return None

    def use(self, name: str, chain: list[str], line: int, *, read: bool = True) -> None:
        scope = self.find(name)
        outer = scope is None or (scope.is_class and read)  # in a class body, a name that is not bound yet is the module's
        local = [] if scope is None else [f"@{target}" for target in scope[name]]
        for start in [name, *local] if outer else local:
            ref = ".".join([start, *chain])
            self.target.setdefault(ref, line)
            if chain[-1:] == ["__name__"]:
                self.uses.names[ref] += 1
            if not self.inside:
                self.uses.now.add(ref)

    def change(self, node: ast.expr, suffix: str = "") -> None:
        """Record the change of an object ('ref') or the call of its method ('ref.method()').

        Changes at import and inside functions are recorded separately.
        """
        for root in roots(node, self.find):
            if not self.inside:
                self.uses.sets.setdefault(root + suffix, node.lineno)
            elif root == ARGUMENT and suffix == "()":
                self.uses.does.add(CALLED)
            elif not (root.startswith(ARGUMENT) or root.endswith("!")):
                self.uses.does.add(root + suffix)
            elif suffix[1:-2] not in READS:
                self.uses.does.add(ARGUMENT if root.startswith(ARGUMENT) else root)

    def visit_Return(self, node: ast.Return | ast.Yield | ast.YieldFrom) -> None:
        """Record the roots of a returned value, which the caller may change."""
        if node.value is not None:
            self.uses.gives.update(roots(node.value, self.find))
            self.visit(node.value)

    visit_Yield = visit_YieldFrom = visit_Return  # noqa: N815 (names of ast.NodeVisitor)

    def visit_Constant(self, node: ast.Constant) -> None:
        if isinstance(node.value, str) and ":" in node.value and ENTRY_POINT.fullmatch(node.value):
            self.uses.refs.setdefault(f"={node.value}", node.lineno)

    def visit_Name(self, node: ast.Name) -> None:
        self.use(f".{node.id}" if node.id in UNSEEN else node.id, [], node.lineno, read=isinstance(node.ctx, ast.Load))
        if self.inside and not isinstance(node.ctx, ast.Load) and self.find(node.id) is None:
            self.uses.does.add(node.id)

    def visit_Attribute(self, node: ast.Attribute) -> None:
        if not isinstance(node.ctx, ast.Load):
            self.change(node.value)
        chain: list[str] = []
        at: ast.expr = node
        while isinstance(at, ast.Attribute):
            chain.insert(0, at.attr)
            at = at.value
        for name in UNSEEN.intersection(chain):
            self.uses.refs.setdefault(f".{name}", node.lineno)
        if isinstance(at, ast.Name):
            self.use(at.id, chain, node.lineno)
        else:
            self.visit(at)

    def visit_Subscript(self, node: ast.Subscript) -> None:
        if not isinstance(node.ctx, ast.Load):
            self.change(node.value)
        if not self._loaded(node.value, node.slice):
            self.generic_visit(node)

    def visit_AugAssign(self, node: ast.AugAssign) -> None:
        if isinstance(node.target, ast.Name):
            self.change(node.target, ".__iadd__()")
        self.generic_visit(node)

    def visit_Call(self, node: ast.Call) -> None:
        self._call(node)
        name = node.func.id if isinstance(node.func, ast.Name) else ""
        if name in ("vars", "locals") and not node.args:
            self.uses.refs.setdefault("locals", node.lineno)
        if isinstance(node.func, ast.Attribute) and node.func.attr == "get" and node.args \
                and self._loaded(node.func.value, node.args[0]):
            return
        if not (name == "getattr" and len(node.args) > 1 and self._getattr(node.args[0], node.args[1])):
            self.generic_visit(node)
        else:
            for rest in node.args[1:]:
                self.visit(rest)

    def _call(self, node: ast.Call) -> None:
        """Record the objects that a call may change: the method's object, a setter's argument, effects of the function."""
        func = node.func
        last = func.attr if isinstance(func, ast.Attribute) else func.id if isinstance(func, ast.Name) else ""
        if last in SETTERS and node.args:
            self.change(node.args[0])
        if isinstance(func, ast.Attribute):
            self.change(func.value, f".{func.attr}()")
            if isinstance(func.value, ast.Name) and func.value.id in ("list", "dict", "set") and node.args and last != "fromkeys":
                self.change(node.args[0])
        elif not self.inside or ARGUMENT in roots(func, self.find):
            self.change(func, "()")
        if isinstance(func, ast.Lambda):
            self.uses.sets.setdefault(CALLED, node.lineno)
        for keyword in node.keywords:
            if keyword.arg == "key" and not self.inside:
                self.change(keyword.value, "()")

    def _loaded(self, table: ast.expr, key: ast.expr) -> bool:
        """Record `sys.modules["name"]`: one module by a literal name, harmless for a module outside the project."""
        if not (isinstance(table, ast.Attribute) and table.attr == "modules" and isinstance(table.value, ast.Name)
                and isinstance(key, ast.Constant) and isinstance(key.value, str)):
            return False
        self.use(table.value.id, ["modules", f"[{key.value.partition('.')[0]}]"], key.lineno)
        return True

    def _getattr(self, holder: ast.expr, attribute: ast.expr) -> bool:
        literal = attribute.value if isinstance(attribute, ast.Constant) else None
        if literal in UNSEEN:
            self.uses.refs.setdefault(f".{literal}", attribute.lineno)
        if not isinstance(holder, ast.Name):
            return False
        if isinstance(literal, str):
            self.use(holder.id, [literal], attribute.lineno)
            return True
        target, self.target = self.target, self.uses.getattrs
        self.use(holder.id, [], holder.lineno)
        self.target = target
        return True

    def visit_List(self, node: ast.List | ast.Tuple) -> None:
        """Record the module after `-m` in a command line."""
        for option, name in zip(node.elts, node.elts[1:], strict=False):
            if isinstance(option, ast.Constant) and option.value == "-m" and isinstance(name, ast.Constant):
                self.uses.refs.setdefault(f"={name.value!s}:__main__", name.lineno)
            elif isinstance(option, ast.Constant) and option.value == "-m":
                self._start(name)
        self.generic_visit(node)

    def _start(self, name: ast.expr) -> None:
        """Record `-m module.__name__`, in which the name only selects the module to start."""
        before = self.uses.names.copy()
        self.visit(name)
        self.uses.starts += self.uses.names - before
        self.uses.names = before

    visit_Tuple = visit_List  # noqa: N815

    def visit_FunctionDef(self, node: ast.FunctionDef | ast.AsyncFunctionDef) -> None:
        self._outside(node.decorator_list)
        for default in defaults_of(node.args):
            self.visit(default)
        for hint in (*(arg.annotation for arg in arguments_of(node.args)), node.returns):
            self._hint(hint)
        self._inside(node.body, arguments_of(node.args))

    visit_AsyncFunctionDef = visit_FunctionDef  # noqa: N815

    def visit_Lambda(self, node: ast.Lambda) -> None:
        for default in defaults_of(node.args):
            self.visit(default)
        self._inside([node.body], arguments_of(node.args))

    def visit_ClassDef(self, node: ast.ClassDef) -> None:
        self._outside([*node.decorator_list, *node.bases, *(keyword.value for keyword in node.keywords)])
        self._within(node.body, scope_of(node.body, [], self._bindings, is_class=True))

    def visit_AnnAssign(self, node: ast.AnnAssign) -> None:
        self._hint(node.annotation)
        self.visit(node.target)
        if node.value:
            self.visit(node.value)

    def visit_Import(self, node: ast.Import | ast.ImportFrom) -> None:
        self.uses.loads.update(loads_of(node, self.home))

    visit_ImportFrom = visit_Import  # noqa: N815

    def _comprehension(self, node: ast.ListComp | ast.SetComp | ast.GeneratorExp | ast.DictComp) -> None:
        self.visit(node.generators[0].iter)
        scope = Scope()
        for generator in node.generators:
            scope.bind(generator.target, generator.iter)
        self.scopes.append(scope)
        for i, generator in enumerate(node.generators):
            for part in (*generator.ifs, *([generator.iter] if i else [])):
                self.visit(part)
        for part in (node.key, node.value) if isinstance(node, ast.DictComp) else (node.elt,):
            self.visit(part)
        self.scopes.pop()

    visit_ListComp = visit_SetComp = visit_GeneratorExp = visit_DictComp = _comprehension  # noqa: N815

    def _outside(self, parts: list[ast.expr]) -> None:
        """Visit decorators and base classes as references.

        `Module.decorated` and the bases of a class record their effects.
        """
        sets, now = self.uses.sets, self.uses.now
        self.uses.sets, self.uses.now = {}, set()
        for part in parts:
            self.visit(part)
        self.uses.sets, self.uses.now = sets, now

    def _inside(self, body: list[ast.stmt] | list[ast.expr], arguments: list[ast.arg]) -> None:
        self.inside += 1
        self._within(body, scope_of(body, arguments, self._bindings))
        self.inside -= 1

    def _within(self, body: list[ast.stmt] | list[ast.expr], scope: Scope) -> None:
        self.scopes.append(scope)
        for statement in body:
            self.visit(statement)
        self.scopes.pop()

    def _bindings(self, node: ast.Import | ast.ImportFrom) -> list[tuple[str, str]]:
        return bindings_of(node, self.home, f"{self.where.rpartition(':')[0]}:{node.lineno}")

    def _hint(self, node: ast.expr | None) -> None:
        if node is None:
            return
        target, self.target = self.target, self.uses.hints
        for part in ast.walk(node):
            if isinstance(part, ast.Constant) and isinstance(part.value, str):
                self._quoted(part.value)
        self._outside([node])
        self.target = target

    def _quoted(self, text: str) -> None:
        try:
            self.visit(ast.parse(text, mode="eval").body)
        except SyntaxError:
            return  # a string in an annotation that is not a type
