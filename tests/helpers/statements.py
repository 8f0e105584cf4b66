"""Statements of a source file at every depth, without a walk through their expressions, which hold none."""

from __future__ import annotations

import ast
from collections.abc import Iterator

LISTS = ("body", "orelse", "finalbody", "handlers", "cases")
"""fields of statements, and of the branches of `try` and `match`, that hold statements"""


def statements(node: ast.AST) -> Iterator[ast.AST]:
    """The node itself, and all statements and branches below it."""
    yield node
    for name in LISTS:
        for below in getattr(node, name, ()):
            yield from statements(below)
