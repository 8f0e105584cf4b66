"""What one statement leads to: items and modules of ours, packages of others; or the reason why that cannot be determined.

Links depend on the code alone, not on parameters, so that all fingerprints over one `Modules` share them.
"""

from __future__ import annotations

import sys
from collections.abc import Iterable, Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any
from weakref import WeakKeyDictionary

from runner.canonical import digest
from runner.effects import Effects, effects_of
from runner.foreign import FILES, IMPORT, PLAIN, ROOTS, UNSEEN, refusal
from runner.modules import Modules, Snapshot
from runner.resolve import Place, places
from runner.source import Module, SourceError, line_of


@dataclass
class Links:
    """Where a statement leads."""

    items: set[tuple[str, str]] = field(default_factory=set)
    """(module, name)"""
    named: set[tuple[str, str]] = field(default_factory=set)
    """(module, name) of what a string names"""
    whole: set[str] = field(default_factory=set)
    """modules that are used as values"""
    programs: set[str] = field(default_factory=set)
    """modules that are used by their name"""
    packages: set[str] = field(default_factory=set)
    """top-level names of packages that are neither ours nor Python's"""
    meant: set[str] = field(default_factory=set)
    """'name = package.function' of every imported name"""


class Linker:
    """Links and effects of the modules of a project, found once. The modules stay as they were when they were read."""

    def __init__(self, modules: Modules) -> None:
        self._modules = modules
        self._links: dict[tuple[str, int], Links] = {}
        self._digests: dict[tuple[str, tuple[int, ...]], str] = {}
        self._effects: dict[str, Effects] = {}
        self._loads: dict[str, list[Module]] = {}
        self._foreign: dict[str, dict[str, list[str]]] = {}

    def links(self, module: Module, index: int) -> Links:
        """Links of one statement; SourceError when it uses what cannot be followed."""
        key = module.name, index
        if key not in self._links:
            self._links[key] = _Statement(self._modules, module, module.statements[index], self._outside(module)).links()
        return self._links[key]

    def _outside(self, module: Module) -> dict[str, list[str]]:
        """Imported names that come from packages of others only, none of which can reach our code: name -> targets."""
        if module.name not in self._foreign:
            self._foreign[module.name] = {
                name: targets for name, targets in module.imports.items() if name not in module.items
                and all(self._modules.get(root) is None and root not in ROOTS for root in map(_root, targets))}
        return self._foreign[module.name]

    def definition(self, module: Module, statements: tuple[int, ...]) -> str:
        """Digest of the statements of one name: what they are, and what the names that they import stand for."""
        key = module.name, statements
        if key not in self._digests:
            meant = sorted({link for index in statements for link in self.links(module, index).meant})
            self._digests[key] = digest("afford-definition", [[module.statements[index]["digest"] for index in statements], meant])
        return self._digests[key]

    def effects(self, module: Module) -> Effects:
        """See `runner.effects`."""
        if module.name not in self._effects:
            self._effects[module.name] = effects_of(self._modules, module)
        return self._effects[module.name]

    def loads(self, module: Module) -> list[Module]:
        """Modules of ours that run when this one is imported: its packages, and what it imports with theirs."""
        if module.name not in self._loads:
            self._loads[module.name] = self.imported((module.name, *module.loads))
        return self._loads[module.name]

    def imported(self, names: Iterable[str]) -> list[Module]:
        """Modules of ours among dotted names, each after its packages."""
        parts = [name.split(".") for name in names]
        found = dict.fromkeys(".".join(name[:count]) for name in parts for count in range(1, len(name) + 1))
        return [module for module in map(self._modules.get, found) if module is not None]


def _has_modules(package: Path) -> bool:
    folder = package.parent if package.suffix == ".py" else package
    return any(path.name != "__init__.py" for path in (*folder.glob("*.py"), *folder.glob("*/__init__.py")))


def _root(name: str) -> str:
    return name.partition(":")[0].partition(".")[0]


_linkers: WeakKeyDictionary[Snapshot, Linker] = WeakKeyDictionary()


