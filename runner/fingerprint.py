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
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from runner.canonical import digest, file_digest
from runner.modules import Modules
from runner.source import Module, SourceError

COMPUTED = {"importlib.import_module", "importlib:import_module", "__import__", "eval", "exec", "globals"}


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
    walk = _Closure(modules, select, apart)
    module, _, name = function.partition(":")
    walk.reach(module, name.partition(".")[0])
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
    apart: tuple[str, ...] = ()
    definitions: dict[str, str] = field(default_factory=dict)
    third_party: set[str] = field(default_factory=set)
    files: set[str] = field(default_factory=set)
    _todo: list[tuple[str, str]] = field(default_factory=list)
    _seen: set[tuple[str, str]] = field(default_factory=set)
    _loaded: set[str] = field(default_factory=set)

    def reach(self, module: str, name: str) -> None:
        if (module, name) not in self._seen and module.partition(".")[0] not in self.apart:
            self._seen.add((module, name))
            self._todo.append((module, name))

    def finish(self) -> None:
        while self._todo:
            self._visit(*self._todo.pop())

    def _visit(self, module_name: str, name: str) -> None:
        module = self.modules.get(module_name)
        if module is None:
            raise SourceError(f"{module_name}:{name}: no such module under {self.modules.root}")
        self._load(module)
        if self._is_registry(module, name):
            self._registry(module, name)
        elif name in module.items:
            statements = [module.statements[i] for i in module.items[name]]
            self.definitions[f"{module_name}:{name}"] = digest("afford-definition", [s["digest"] for s in statements])
            for statement in statements:
                self._follow(module, statement)

    def _is_registry(self, module: Module, name: str) -> bool:
        """A literal dict of "module:attribute" strings that all name packages of ours, and that no other statement touches."""
        entries = module.registries.get(name, {}).values()
        return bool(entries) and len(module.items[name]) == 1 and all(
            self.modules.get(entry.partition(":")[0].partition(".")[0]) is not None for entry in entries)

    def _registry(self, module: Module, name: str) -> None:
        entries, field_name = module.registries[name], name.lower().removesuffix("s")
        chosen = self.select.get(field_name)
        several = chosen if isinstance(chosen, frozenset) else {chosen}
        keys = sorted(several) if several <= entries.keys() else sorted(entries)
        self.definitions[f"{module.name}:{name}"] = digest("afford-registry", [[key, entries[key]] for key in keys])
        for key in keys:
            target, _, attribute = entries[key].partition(":")
            self._need(target, f"{module.path}: {name}[{key!r}]")
            self.reach(target, attribute)

    def _need(self, module: str, where: str) -> None:
        if self.modules.get(module) is None:
            raise SourceError(f"{where}: expected a module of this project, got {module!r}")

    def _follow(self, module: Module, statement: dict[str, Any]) -> None:
        for ref in statement["refs"]:
            self._refer(module, ref, counts=True)
        for ref in statement["hints"]:
            self._refer(module, ref, counts=False)
        for ref in statement["getattrs"]:
            if self._whole_module(module, ref) and "DYNAMIC" not in module.literals:
                raise SourceError(f"{module.path}: getattr({ref}, <computed>) on a module cannot be followed; name what it may "
                                  'be in DYNAMIC = ("module:attribute", ...)')
            self._refer(module, ref, counts=True)

    def _refer(self, module: Module, ref: str, *, counts: bool) -> None:
        """Follow one reference: to an item of this module, through an import, or out of the project."""
        if ref.startswith("@"):
            target, _, rest = ref[1:].partition(":")
            self._resolve(module, *self._split(target, rest.split(".") if rest else [], ":" in ref), counts=counts)
            return
        name, *chain = ref.split(".")
        if name in module.items:
            self.reach(module.name, name)
        if name in module.imports:
            target, colon, attribute = module.imports[name].partition(":")
            self._resolve(module, target, [attribute, *chain] if colon else chain, counts=counts)
        elif name in COMPUTED and name not in module.items:
            self._computed(module, name)

    def _split(self, target: str, chain: list[str], has_attribute: bool) -> tuple[str, list[str]]:
        """'@a.b.c' of a plain import: the longest module, then attributes."""
        if has_attribute or self.modules.get(target.partition(".")[0]) is None:
            return target, chain
        parts = target.split(".")
        while len(parts) > 1 and self.modules.get(".".join(parts)) is None:
            chain.insert(0, parts.pop())
        return ".".join(parts), chain

    def _resolve(self, origin: Module, target: str, chain: list[str], *, counts: bool) -> None:
        """`chain` of attributes, starting at module `target`."""
        found = self.modules.get(target)
        if found is None:
            if f"{target}.{'.'.join(chain)}" in COMPUTED:
                self._computed(origin, f"{target}.{'.'.join(chain)}")
            root = target.partition(".")[0]
            if self.modules.get(root) is not None:
                raise SourceError(f"{origin.path}: it imports {target!r}, which is not a module of this project")
            if counts and root not in sys.stdlib_module_names:
                self.third_party.add(root)
            return
        self._load(found)
        if not chain:
            self._everything(found)
            return
        name, rest = chain[0], chain[1:]
        if name in found.items:
            self.reach(target, name)
        if name in found.imports:
            passed, colon, attribute = found.imports[name].partition(":")
            self._resolve(found, passed, [attribute, *rest] if colon else rest, counts=counts)
        elif name not in found.items and self.modules.get(f"{target}.{name}") is not None:
            self._resolve(found, f"{target}.{name}", rest, counts=counts)
        elif name not in found.items and "__getattr__" in found.items:
            self._everything(found)

    def _everything(self, module: Module) -> None:
        """A module used as a value: whatever it has may be used."""
        for name in module.items:
            self.reach(module.name, name)

    def _whole_module(self, module: Module, ref: str) -> bool:
        target, colon, attribute = (ref[1:] if ref.startswith("@") else module.imports.get(ref, "")).partition(":")
        return bool(target) and self.modules.get(f"{target}.{attribute}" if colon else target) is not None

    def _computed(self, module: Module, what: str) -> None:
        if "DYNAMIC" not in module.literals:
            raise SourceError(f"{module.path}: {what}() cannot be followed; use a literal registry, or name what it may load "
                              'in DYNAMIC = ("module", ...) of that module')

    def _load(self, module: Module) -> None:
        """Everything that importing the module runs and that touches other modules, and the data it declares."""
        if module.name in self._loaded or module.name.partition(".")[0] in self.apart:
            return
        self._loaded.add(module.name)
        self.files.add(module.path)
        registering = (i for i, names in module.decorated if any(self._ours(module, name) for name in names))
        for index in (*module.effects, *registering):
            statement = module.statements[index]
            self.definitions[f"{module.name}:<statement {statement['digest'][:8]}>"] = statement["digest"]
            self._follow(module, statement)
        for name in module.literals.get("DATA_FILES", []):
            self._data(module, name)
        for name in module.literals.get("DYNAMIC", []):
            self._declared(module, name)
        for name in _imported(module):
            found = self.modules.get(name)
            if found is not None:
                self._load(found)

    def _ours(self, module: Module, name: str) -> bool:
        """Whether a decorator is code of this project: it may register what it decorates somewhere else."""
        target = module.imports.get(name, "").partition(":")[0]
        return name in module.items or bool(target and self.modules.get(target) is not None)

    def _data(self, module: Module, name: str) -> None:
        path = Path(module.path).with_name(name) if module.path.endswith(".py") else Path(module.path) / name
        if not path.is_file():
            raise SourceError(f"{module.path}: DATA_FILES names {name!r}, which is not beside it")
        self.files.add(str(path))
        self.modules.stamp(str(path))
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


def _imported(module: Module) -> Iterator[str]:
    """Modules that run when this one is imported: its packages, and what it imports with theirs."""
    for name in (module.name, *module.loads):
        parts = name.split(".")
        yield from (".".join(parts[:i]) for i in range(1, len(parts) + 1))
