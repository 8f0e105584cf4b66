"""The code that can run behind a stage, as one digest: static, transitive, importing nothing.

From the stage function every name is followed through our own modules: helpers, constants, classes with their methods and
bases, default arguments, nested functions and lambdas, imports of every form, names that are passed on by another module.
A registry (a literal dict ``name -> "module:attribute"``) is followed at the entry that Params selects: `BACKENDS` by the
field `backend`, `REFINES` by `refine`; at every entry when there is no such field. What importing a module does to names of
other modules counts, and so do files listed in its `DATA_FILES`. A module that imports by computed name must say what, in
`DYNAMIC = ("module", ...)`.
"""

from __future__ import annotations

import sys
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from runner.canonical import digest, file_digest
from runner.effects import Effects, effects_of
from runner.foreign import FILES, IMPORT, PLAIN, UNSEEN, refusal
from runner.modules import Modules
from runner.resolve import Place, places
from runner.source import MAIN, Module, SourceError, line_of


@dataclass
class Fingerprint:
    """`definitions` maps 'module:name' to the digest of its source; `files` is everything that was read to know."""

    digest: str
    definitions: dict[str, str]
    third_party: set[str]
    """top-level names of imported packages that are neither ours nor Python's"""
    files: set[str]


def fingerprint(modules: Modules, function: str, select: Mapping[str, object]) -> Fingerprint:
    """Fingerprint of 'module:function' under these parameters; SourceError when some code cannot be followed."""
    walk = _Closure(modules, select)
    module, _, name = function.partition(":")
    walk.start(module, name.partition(".")[0])
    walk.finish()
    return Fingerprint(digest("afford-closure", walk.definitions), walk.definitions, walk.third_party, walk.files)


def reachable_third_party(root: Path, function: str) -> set[str]:
    """Top-level import names of all packages that a stage can reach, whichever backend is selected: what its LIBRARIES must
    cover."""
    return fingerprint(Modules(root), function, {}).third_party


def declarations(modules: Modules, module: str) -> dict[str, Any]:
    """The literal LIBRARIES, THREADS and MEMORY_GIB of a stage's module; ValueError when one has the wrong type."""
    found = modules.get(module)
    literals = found.literals if found else {}
    declared = {"LIBRARIES": literals.get("LIBRARIES", []), "THREADS": literals.get("THREADS", 1),
                "MEMORY_GIB": float(literals.get("MEMORY_GIB", 1.0))}
    if not (isinstance(declared["LIBRARIES"], list) and isinstance(declared["THREADS"], int)):
        raise ValueError(f"{module}: expected LIBRARIES = (\"name\", ...) and THREADS = int as literals, got {declared}")
    return declared


def changed(old: Mapping[str, str], new: Mapping[str, str]) -> list[str]:
    """Which definitions differ: '~m:f' changed, '+m:f' came, '-m:f' went."""
    edited = [f"~{name}" for name in sorted(old.keys() & new.keys()) if old[name] != new[name]]
    came, went = sorted(new.keys() - old.keys()), sorted(old.keys() - new.keys())
    return [*edited, *(f"+{name}" for name in came), *(f"-{name}" for name in went)]