def linker_of(modules: Modules) -> Linker:
    """The one linker of these modules as they are now."""
    if modules.snapshot not in _linkers:
        _linkers[modules.snapshot] = Linker(modules)
    return _linkers[modules.snapshot]


def refused(module: Module, statement: dict[str, Any], ref: str, what: str, instead: str) -> SourceError:
    """The error for a reference, with its line."""
    return SourceError(f"{module.path}:{line_of(module, statement, ref)}: {what}; {instead}")


@dataclass
class _Statement:
    modules: Modules
    module: Module
    statement: dict[str, Any]
    outside: dict[str, list[str]]
    found: Links = field(default_factory=Links)

    def links(self) -> Links:
        for ref in self.statement.get("hints", ()):
            for place in self._places(ref) if _root(ref) not in self.outside else ():
                self._take(ref, place, counts=False)
        for ref in self.statement.get("getattrs", ()):
            self._getattr(ref)
        for name in {_root(ref) for ref in self.statement["refs"]} & self.outside.keys():
            self.found.packages |= {_root(target) for target in self.outside[name]} - sys.stdlib_module_names
            self.found.meant |= {f"{name} = {target}" for target in self.outside[name]}
        for ref in self.statement["refs"]:
            if _root(ref) not in self.outside:
                self._ref(ref)
        return self.found

    def _ref(self, ref: str) -> None:
        if ref.startswith("."):
            if UNSEEN.get(ref[1:]) == PLAIN and "DYNAMIC" in self.module.literals:
                return
            raise self._error(ref, f"{ref[1:]} cannot be followed", UNSEEN.get(ref[1:], PLAIN))
        for place in self._places(ref):
            self._take(ref, place, counts=True)
            if _root(ref) in self.module.imports:
                self.found.meant.add(f"{ref} = {place.name}:{place.item}" if place.module else f"{ref} = {place.dotted}")

    def _places(self, ref: str) -> Iterator[Place]:
        return places(self.modules, self.module, ref)

    def _take(self, ref: str, place: Place, *, counts: bool) -> None:
        if place.module is None:
            self._foreign(ref, place, counts=counts)
        elif not place.chain:
            self._whole(ref, place.module)
        elif place.item is not None:
            (self.found.named if ref.startswith("=") else self.found.items).add((place.name, place.item))
        elif place.chain[0] == "__name__":
            self.found.programs.add(place.name)
        elif place.chain[0] == "__file__" and "DATA_FILES" not in place.module.literals:
            raise self._error(ref, f"{ref} may lead to any file", FILES)
        elif place.chain[0] in ("__dict__", "__spec__", "__loader__", "__path__"):
            raise self._error(ref, f"{ref} of a module cannot be followed", PLAIN)

    def _whole(self, ref: str, module: Module) -> None:
        """A module as a value. What a package has beside its own names depends on who imported what before."""
        if module.is_package and _has_modules(Path(module.path)):
            raise self._error(ref, f"the package {module.name!r} is used as a value", "import the module of it that is used")
        self.found.whole.add(module.name)

    def _foreign(self, ref: str, place: Place, *, counts: bool) -> None:
        root = _root(place.name)
        objection = refusal(place.dotted, lambda name: self.modules.get(name) is not None) if root in ROOTS else None
        if objection is not None and not (objection[1] in (IMPORT, PLAIN) and "DYNAMIC" in self.module.literals):
            raise self._error(ref, f"{objection[0]} cannot be followed", objection[1])
        if counts and root not in sys.stdlib_module_names:
            self.found.packages.add(root)

    def _getattr(self, ref: str) -> None:
        for place in self._places(ref):
            if place.module is not None and not place.chain and "DYNAMIC" not in self.module.literals:
                raise self._error(ref, f"getattr({ref.lstrip('@')}, <computed>) on a module cannot be followed",
                                  'name what it may be in DYNAMIC = ("module:attribute", ...)')
            self._take(ref, place, counts=True)

    def _error(self, ref: str, what: str, instead: str) -> SourceError:
        return refused(self.module, self.statement, ref, what, instead)
