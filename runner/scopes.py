"""Local names of functions, classes and comprehensions, and the outside objects that an expression may refer to.

A change of an expression changes its roots. A root is 'name.attribute...' of the module, '@module:name' of an import, or
'(argument)' for a parameter of the function; it ends in '!' for a returned object. A local variable has the roots of all values
assigned to it. A new object has no root.
"""

from __future__ import annotations

import ast
from collections.abc import Callable, Iterable, Iterator

FUNCTIONS = (ast.FunctionDef, ast.AsyncFunctionDef, ast.Lambda)
DEFINITIONS = (ast.FunctionDef, ast.AsyncFunctionDef, ast.ClassDef)
COMPREHENSIONS = (ast.ListComp, ast.SetComp, ast.DictComp, ast.GeneratorExp)
Imports = Callable[[ast.Import | ast.ImportFrom], Iterable[tuple[str, str]]]


class Scope(dict[str, list[str]]):
    """Local names, each with the imports that bind it inside the scope; an empty list for a plain variable."""

    def __init__(self, names: Iterable[str] = (), *, is_class: bool = False) -> None:
        super().__init__((name, []) for name in names)
        self.is_class = is_class
        self.parameters: frozenset[str] = frozenset()
        """parameters, except `self` and `cls`"""
        self.assigned: dict[str, list[ast.expr]] = {}
        """name -> the expressions that are assigned to it, or whose elements it takes"""

    def bind(self, target: ast.expr, value: ast.expr) -> None:
        """Record that every name in the target of an assignment may refer to `value` or a part of it."""
        for name in stored(target):
            self.setdefault(name, [])
            self.assigned.setdefault(name, []).append(value)


def scope_of(body: Iterable[ast.AST], arguments: list[ast.arg], imports: Imports, *, is_class: bool = False) -> Scope:
    """Scope of a body, without names that it declares `global` or `nonlocal`."""
    scope = Scope((arg.arg for arg in arguments), is_class=is_class)
    scope.parameters = frozenset(arg.arg for arg in arguments if arg.arg not in ("self", "cls"))
    outer: set[str] = set()
    _collect(body, scope, outer, imports)
    for name in outer:
        scope.pop(name, None)
    return scope


def stored(node: ast.AST) -> list[str]:
    """Names that a target binds or deletes."""
    if isinstance(node, ast.Name):
        return [node.id]
    return [part.id for part in ast.walk(node) if isinstance(part, ast.Name) and not isinstance(part.ctx, ast.Load)]


def arguments_of(args: ast.arguments) -> list[ast.arg]:
    """Parameters of a function, of every kind."""
    return [*args.posonlyargs, *args.args, *args.kwonlyargs, *(arg for arg in (args.vararg, args.kwarg) if arg)]


def defaults_of(args: ast.arguments) -> list[ast.expr]:
    """Default values of parameters."""
    return [*args.defaults, *(default for default in args.kw_defaults if default)]


def _collect(nodes: Iterable[ast.AST], scope: Scope, outer: set[str], imports: Imports) -> None:
    for node in nodes:
        if isinstance(node, ast.Name):
            if not isinstance(node.ctx, ast.Load):
                scope.setdefault(node.id, [])
        elif isinstance(node, DEFINITIONS):
            scope.setdefault(node.name, [])
        elif isinstance(node, COMPREHENSIONS):
            _named(node, scope)
        elif not isinstance(node, (ast.Constant, ast.Lambda)):
            _statement(node, scope, outer, imports)
            _collect(_children(node), scope, outer, imports)


def _statement(node: ast.AST, scope: Scope, outer: set[str], imports: Imports) -> None:
    """Record the names that one node binds by itself, apart from names inside it."""
    if isinstance(node, ast.Assign):
        for target in node.targets:
            scope.bind(target, node.value)
    elif isinstance(node, (ast.For, ast.AsyncFor)):
        scope.bind(node.target, node.iter)
    elif isinstance(node, (ast.AnnAssign, ast.NamedExpr)):
        if node.value is not None and isinstance(node.target, ast.Name):
            scope.bind(node.target, node.value)
    elif isinstance(node, ast.withitem):
        if node.optional_vars is not None:
            scope.bind(node.optional_vars, node.context_expr)
    elif isinstance(node, (ast.Import, ast.ImportFrom)):
        for name, origin in imports(node):
            scope.setdefault(name, []).append(origin)
    elif isinstance(node, (ast.Global, ast.Nonlocal)):
        outer.update(node.names)
    elif isinstance(node, (ast.ExceptHandler, ast.MatchAs, ast.MatchStar, ast.MatchMapping)):
        bound = node.rest if isinstance(node, ast.MatchMapping) else node.name
        if bound:
            scope.setdefault(bound, [])


