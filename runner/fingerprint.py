"""The code that can run behind a stage, as one digest: static, transitive, importing nothing.

From the stage function every name is followed through our own modules: helpers, constants, classes with their methods and
bases, default arguments, nested functions and lambdas, every import of a name, names that are passed on by another module.
A registry (a literal dict ``name -> "module:attribute"``) is followed at the entries that Params selects: `BACKENDS` by the
field `backend`, `REFINES` by `refine`, a name or a tuple of names; at every entry when there is no such field. What importing
a module does to other modules counts (`runner.effects`), and so do files listed in its `DATA_FILES`. A module that imports by
computed name must say what, in `DYNAMIC = ("module", ...)`. Code that cannot be followed is refused with file and line
(`runner.foreign`). What is not code is not seen: the environment, the working directory, the time.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from runner.canonical import digest, file_digest
from runner.links import Linker, Links, linker_of
from runner.modules import Modules
from runner.resolve import places
from runner.source import MAIN, Module, SourceError, untyped, where


@dataclass
class Fingerprint:
    """`definitions` maps 'module:name' to the digest of its source; `files` is everything that was read to know."""

    digest: str
    definitions: dict[str, str]
    third_party: set[str]
    """top-level names of imported packages that are neither ours nor Python's"""
    files: set[str]


def fingerprint(modules: Modules, function: str, select: Mapping[str, object], apart: tuple[str, ...] = ()) -> Fingerprint:
    """Fingerprint of 'module:function' under these parameters; SourceError when some code cannot be followed. What lies in the
    packages `apart` is not followed, and does not count."""
    walk = _Closure(modules, select, linker_of(modules), apart)
    module, _, name = function.partition(":")
    walk.start(module, name.partition(".")[0])
    walk.finish()
    return Fingerprint(digest("afford-closure", walk.definitions), walk.definitions, walk.third_party, walk.files)


def merged(parts: Sequence[Fingerprint]) -> Fingerprint:
    """One fingerprint of several functions that work on the same task."""
    definitions = {name: code for part in parts for name, code in part.definitions.items()}
    return Fingerprint(digest("afford-closure", definitions), definitions,
                       set().union(*(part.third_party for part in parts)), set().union(*(part.files for part in parts)))


def reachable_third_party(root: Path, function: str) -> set[str]:
    """Top-level import names of all packages that a stage can reach, whichever backend is selected: what its LIBRARIES must
    cover."""
    return fingerprint(Modules(root), function, {}).third_party


