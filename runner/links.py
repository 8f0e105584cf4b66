"""Resolve the references of one statement to project definitions, project modules and other packages.

A link has a label, which is written in the code, and a target, which has a location. Only labels are part of a definition's digest,
so moving a module changes no definition that uses it. Links depend on the code alone, not on parameters, and all fingerprints over
one `Modules` share them. A reference that cannot be traced is an error.
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
from runner.external import FILES, IMPORT, PLAIN, ROOTS, UNSEEN, refusal
from runner.modules import Modules, Snapshot
from runner.references import Referent, referents
from runner.source import Module, SourceError, line_of

Target = tuple[str, str]
"""(module, name) of an item. The name is `WHOLE` for the module as a value, `PROGRAM` for a started module, `LOADABLE` for a module
that is loaded by a computed name, and '/' plus a file name for data beside the module"""
WHOLE, PROGRAM, LOADABLE = "<module>", "<program>", "<loadable>"
WRITERS = ("pickle", "_pickle", "dill", "cloudpickle", "joblib")
WRITES_NAMES = re.compile(rf"({'|'.join(WRITERS)})\.(dump|dumps|Pickler)")
"""functions that write module names into their output"""


@dataclass
class Links:
    """Targets of the references of a statement."""

    edges: dict[str, list[tuple[str, Target]]] = field(default_factory=dict)
    """label -> (following attributes, target) pairs, in the order of binding. A label is a reference as written, without location:
    'm.f', '@0.f' for the import in slot 0, '=0' for the string in slot 0"""
    packages: set[str] = field(default_factory=set)
    """top-level names of third-party packages"""
    facts: list[list[Any]] = field(default_factory=list)
    """values of labels without target: the full name in another package, the text of a string"""
    any_module_name: bool = False
    """True if module names may be part of the output"""


class Definition(NamedTuple):
    """Statements of one name, and the targets of their references."""

    digest: str
    """digest of the statements and of the labels of their targets, without locations"""
    targets: tuple[Target, ...]
    loads: tuple[Module, ...]
    """project modules that the statements import when they run"""
    packages: set[str]
    any_module_name: bool


class Linker:
    """Links and effects of the modules of a project, each computed once.

    The modules stay as they were at the first read.
    """

    def __init__(self, modules: Modules) -> None:
        self._modules = modules
        self._links: dict[tuple[str, int, bool], Links] = {}
        self._definitions: dict[tuple[str, str, tuple[int, ...]], Definition] = {}
        self._effects: dict[str, Effects] = {}
        self._loads: dict[str, list[Module]] = {}
        self._external: dict[str, dict[str, list[str]]] = {}

    def links(self, module: Module, index: int) -> Links:
        """Links of one statement; SourceError for a reference that cannot be followed.

        The target of a string is omitted if only another package receives the string.
        """
        by_string = index not in self.effects(module).outside
        key = module.name, index, by_string
        if key not in self._links:
            statement = module.statements[index]
            self._links[key] = _Statement(self._modules, module, statement, self._outside(module), by_string).links()
        return self._links[key]

    def _outside(self, module: Module) -> dict[str, list[str]]:
        """Imported names from other packages that cannot reach project code: name -> targets."""
        if module.name not in self._external:
            self._external[module.name] = {
                name: targets for name, targets in module.imports.items() if name not in module.items
                and all(self._modules.get(root) is None and root not in ROOTS for root in map(_root, targets))}
        return self._external[module.name]

    def definition(self, module: Module, name: str, statements: tuple[int, ...]) -> Definition:
        """Statements of one name, with their targets."""
        key = module.name, name, statements
        if key not in self._definitions:
            self._definitions[key] = self._defined(module, name, statements)
        return self._definitions[key]

    def _defined(self, module: Module, name: str, statements: tuple[int, ...]) -> Definition:
        rows, targets, loads, links = list[Any](), list[Target](), list[Module](), list[Links]()
        for index in statements:
            statement, found = module.statements[index], self.links(module, index)
            edges = [(label, *edge) for label in sorted(found.edges) for edge in found.edges[label]]
            rows.append([statement["digest"], sorted(found.facts), [f"{label}|{rest}" for label, rest, _ in edges]])
            targets += [target for _, _, target in edges]
            loads += self.imported(statement["loads"]) if "loads" in statement else ()
            links.append(found)
        packages = links[0].packages.union(*(found.packages for found in links[1:])) if links else set()
        return Definition(digest("afford-definition", [name, rows]), tuple(targets), tuple(loads), packages,
                          any(found.any_module_name for found in links))

    def effects(self, module: Module) -> Effects:
        """Effects of importing the module, see `runner.effects`."""
        if module.name not in self._effects:
            self._effects[module.name] = effects_of(self._modules, module)
        return self._effects[module.name]

    def loads(self, module: Module) -> list[Module]:
        """Project modules that run when this one is imported: its packages, its imports, and their packages."""
        if module.name not in self._loads:
            self._loads[module.name] = self.imported((module.name, *module.loads))
        return self._loads[module.name]

    def imported(self, names: Iterable[str]) -> list[Module]:
        """Project modules among dotted names, each after its packages."""
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
    """The one linker for the current state of these modules."""
    if modules.snapshot not in _linkers:
        _linkers[modules.snapshot] = Linker(modules)
    return _linkers[modules.snapshot]


def refused(module: Module, statement: dict[str, Any], ref: str, what: str, instead: str) -> SourceError:
    """Error for a reference, with its line."""
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
            for referent in self._referents(ref) if _root(ref) not in self.outside else ():
                self._take(ref, f": {self._label(ref)}", referent, counts=False)
        for ref in self.statement.get("getattrs", ()):
            self._getattr(ref)
        for name in sorted({_root(ref) for ref in self.statement["refs"]} & self.outside.keys()):
            self.found.packages |= {_root(target) for target in self.outside[name]} - sys.stdlib_module_names
            self.found.facts.append([name, self.outside[name]])
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
            self.found.facts.append(["__name__", self.module.name])
        self.found.any_module_name |= "any_module_name" in self.statement
        return self.found

    def _imports(self, imports: list[str]) -> None:
        """Record imports inside the statement; one without a project target counts as written."""
        used = [*self.statement["refs"], *self.statement.get("hints", ()), *self.statement.get("getattrs", ())]
        is_definition = "kind" in self.statement
        for slot, target in enumerate(imports):
            is_ours = self.modules.get(_root(target)) is not None
            reached = is_ours and (not is_definition or any(_is_of(ref, target) for ref in used))
            self.found.facts.append([f"@{slot}", imports.index(target) if reached else target])

    def _string(self, label: str, string: str) -> None:
        named = [referent for referent in self._referents(f"={string}") if referent.item is not None]
        if not named:
            self.found.facts.append([label, string])
        elif not self.by_string:
            self.found.facts.append([label, string.partition(":")[2]])
        for referent in named if self.by_string else ():
            self._lead(label, referent, (referent.name, str(referent.item)))

    def _label(self, ref: str) -> str:
        """Reference as written; an import inside the statement is identified by its slots."""
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
        for referent in self._referents(ref):
            self._take(ref, label, referent, counts=True)
            if referent.module is None and _root(ref) in self.module.imports:
                self.found.facts.append([ref, referent.dotted])

    def _referents(self, ref: str) -> Iterator[Referent]:
        return referents(self.modules, self.module, ref)

    def _take(self, ref: str, label: str, referent: Referent, *, counts: bool) -> None:
        if referent.module is None:
            self._package(ref, referent, counts=counts)
        elif not referent.chain:
            self._whole(ref, label, referent, referent.module)
        elif referent.item is not None:
            self._lead(label, referent, (referent.name, referent.item))
        elif referent.chain[0] == "__name__":
            self._program(ref, label, referent, referent.module)
        elif referent.chain[0] == "__file__":
            self._files(ref, label, referent, referent.module)
        elif referent.chain[0] in ("__dict__", "__spec__", "__loader__", "__path__"):
            raise self._error(ref, f"{ref} of a module cannot be followed", PLAIN)

    def _lead(self, label: str, referent: Referent, target: Target) -> None:
        edges, edge = self.found.edges.setdefault(label, []), (".".join(referent.chain[1:]), target)
        edges += [edge] if edge not in edges else []

    def _whole(self, ref: str, label: str, referent: Referent, module: Module) -> None:
        """Record a module used as a value.

        A package's further attributes depend on earlier imports.
        """
        if module.is_package and _has_modules(Path(module.path)):
            raise self._error(ref, f"the package {module.name!r} is used as a value", "import the used module of the package")
        self._lead(label, referent, (module.name, WHOLE))

    def _program(self, ref: str, label: str, referent: Referent, module: Module) -> None:
        """Record a module used by its name: it may be started, and its name may be part of the output."""
        self._lead(label, referent, (module.name, PROGRAM))
        if ref not in self.statement.get("started", ()):
            self.found.facts.append([label, module.name])

    def _files(self, ref: str, label: str, referent: Referent, module: Module) -> None:
        if "DATA_FILES" not in module.literals:
            raise self._error(ref, f"{ref} may lead to any file", FILES)
        for name in module.literals["DATA_FILES"]:
            self._lead(f"{label} {name}", referent, (module.name, f"/{name}"))

    def _package(self, ref: str, referent: Referent, *, counts: bool) -> None:
        root = _root(referent.name)
        objection = refusal(referent.dotted, lambda name: self.modules.get(name) is not None) if root in ROOTS else None
        if objection is not None and not (objection[1] in (IMPORT, PLAIN) and "DYNAMIC" in self.module.literals):
            raise self._error(ref, f"{objection[0]} cannot be followed", objection[1])
        self.found.any_module_name |= bool(WRITES_NAMES.match(referent.dotted))
        if counts and root not in sys.stdlib_module_names:
            self.found.packages.add(root)

    def _note_writer(self, ref: str) -> None:
        """Record a function of another package that writes module names."""
        name, _, rest = ref.partition(".")
        dotted = (f"{target.replace(':', '.')}.{rest}" for target in self.outside[name])
        self.found.any_module_name |= any(map(WRITES_NAMES.match, dotted))

    def _getattr(self, ref: str) -> None:
        label = f"getattr {self._label(ref)}"
        for referent in self._referents(ref):
            if referent.module is not None and not referent.chain and "DYNAMIC" not in self.module.literals:
                raise self._error(ref, f"getattr({ref.lstrip('@')}, <computed>) on a module cannot be followed",
                                  'list the possible attributes in DYNAMIC = ("module:attribute", ...)')
            self._take(ref, label, referent, counts=True)
            if referent.module is None:
                self.found.facts.append([label, referent.dotted])

    def _error(self, ref: str, what: str, instead: str) -> SourceError:
        return refused(self.module, self.statement, ref, what, instead)


def _is_of(ref: str, target: str) -> bool:
    """Return True for a reference to an import's target, or to an attribute of it."""
    return ref.startswith(f"@{target}") and ref[len(target) + 1:][:1] in ("", ".")
