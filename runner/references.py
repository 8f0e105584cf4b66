"""Resolve a reference through the imports of project modules, to a definition in the project or a name outside it."""

from __future__ import annotations

from collections.abc import Iterator
from typing import NamedTuple

from runner.modules import Modules
from runner.source import Module, SourceError, import_of


class Referent(NamedTuple):
    """Object that a reference refers to: a definition, a whole module, or a name outside the project.

    A definition is an item of a project module, whose name begins `chain`. A whole project module has an empty `chain`. A name
    of another package, or of Python's `builtins`, has no `module`.
    """

    module: Module | None
    name: str
    """name of the module, in the project or outside"""
    chain: tuple[str, ...]

    @property
    def item(self) -> str | None:
        """Name of the project definition, if the referent is one."""
        return self.chain[0] if self.module is not None and self.chain and self.chain[0] in self.module.items else None

    @property
    def dotted(self) -> str:
        """Dotted name: 'package.name.attribute'."""
        return ".".join((self.name, *self.chain))


def referents(modules: Modules, module: Module, ref: str) -> Iterator[Referent]:
    """Yield everything that a reference of a module may refer to.

    SourceError for a missing module of the project.
    """
    if ref.startswith("="):
        yield from _named(modules, ref[1:])
    elif ref.startswith("@"):
        target, _, rest = ref[1:].partition(":")
        yield from _through(modules, module, *_split(modules, target, rest.split(".") if rest else [], ":" in ref), frozenset())
    else:
        name, *chain = ref.split(".")
        if name in module.items or name in ("__file__", "__path__", "__spec__", "__loader__", "__dict__"):
            yield Referent(module, module.name, (name, *chain))
        for target in module.imports.get(name, ()):
            yield from _imported(modules, module, target, chain, frozenset())
        if name not in module.items and name not in module.imports:
            yield Referent(None, "builtins", (name, *chain))


def _named(modules: Modules, entry: str) -> Iterator[Referent]:
    """Resolve a string that may name project code, 'module:attribute'."""
    target, _, attribute = entry.partition(":")
    found = modules.get(target)
    if found is not None and (attribute in found.items or attribute in found.imports):
        yield from _through(modules, found, target, [attribute], frozenset())


def _split(modules: Modules, target: str, chain: list[str], has_attribute: bool) -> tuple[str, list[str]]:
    """Split '@a.b.c' of a plain import into the longest module and the attributes."""
    if has_attribute:
        attribute, *rest = chain
        return target, [attribute, *rest]
    if modules.get(target.partition(".")[0]) is None:
        return target, chain
    parts = target.split(".")
    while len(parts) > 1 and modules.get(".".join(parts)) is None:
        chain.insert(0, parts.pop())
    return ".".join(parts), chain


def _imported(modules: Modules, origin: Module, target: str, chain: list[str], seen: frozenset[str]) -> Iterator[Referent]:
    name, colon, attribute = target.partition(":")
    yield from _through(modules, origin, name, [attribute, *chain] if colon else chain, seen)


def _through(modules: Modules, origin: Module, target: str, chain: list[str], seen: frozenset[str]) -> Iterator[Referent]:
    """Resolve a `chain` of attributes, starting at the module `target`."""
    found = modules.get(target)
    if found is None:
        if modules.get(target.partition(".")[0]) is not None:
            raise SourceError(f"{import_of(origin, target)}: the import of {target!r} names no module of this project; correct "
                              "the name, or remove the import")
        yield Referent(None, target, tuple(chain))
    elif not chain or chain[0] in found.items or (chain[0].startswith("__") and chain[0].endswith("__")):
        yield Referent(found, target, tuple(chain))
    if found is None or not chain:
        return
    name, rest, key = chain[0], chain[1:], f"{target}:{chain[0]}"
    passed = found.imports.get(name, []) if key not in seen else []
    for other in passed:
        yield from _imported(modules, found, other, rest, seen | {key})
    if not passed and found.is_package and modules.get(f"{target}.{name}") is not None:
        yield from _through(modules, found, f"{target}.{name}", rest, seen)
    elif not passed and name not in found.items and "__getattr__" in found.items:
        yield Referent(found, target, ())
