"""Which objects of the outside may stand behind an expression? What is done to the expression is done to them.

A root is 'name.attribute...' of the module or '@module:name' of an import, '(argument)' for a parameter of the function, and
ends in '!' for what a call returned. A local variable stands for all that it is ever assigned; a new object has no root.
"""

from __future__ import annotations

import ast
from collections.abc import Callable, Iterator

from runner.scopes import Scope

ARGUMENT = "(argument)"
CALLED = "(argument)()"
"""a parameter that the function calls"""
PASSES = frozenset(("getattr", "next", "iter", "reversed", "zip", "enumerate", "map", "filter", "vars"))
"""functions of Python that return what they are given, or parts of it"""
PARTS = frozenset(("get", "setdefault", "values", "items", "pop", "popitem", "__getitem__"))
"""methods of containers that return what is in them"""
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
"""methods of Python's and numpy's values that change nothing"""
Find = Callable[[str], Scope | None]


def roots(node: ast.expr, find: Find, seen: frozenset[str] = frozenset()) -> Iterator[str]:
    """Roots of an expression. `find` gives the scope of a local name, None for a name of the module or of Python."""
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
    if name in scope.given:
        yield ARGUMENT
    for value in scope.stands.get(name, ()) if name not in seen else ():
        if not (scope.is_class and value.lineno > node.lineno):  # the body of a class runs once, from top to bottom
            yield from roots(value, find, seen | {name})


def _call(node: ast.Call, find: Find, seen: frozenset[str]) -> Iterator[str]:
    if isinstance(node.func, ast.Name) and node.func.id in PASSES and find(node.func.id) is None:
        for argument in node.args:
            yield from roots(argument, find, seen)
    elif isinstance(node.func, ast.Attribute) and node.func.attr in PARTS:
        yield from roots(node.func.value, find, seen)
    else:
        yield from (root if root.endswith("!") else f"{root}!" for root in roots(node.func, find, seen))