@dataclass
class _Closure:
    modules: Modules
    select: Mapping[str, object]
    definitions: dict[str, str] = field(default_factory=dict)
    third_party: set[str] = field(default_factory=set)
    files: set[str] = field(default_factory=set)
    _todo: list[tuple[str, str]] = field(default_factory=list)
    _seen: set[tuple[str, str]] = field(default_factory=set)
    _loaded: dict[str, Effects] = field(default_factory=dict)

    def start(self, module: str, name: str) -> None:
        """Begin at a definition. The values that come in have a type, or nobody knows whose methods run."""
        found = self.modules.get(module)
        for index in found.items.get(name, ()) if found else ():
            assert found is not None
            for parameter in set(found.statements[index].get("untyped", ())) - {"ctx"}:
                raise self._error(found, found.statements[index], name, f"the parameter {parameter!r} of {name}() may be anything",
                                  "annotate it with its class, so that the code of its methods counts")
        self.reach(module, name)

    def reach(self, module: str, name: str) -> None:
        if (module, name) not in self._seen:
            self._seen.add((module, name))
            self._todo.append((module, name))

    def finish(self) -> None:
        while self._todo:
            self._visit(*self._todo.pop())

    def _visit(self, module_name: str, name: str) -> None:
        module = self.modules.get(module_name)
        if module is None:
            raise SourceError(f"{module_name}:{name}: no such module under {self.modules.root}")
        effects = self._load(module)
        if self._is_registry(module, name):
            self._registry(module, name)
        elif name in module.items:
            statements = [module.statements[i] for i in (*module.items[name], *effects.owned.get(name, ()))]
            self._define(module, name, statements)

    def _define(self, module: Module, name: str, statements: list[dict[str, Any]]) -> None:
        """Statements of one name: what they are, and what the names that they import stand for."""
        meant = sorted({link for statement in statements for link in self._follow(module, statement)})
        self.definitions[f"{module.name}:{name}"] = digest("afford-definition", [[s["digest"] for s in statements], meant])

    def _is_registry(self, module: Module, name: str) -> bool:
        """A literal dict of "module:attribute" strings that all name packages of ours, and that no other statement touches."""
        entries = module.registries.get(name, {}).values()
        return bool(entries) and len(module.items[name]) == 1 and not self._loaded[module.name].owned.get(name) and all(
            self.modules.get(entry.partition(":")[0].partition(".")[0]) is not None for entry in entries)

    def _registry(self, module: Module, name: str) -> None:
        entries, field_name = module.registries[name], name.lower().removesuffix("s")
        chosen = self.select.get(field_name)
        keys = [chosen] if chosen in entries else sorted(entries)
        self.definitions[f"{module.name}:{name}"] = digest("afford-registry", [[key, entries[key]] for key in keys])
        for key in keys:
            target, _, attribute = entries[key].partition(":")
            self._need(target, f"{module.path}: {name}[{key!r}]")
            self.reach(target, attribute)

    def _need(self, module: str, where: str) -> None:
        if self.modules.get(module) is None:
            raise SourceError(f"{where}: expected a module of this project, got {module!r}")

    def _follow(self, module: Module, statement: dict[str, Any]) -> Iterator[str]:
        """Reach all that a statement refers to; yields what each imported name stands for."""
        for name in statement.get("loads", ()):
            self._import(name)
        for ref in statement.get("hints", ()):
            for place in places(self.modules, module, ref):
                self._take(module, statement, ref, place, counts=False)
        for ref in statement.get("getattrs", ()):
            self._getattr(module, statement, ref)
        for ref in statement["refs"]:
            if ref.startswith("."):
                self._unseen(module, statement, ref)
                continue
            for place in places(self.modules, module, ref):
                self._take(module, statement, ref, place, counts=True)
                if ref.partition(".")[0] in module.imports:
                    yield f"{ref} = {place.name}:{place.item}" if place.module else f"{ref} = {place.dotted}"

    def _take(self, module: Module, statement: dict[str, Any], ref: str, place: Place, *, counts: bool) -> None:
        """Reach one place, or count the package that it is in."""
        if place.module is None:
            self._foreign(module, statement, ref, place, counts=counts)
        elif not place.chain:
            self._everything(place.module)
        elif place.item is not None:
            self.reach(place.name, place.item)
        elif place.chain[0] == "__name__":
            self._program(place.module)
        elif place.chain[0] == "__file__" and "DATA_FILES" not in place.module.literals:
            raise self._error(module, statement, ref, f"{ref} may lead to any file", FILES)
        elif place.chain[0] in ("__dict__", "__spec__", "__loader__", "__path__"):
            raise self._error(module, statement, ref, f"{ref} of a module cannot be followed", PLAIN)

    def _foreign(self, module: Module, statement: dict[str, Any], ref: str, place: Place, *, counts: bool) -> None:
        objection = refusal(place.dotted, lambda name: self.modules.get(name) is not None)
        if objection is not None and not (objection[1] == IMPORT and "DYNAMIC" in module.literals):
            raise self._error(module, statement, ref, f"{objection[0]} cannot be followed", objection[1])
        root = place.name.partition(".")[0]
        if counts and root not in sys.stdlib_module_names:
            self.third_party.add(root)

    def _unseen(self, module: Module, statement: dict[str, Any], ref: str) -> None:
        raise self._error(module, statement, ref, f"{ref[1:]} cannot be followed", UNSEEN.get(ref[1:], PLAIN))

    def _getattr(self, module: Module, statement: dict[str, Any], ref: str) -> None:
        for place in places(self.modules, module, ref):
            if place.module is not None and not place.chain and "DYNAMIC" not in module.literals:
                raise self._error(module, statement, ref, f"getattr({ref.lstrip('@')}, <computed>) on a module cannot be followed",
                                  'name what it may be in DYNAMIC = ("module:attribute", ...)')
            self._take(module, statement, ref, place, counts=True)

    def _error(self, module: Module, statement: dict[str, Any], ref: str, what: str, instead: str) -> SourceError:
        return SourceError(f"{module.path}:{line_of(module, statement, ref)}: {what}; {instead}")

    def _everything(self, module: Module) -> None:
        """A module used as a value: whatever it has may be used, its own names and those that it imports."""
        for name in module.items:
            if name != MAIN:
                self.reach(module.name, name)
        for name in module.imports:
            for place in places(self.modules, module, name) if name not in module.typing else ():
                if place.item is not None:
                    self.reach(place.name, place.item)
                elif place.module is not None and ("*", place.name) not in self._seen:
                    self._seen.add(("*", place.name))
                    self._everything(place.module)

    def _program(self, module: Module) -> None:
        """A module by its name: somebody runs it as a program, or looks it up."""
        self._everything(module)
        self.reach(module.name, MAIN)

    def _load(self, module: Module) -> Effects:
        """Everything that importing the module runs and that touches other modules, and the data it declares."""
        if module.name not in self._loaded:
            effects = self._loaded[module.name] = effects_of(self.modules, module)
            self.files.add(module.path)
            registering = (i for i, names in module.decorated if any(self._ours(module, name) for name in names))
            for index in dict.fromkeys((*effects.wide, *registering)):
                statement = module.statements[index]
                self._define(module, f"<statement {statement['digest'][:8]}>", [statement])
            for name in module.literals.get("DATA_FILES", []):
                self._data(module, name)
            for name in module.literals.get("DYNAMIC", []):
                self._declared(module, name)
            for name in (module.name, *module.loads):
                self._import(name)
        return self._loaded[module.name]

    def _import(self, name: str) -> None:
        """A module and its packages, where they are ours, as an import loads them."""
        parts = name.split(".")
        for count in range(1, len(parts) + 1):
            found = self.modules.get(".".join(parts[:count]))
            if found is not None:
                self._load(found)

    def _ours(self, module: Module, name: str) -> bool:
        """Whether a decorator is code of this project: it may register what it decorates somewhere else."""
        targets = [target.partition(":")[0] for target in module.imports.get(name, ())]
        return name in module.items or any(self.modules.get(target) is not None for target in targets)

    def _data(self, module: Module, name: str) -> None:
        path = Path(module.path).with_name(name) if module.path.endswith(".py") else Path(module.path) / name
        if not path.is_file():
            raise SourceError(f"{module.path}: DATA_FILES names {name!r}, which is not beside it")
        self.files.add(str(path))
        self.definitions[f"{module.name}:{name}"] = file_digest(path)

    def _declared(self, module: Module, name: str) -> None:
        target, colon, attribute = name.partition(":")
        self._need(target, f"{module.path}: DYNAMIC")
        if colon:
            self.reach(target, attribute)
        else:
            found = self.modules.get(target)
            assert found is not None
            self._everything(found)