def _named(comprehension: ast.AST, scope: Scope) -> None:
    """Bind the names of `:=` in a comprehension, which belong to the enclosing scope."""
    for part in ast.walk(comprehension):
        if isinstance(part, ast.NamedExpr):
            scope.bind(part.target, part.value)


def _children(node: ast.AST) -> Iterator[ast.AST]:
    for name in node._fields:
        value = getattr(node, name, None)
        if isinstance(value, ast.AST):
            yield value
        elif isinstance(value, list):
            yield from (item for item in value if isinstance(item, ast.AST))


ARGUMENT = "(argument)"
CALLED = "(argument)()"
"""a parameter that the function calls"""
PASSES = frozenset(("getattr", "next", "iter", "reversed", "zip", "enumerate", "map", "filter", "vars"))
"""built-in functions that return their arguments, or parts of them"""
PARTS = frozenset(("get", "setdefault", "values", "items", "pop", "popitem", "__getitem__"))
"""methods of containers that return elements"""
READS = frozenset((
    "__iadd__", "absolute", "all", "any", "argmax", "argmin", "argsort", "as_posix", "astype", "capitalize", "casefold", "center",
    "copy", "count", "cumsum", "decode", "difference", "dot", "encode", "endswith", "exists", "expandvars", "extract", "find",
    "findall", "finditer", "flatten", "format", "format_map", "from_bytes", "fullmatch", "get", "glob", "group", "groups", "hex",
    "index", "intersection", "is_dir", "is_file", "isalnum", "isalpha", "isascii", "isdigit", "isdisjoint", "isidentifier",
    "islower", "isnumeric", "isoformat", "isspace", "issubset", "issuperset", "istitle", "isupper", "item", "items", "iterdir",
    "join", "joinpath", "keys", "ljust", "lower", "lstrip", "maketrans", "match", "max", "mean", "min", "partition", "prod",
    "ravel", "read_bytes", "read_text", "relative_to", "removeprefix", "removesuffix", "repeat", "replace", "reshape", "resolve",
    "rfind", "rglob", "rindex", "rjust", "round", "rpartition", "rsplit", "rstrip", "search", "split", "splitlines", "squeeze",
    "startswith", "std", "strip", "sub", "sum", "swapaxes", "swapcase", "title", "to_bytes", "tobytes", "tolist", "total_seconds",
    "trace", "translate", "transpose", "union", "upper", "values", "var", "view", "with_name", "with_suffix", "zfill"))
"""methods of Python and numpy objects without side effects"""
Find = Callable[[str], Scope | None]


def roots(node: ast.expr, find: Find, seen: frozenset[str] = frozenset()) -> Iterator[str]:
    """Yield the roots of an expression.

    `find` returns the scope of a local name, None for a name of the module or of Python.
    """
    if isinstance(node, ast.Name):
        yield from _name(node, find, seen)
    elif isinstance(node, ast.Attribute):
        for root in roots(node.value, find, seen):
            yield root if root == ARGUMENT or root.endswith("!") else f"{root}.{node.attr}"
    elif isinstance(node, (ast.Subscript, ast.Starred, ast.Await, ast.NamedExpr)):
        yield from roots(node.value, find, seen)
    elif isinstance(node, ast.Call):
        yield from _call(node, find, seen)
    else:
        for part in _parts(node):
            yield from roots(part, find, seen)


def _parts(node: ast.expr) -> list[ast.expr]:
    if isinstance(node, ast.IfExp):
        return [node.body, node.orelse]
    if isinstance(node, (ast.BoolOp, ast.Dict)):
        return node.values
    return node.elts if isinstance(node, (ast.Tuple, ast.List, ast.Set)) else []


def _name(node: ast.Name, find: Find, seen: frozenset[str]) -> Iterator[str]:
    name, scope = node.id, find(node.id)
    if scope is None or scope.is_class:
        yield name
    if scope is None:
        return
    yield from (f"@{target}" for target in scope[name])
    if name in scope.parameters:
        yield ARGUMENT
    for value in scope.assigned.get(name, ()) if name not in seen else ():
        if not (scope.is_class and value.lineno > node.lineno):  # a class body runs once, from top to bottom
            yield from roots(value, find, seen | {name})


def _call(node: ast.Call, find: Find, seen: frozenset[str]) -> Iterator[str]:
    if isinstance(node.func, ast.Name) and node.func.id in PASSES and find(node.func.id) is None:
        for argument in node.args:
            yield from roots(argument, find, seen)
    elif isinstance(node.func, ast.Attribute) and node.func.attr in PARTS:
        yield from roots(node.func.value, find, seen)
    else:
        yield from (root if root.endswith("!") else f"{root}!" for root in roots(node.func, find, seen))