def declarations(modules: Modules, module: str) -> dict[str, Any]:
    """The literal LIBRARIES, THREADS, MEMORY_GIB and MACHINE of a stage's module; ValueError when one has the wrong type."""
    found = modules.get(module)
    literals = found.literals if found else {}
    declared = {"LIBRARIES": literals.get("LIBRARIES", []), "THREADS": literals.get("THREADS", 1),
                "MEMORY_GIB": float(literals.get("MEMORY_GIB", 1.0)), "MACHINE": literals.get("MACHINE", False)}
    kinds: dict[str, type | tuple[type, ...]] = {"LIBRARIES": list, "THREADS": int, "MACHINE": (bool, str)}
    if not all(isinstance(declared[name], kind) for name, kind in kinds.items()):
        raise ValueError(f"{module}: expected LIBRARIES = (\"name\", ...), THREADS = int and MACHINE = True or the name of a "
                         f"parameter as literals, got {declared}")
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
    linker: Linker
    apart: tuple[str, ...] = ()
    definitions: dict[str, str] = field(default_factory=dict)
    third_party: set[str] = field(default_factory=set)
    files: set[str] = field(default_factory=set)
    _todo: list[tuple[str, str]] = field(default_factory=list)
    _seen: set[tuple[str, str]] = field(default_factory=set)
    _loaded: set[str] = field(default_factory=set)

    def start(self, module: str, name: str) -> None:
        """Begin at a definition. Parameters need a type: the code of their methods counts."""
        found = self.modules.get(module)
        if found is not None and (loose := untyped(found, name)):
            raise SourceError(f"{where(found, name)}: the parameter {loose[0]!r} of {name}() may be anything; annotate it with its "
                              "class, so that the code of its methods counts")
        self._enter(module, name, f"{module}:{name}")

    def _enter(self, module: str, name: str, place: str) -> None:
        """Reach what 'module:name' is, wherever the module has it from."""
        if self.modules.get(module) is None:
            raise SourceError(f"{place}: expected a module of this project, got {module!r}; correct the name")
        found = list(places(self.modules, self.modules.get(module), f"@{module}:{name}"))  # type: ignore[arg-type]  # not None, see above
        if not found:
            raise SourceError(f"{place}: expected a name of the module {module!r}, got {name!r}; correct the name")
        for at in found:
            if at.item is not None:
                self.reach(at.name, at.item)
            elif at.module is not None:
                self._everything(at.name)

    def reach(self, module: str, name: str) -> None:
        if (module, name) not in self._seen and module.partition(".")[0] not in self.apart:
            self._seen.add((module, name))
            self._todo.append((module, name))

    def finish(self) -> None:
        while self._todo:
            self._visit(*self._todo.pop())

    def _visit(self, module_name: str, name: str) -> None:
        module = self.modules.get(module_name)
        assert module is not None, f"{module_name} was found before"
        self._load(module)
        if self._is_registry(module, name):
            self._registry(module, name)
        elif name in module.items:
            self._define(module, name, (*module.items[name], *self.linker.effects(module).owned.get(name, ())))

    def _define(self, module: Module, name: str, statements: tuple[int, ...]) -> None:
        self.definitions[f"{module.name}:{name}"] = self.linker.definition(module, statements)
        for index in statements:
            for imported in self.linker.imported(module.statements[index].get("loads", ())):
                self._load(imported)
            self._follow(self.linker.links(module, index), by_string=index not in self.linker.effects(module).outside)

    def _follow(self, links: Links, *, by_string: bool) -> None:
        """Reach what a statement leads to. What a string names is left out where only another package gets to see the string."""
        self.third_party |= links.packages
        for module, name in links.items | links.named if by_string else links.items:
            self.reach(module, name)
        for module in links.whole | links.programs:
            self._everything(module)
        for module in links.programs:
            self.reach(module, MAIN)

    def _everything(self, name: str) -> None:
        """A module used as a value: whatever it has may be used, its own names and those that it imports."""
        module = self.modules.get(name)
        if module is None or (name, "*") in self._seen:
            return
        self._seen.add((name, "*"))
        for item in module.items:
            if item != MAIN:
                self.reach(name, item)
        for imported in module.imports.keys() - set(module.typing):
            for place in places(self.modules, module, imported):
                if place.item is not None:
                    self.reach(place.name, place.item)
                elif place.module is not None:
                    self._everything(place.name)

    def _is_registry(self, module: Module, name: str) -> bool:
        """A literal dict of "module:attribute" strings that all name packages of ours, and that no other statement touches."""
        entries = module.registries.get(name, {}).values()
        return bool(entries) and len(module.items[name]) == 1 and name not in self.linker.effects(module).owned and all(
            self.modules.get(entry.partition(":")[0].partition(".")[0]) is not None for entry in entries)

    def _registry(self, module: Module, name: str) -> None:
        entries = module.registries[name]
        keys = self._chosen(name.lower().removesuffix("s"), entries)
        self.definitions[f"{module.name}:{name}"] = digest("afford-registry", [[key, entries[key]] for key in keys])
        for key in keys:
            target, _, attribute = entries[key].partition(":")
            self._enter(target, attribute, f"{where(module, name)}: {name}[{key!r}]")

    def _chosen(self, field_name: str, entries: Mapping[str, str]) -> list[str]:
        """The entry that a parameter names, or the entries that a tuple of names does; all of them without such a parameter. A
        frozenset, which is no parameter but what a codec selects, is taken as it is."""
        value = self.select.get(field_name)
        if isinstance(value, frozenset):
            return sorted(value & entries.keys())
        names = sorted({name for name in value if isinstance(name, str)}) if isinstance(value, tuple) else [value]
        return [name for name in names if isinstance(name, str)] if names and all(n in entries for n in names) else sorted(entries)

    def _load(self, module: Module) -> None:
        """Everything that importing the module runs and that touches other modules, and the data it declares."""
        if module.name in self._loaded or module.name.partition(".")[0] in self.apart:
            return
        self._loaded.add(module.name)
        self.files.add(module.path)
        registering = (i for i, names in module.decorated if any(self._ours(module, name) for name in names))
        for index in dict.fromkeys((*self.linker.effects(module).wide, *registering)):
            self._define(module, f"<statement {module.statements[index]['digest'][:8]}>", (index,))
        for name in module.literals.get("DATA_FILES", []):
            self._data(module, name)
        for name in module.literals.get("DYNAMIC", []):
            self._declared(module, name)
        for imported in self.linker.loads(module):
            self._load(imported)

    def _ours(self, module: Module, name: str) -> bool:
        """Whether a decorator is code of this project: it may register what it decorates somewhere else."""
        targets = [target.partition(":")[0] for target in module.imports.get(name, ())]
        return name in module.items or any(self.modules.get(target) is not None for target in targets)

    def _data(self, module: Module, name: str) -> None:
        path = Path(module.path).with_name(name) if module.path.endswith(".py") else Path(module.path) / name
        if not path.is_file():
            raise SourceError(f"{where(module, 'DATA_FILES')}: DATA_FILES names {name!r}, which is not beside it; put it there, or "
                              "correct the name")
        self.files.add(str(path))
        self.modules.stamp(str(path))
        self.definitions[f"{module.name}:{name}"] = file_digest(path)

    def _declared(self, module: Module, name: str) -> None:
        target, colon, attribute = name.partition(":")
        if colon:
            self._enter(target, attribute, f"{where(module, 'DYNAMIC')}: DYNAMIC")
        elif self.modules.get(target) is None:
            raise SourceError(f"{where(module, 'DYNAMIC')}: DYNAMIC: expected a module of this project, got {target!r}; correct it")
        else:
            self._everything(target)
