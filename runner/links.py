"""What one statement leads to: items and modules of ours, packages of others; or the reason why that cannot be determined.

A link has a label, which is written in the code, and a target, which lies somewhere. Only labels are part of what a definition is:
a module that moves changes no definition that uses it. Links depend on the code alone, not on parameters, so that all fingerprints
over one `Modules` share them.
"""

from __future__ import annotations

import re
import sys
from collections.abc import Iterable, Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, NamedTuple
from weakref import WeakKeyDictionary

from runner.canonical import digest
from runner.effects import Effects, effects_of
from runner.foreign import FILES, IMPORT, PLAIN, ROOTS, UNSEEN, refusal
from runner.modules import Modules, Snapshot
from runner.resolve import Referent, referents
from runner.source import Module, SourceError, line_of

Target = tuple[str, str]
"""(module, name) of an item; the name is `WHOLE` for the module as a value, `PROGRAM` for one that is started, `LOADABLE` for one
that is loaded by a computed name, '/' and the name of a file for data beside it"""
WHOLE, PROGRAM, LOADABLE = "<module>", "<program>", "<loadable>"
WRITERS = ("pickle", "_pickle", "dill", "cloudpickle", "joblib")
WRITES_NAMES = re.compile(rf"({'|'.join(WRITERS)})\.(dump|dumps|Pickler)")
"""what writes the names of modules into what it makes"""


@dataclass
class Links:
    """Where a statement leads."""

    edges: dict[str, list[tuple[str, Target]]] = field(default_factory=dict)
    """label -> what it stands for, in the order in which it is bound: attributes that follow, and target. A label is a reference as
    it is written, and never says where something lies: 'm.f', '@0.f' of the import in slot 0, '=0' of the string in slot 0"""
    packages: set[str] = field(default_factory=set)
    """top-level names of packages that are neither ours nor Python's"""
    meant: list[list[Any]] = field(default_factory=list)
    """what is known of labels without a target: what a name of another package is called there, what a string says"""
    everywhere: bool = False
    """whether the names of modules may be part of what it makes"""


class Definition(NamedTuple):
    """What the statements of one name are, and where they lead."""

    digest: str
    """of the statements and of the labels of their targets, wherever those lie"""
    targets: tuple[Target, ...]
    loads: tuple[Module, ...]
    """modules of ours that the statements import when they run"""
    packages: set[str]
    everywhere: bool


class Linker:
    """Links and effects of the modules of a project, found once. The modules stay as they were when they were read."""

    def __init__(self, modules: Modules) -> None:
        self._modules = modules
        self._links: dict[tuple[str, int, bool], Links] = {}
        self._definitions: dict[tuple[str, str, tuple[int, ...]], Definition] = {}
        self._effects: dict[str, Effects] = {}
        self._loads: dict[str, list[Module]] = {}
        self._foreign: dict[str, dict[str, list[str]]] = {}

    def links(self, module: Module, index: int) -> Links:
        """Links of one statement; SourceError when it uses what cannot be followed. What a string names is left out where only
        another package gets to see the string.
        """
        by_string = index not in self.effects(module).outside
        key = module.name, index, by_string
        if key not in self._links:
            statement = module.statements[index]
            self._links[key] = _Statement(self._modules, module, statement, self._outside(module), by_string).links()
        return self._links[key]

    def _outside(self, module: Module) -> dict[str, list[str]]:
        """Imported names that come from packages of others only, none of which can reach our code: name -> targets."""
        if module.name not in self._foreign:
            self._foreign[module.name] = {
                name: targets for name, targets in module.imports.items() if name not in module.items
                and all(self._modules.get(root) is None and root not in ROOTS for root in map(_root, targets))}
        return self._foreign[module.name]

    def definition(self, module: Module, name: str, statements: tuple[int, ...]) -> Definition:
        """The statements of one name."""
        key = module.name, name, statements
        if key not in self._definitions:
            self._definitions[key] = self._defined(module, name, statements)
        return self._definitions[key]

    def _defined(self, module: Module, name: str, statements: tuple[int, ...]) -> Definition:
        rows, targets, loads, links = list[Any](), list[Target](), list[Module](), list[Links]()
        for index in statements:
            statement, found = module.statements[index], self.links(module, index)
            edges = [(label, *edge) for label in sorted(found.edges) for edge in found.edges[label]]
            rows.append([statement["digest"], sorted(found.meant), [f"{label}|{rest}" for label, rest, _ in edges]])
            targets += [target for _, _, target in edges]
            loads += self.imported(statement["loads"]) if "loads" in statement else ()
            links.append(found)
        packages = links[0].packages.union(*(found.packages for found in links[1:])) if links else set()
        return Definition(digest("afford-definition", [name, rows]), tuple(targets), tuple(loads), packages,
                          any(found.everywhere for found in links))

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
    by_string: bool
    found: Links = field(default_factory=Links)

    def links(self) -> Links:
        for ref in self.statement.get("hints", ()):
            for place in self._places(ref) if _root(ref) not in self.outside else ():
                self._take(ref, f": {self._label(ref)}", place, counts=False)
        for ref in self.statement.get("getattrs", ()):
            self._getattr(ref)
        for name in sorted({_root(ref) for ref in self.statement["refs"]} & self.outside.keys()):
            self.found.packages |= {_root(target) for target in self.outside[name]} - sys.stdlib_module_names
            self.found.meant.append([name, self.outside[name]])
        for ref in self.statement["refs"]:
            if _root(ref) not in self.outside:
                self._ref(ref)
            elif _root(self.outside[_root(ref)][0]) in WRITERS:
                self._note_writer(ref)
        if "imports" in self.statement:
            self._imports(self.statement["imports"])
        for slot, string in enumerate(self.statement.get("strings", ())):
            self._string(f"={slot}", string)
        if "home" in self.statement:
            self.found.meant.append(["__name__", self.module.name])
        self.found.everywhere |= "everywhere" in self.statement
        return self.found

    def _imports(self, imports: list[str]) -> None:
        """What an import inside the statement binds counts as it is written where it leads to nothing of ours."""
        used = [*self.statement["refs"], *self.statement.get("hints", ()), *self.statement.get("getattrs", ())]
        is_definition = "kind" in self.statement
        for slot, target in enumerate(imports):
            is_ours = self.modules.get(_root(target)) is not None
            reached = is_ours and (not is_definition or any(_is_of(ref, target) for ref in used))
            self.found.meant.append([f"@{slot}", imports.index(target) if reached else target])

    def _string(self, label: str, string: str) -> None:
        stands = [place for place in self._places(f"={string}") if place.item is not None]
        if not stands:
            self.found.meant.append([label, string])
        elif not self.by_string:
            self.found.meant.append([label, string.partition(":")[2]])
        for place in stands if self.by_string else ():
            self._lead(label, place, (place.name, str(place.item)))

    def _label(self, ref: str) -> str:
        """A reference as it is written. What an import inside the statement binds is told by the slots of the import."""
        if not ref.startswith("@"):
            return ref
        slots = [(slot, target) for slot, target in enumerate(self.statement.get("imports", ())) if _is_of(ref, target)]
        return " ".join(f"@{slot}{ref[len(target) + 1:]}" for slot, target in slots) or ref

    def _ref(self, ref: str) -> None:
        if ref.startswith("."):
            if UNSEEN.get(ref[1:]) == PLAIN and "DYNAMIC" in self.module.literals:
                return
            raise self._error(ref, f"{ref[1:]} cannot be followed", UNSEEN.get(ref[1:], PLAIN))
        if ref[:1] == "=" and (ref[1:] in self.statement.get("strings", ()) or not self.by_string):
            return
        label = self._label(ref) if ref[:1] == "@" else ref
        for place in self._places(ref):
            self._take(ref, label, place, counts=True)
            if place.module is None and _root(ref) in self.module.imports:
                self.found.meant.append([ref, place.dotted])

    def _places(self, ref: str) -> Iterator[Referent]:
        return referents(self.modules, self.module, ref)

    def _take(self, ref: str, label: str, place: Referent, *, counts: bool) -> None:
        if place.module is None:
            self._foreign(ref, place, counts=counts)
        elif not place.chain:
            self._whole(ref, label, place, place.module)
        elif place.item is not None:
            self._lead(label, place, (place.name, place.item))
        elif place.chain[0] == "__name__":
            self._program(ref, label, place, place.module)
        elif place.chain[0] == "__file__":
            self._files(ref, label, place, place.module)
        elif place.chain[0] in ("__dict__", "__spec__", "__loader__", "__path__"):
            raise self._error(ref, f"{ref} of a module cannot be followed", PLAIN)

    def _lead(self, label: str, place: Referent, target: Target) -> None:
        stands, edge = self.found.edges.setdefault(label, []), (".".join(place.chain[1:]), target)
        stands += [edge] if edge not in stands else []

    def _whole(self, ref: str, label: str, place: Referent, module: Module) -> None:
        """A module as a value. What a package has beside its own names depends on who imported what before."""
        if module.is_package and _has_modules(Path(module.path)):
            raise self._error(ref, f"the package {module.name!r} is used as a value", "import the module of it that is used")
        self._lead(label, place, (module.name, WHOLE))

    def _program(self, ref: str, label: str, place: Referent, module: Module) -> None:
        """A module by its name: it may be started, and its name may be part of what is made."""
        self._lead(label, place, (module.name, PROGRAM))
        if ref not in self.statement.get("started", ()):
            self.found.meant.append([label, module.name])

    def _files(self, ref: str, label: str, place: Referent, module: Module) -> None:
        if "DATA_FILES" not in module.literals:
            raise self._error(ref, f"{ref} may lead to any file", FILES)
        for name in module.literals["DATA_FILES"]:
            self._lead(f"{label} {name}", place, (module.name, f"/{name}"))

    def _foreign(self, ref: str, place: Referent, *, counts: bool) -> None:
        root = _root(place.name)
        objection = refusal(place.dotted, lambda name: self.modules.get(name) is not None) if root in ROOTS else None
        if objection is not None and not (objection[1] in (IMPORT, PLAIN) and "DYNAMIC" in self.module.literals):
            raise self._error(ref, f"{objection[0]} cannot be followed", objection[1])
        self.found.everywhere |= bool(WRITES_NAMES.match(place.dotted))
        if counts and root not in sys.stdlib_module_names:
            self.found.packages.add(root)

    def _note_writer(self, ref: str) -> None:
        """Whether a name of another package writes the names of modules."""
        name, _, rest = ref.partition(".")
        dotted = (f"{target.replace(':', '.')}.{rest}" for target in self.outside[name])
        self.found.everywhere |= any(map(WRITES_NAMES.match, dotted))

    def _getattr(self, ref: str) -> None:
        label = f"getattr {self._label(ref)}"
        for place in self._places(ref):
            if place.module is not None and not place.chain and "DYNAMIC" not in self.module.literals:
                raise self._error(ref, f"getattr({ref.lstrip('@')}, <computed>) on a module cannot be followed",
                                  'name what it may be in DYNAMIC = ("module:attribute", ...)')
            self._take(ref, label, place, counts=True)
            if place.module is None:
                self.found.meant.append([label, place.dotted])

    def _error(self, ref: str, what: str, instead: str) -> SourceError:
        return refused(self.module, self.statement, ref, what, instead)


def _is_of(ref: str, target: str) -> bool:
    """Whether a reference is to what an import names, or to an attribute of that."""
    return ref.startswith(f"@{target}") and ref[len(target) + 1:][:1] in ("", ".")
