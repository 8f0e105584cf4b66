"""Fingerprint: digest of all code that can run behind a stage. Static, transitive, independent of code locations.

From the stage function every name is followed through the project: helpers, constants, classes with methods and bases, default
arguments, nested functions and lambdas, imports, and re-exported names. A registry (a literal dict ``name -> "module:attribute"``)
is followed at the entries that Params selects: `BACKENDS` by the field `backend`, `REFINES` by `refine`, a name or a tuple of
names; at every entry without such a field. Blocks of Params for unselected entries do not count (`runner.selection`).

Import side effects on other modules count (`runner.effects`), and so do the files in a module's `DATA_FILES`. A module that imports
by computed name must list the targets in `DYNAMIC = ("module", ...)`. Code that cannot be followed is refused with file and line
(`runner.external`). The environment, the working directory and the time are not covered.

The closure is a graph of definitions and of the links that their text names. Walked from the stage along these links, in the order
of their labels, every definition gets a number. The digest covers the definitions and the numbers that they link to. Locations and
module names are not part of it: two closures have the same digest when one can be mapped onto the other. Code that runs only
because a module is loaded follows, in an order of its own. Module names count where the code uses them through `__name__` or
`__module__`.
"""

from __future__ import annotations

import re
from collections import Counter, deque
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from itertools import combinations
from pathlib import Path
from typing import Any

from runner.canonical import digest, file_digest
from runner.links import LOADABLE, PROGRAM, WHOLE, Linker, Target, linker_of
from runner.modules import Modules
from runner.references import Referent, referents
from runner.selection import selected_entries, selector, unselected
from runner.source import MAIN, Module, SourceError, untyped, where

DYNAMIC, LOADED = "<dynamic>", "<loaded>"
"""names for the modules that a module may load, and (with a statement number) for statements that run on loading"""
Known = tuple[str, tuple[Target, ...]]
"""(digest of a definition, its targets)"""
Row = list[Any]
"""[digest of a definition, numbers of its targets]"""


@dataclass
class Fingerprint:
    """Digest of a closure; `definitions` maps 'module:name' to source digests, `files` lists all files that were read."""

    digest: str
    definitions: dict[str, str]
    third_party: set[str]
    """top-level names of imported third-party packages"""
    files: set[str]
    numbers: dict[Target, int] = field(default_factory=dict)
    """(module, name) -> number of the definition in the digest"""


def fingerprint(modules: Modules, function: str, select: Mapping[str, object], excluded: tuple[str, ...] = ()) -> Fingerprint:
    """Fingerprint of 'module:function' under these parameters.

    Code in the packages `excluded` is not followed and does not count. SourceError when some code cannot be followed.
    """
    walk = _Closure(modules, select, linker_of(modules), excluded)
    module, _, name = function.partition(":")
    walk.start(module, name.partition(".")[0])
    walk.finish()
    return Fingerprint(walk.digest(), walk.definitions, walk.third_party, walk.files, walk.numbers)


def merged(parts: Sequence[Fingerprint]) -> Fingerprint:
    """Merge the fingerprints of several functions of one task; definitions in common count as common."""
    definitions = {name: code for part in parts for name, code in part.definitions.items()}
    common = [sorted([part.numbers[key], other.numbers[key]] for key in part.numbers.keys() & other.numbers.keys())
              for part, other in combinations(parts, 2)]
    return Fingerprint(digest("afford-closures", [[part.digest for part in parts], common]), definitions,
                       set().union(*(part.third_party for part in parts)), set().union(*(part.files for part in parts)))


def changed(old: Mapping[str, str], new: Mapping[str, str]) -> list[str]:
    """Names of definitions that differ: '~m:f' changed, '+m:f' added, '-m:f' removed.

    A definition that only moved to another module does not count.
    """
    went, came = _without_moved(old, new), _without_moved(new, old)
    homes = {name: [full for full in came if _bare(full) == name] for name in map(_bare, came)}
    edited = {full: full for full in went.keys() & came.keys()}
    for full in sorted(went.keys() - edited.keys()):  # moved and edited in one change
        rest = [other for other in homes.get(_bare(full), ()) if other not in edited.values()]
        edited |= {full: rest[0]} if len(rest) == 1 else {}
    return [*(f"~{name}" for name in sorted(edited.values())), *(f"+{name}" for name in sorted(came.keys() - {*edited.values()})),
            *(f"-{name}" for name in sorted(went.keys() - edited.keys()))]


def _without_moved(some: Mapping[str, str], others: Mapping[str, str]) -> dict[str, str]:
    """Entries that the others lack, under any module."""
    left = {full: code for full, code in some.items() if others.get(full) != code}
    there = Counter((_bare(full), code) for full, code in others.items() if some.get(full) != code)
    found = {}
    for full, code in left.items():
        if there[_bare(full), code]:
            there[_bare(full), code] -= 1
        else:
            found[full] = code
    return found


def _bare(full: str) -> str:
    return full.partition(":")[2]


@dataclass
class _Closure:
    modules: Modules
    select: Mapping[str, object]
    linker: Linker
    excluded: tuple[str, ...] = ()
    definitions: dict[str, str] = field(default_factory=dict)
    third_party: set[str] = field(default_factory=set)
    files: set[str] = field(default_factory=set)
    numbers: dict[Target, int] = field(default_factory=dict)
    any_module_name: bool = False
    """True if module names may be part of the output"""
    _without: tuple[str, frozenset[str]] = ("", frozenset())
    """(module of the stage, blocks of its Params that do not count)"""
    _roots: list[int | None] = field(default_factory=list)
    _rows: list[Row] = field(default_factory=list)
    _todo: deque[Target] = field(default_factory=deque)
    _known: dict[Target, Known] = field(default_factory=dict)
    _loose: list[Target] = field(default_factory=list)
    """definitions without a number that run, or may run, because a module is loaded"""
    _loaded: set[str] = field(default_factory=set)

    def start(self, module: str, name: str) -> None:
        """Begin at a definition.

        Parameters need a type, so that the code of their methods counts.
        """
        found = self.modules.get(module)
        if found is not None and (loose := untyped(found, name)):
            raise SourceError(f"{where(found, name)}: the parameter {loose[0]!r} of {name}() has no specific type; annotate it "
                              "with its class, so that the code of its methods counts")
        self._without = module, unselected(self.modules, module, self.select)
        self._roots += map(self._number, self._entry(module, name, f"{module}:{name}"))

    def finish(self) -> None:
        """Number everything that can run."""
        self._drain()
        while self._loose:
            found, self._loose = self._loose, []
            for key in sorted(found, key=self._form) if len(found) > 1 else found:
                self._roots.append(self._number(key))
                self._drain()

    def digest(self) -> str:
        """Digest of the graph."""
        homes = [module for module, _ in self.numbers] if self.any_module_name else []
        return digest("afford-closure", [self._roots, self._rows, homes])

    def _number(self, key: Target) -> int | None:
        """Number of a definition; None for an excluded one."""
        if self.excluded and key[0].partition(".")[0] in self.excluded:
            return None
        if key not in self.numbers:
            self.numbers[key] = len(self.numbers)
            self._todo.append(key)
        return self.numbers[key]

    def _drain(self) -> None:
        while self._todo:
            code, targets = self._know(self._todo.popleft())
            self._rows.append([code, [self._number(key) for key in targets]])

    def _form(self, root: Target) -> str:
        """Digest of everything reachable from here, apart from numbered definitions; orders the loose ends."""
        own, rows, todo = {root: 0}, list[Row](), deque([root])
        while todo:
            code, targets = self._know(todo.popleft())
            fresh = [key for key in dict.fromkeys(targets) if key not in self.numbers and key not in own
                     and key[0].partition(".")[0] not in self.excluded]
            own |= {key: len(own) + count for count, key in enumerate(fresh)}
            todo += fresh
            rows.append([code, [self.numbers.get(key, -own.get(key, 0) - 1) for key in targets]])
        return digest("afford-form", rows)

    def _know(self, key: Target) -> Known:
        if key not in self._known:
            self._known[key] = self._look(*key)
        return self._known[key]

    def _look(self, module_name: str, name: str) -> Known:
        """Digest and targets of a definition; statements that loading its module runs count from now on."""
        module = self.modules.get(module_name)
        assert module is not None, f"{module_name} was found before"
        if module_name not in self._loaded:
            self._load(module)
        if name[0] not in "</":
            return self._item(module, name)
        if name in (WHOLE, PROGRAM, LOADABLE):
            return self._whole(module, name)
        if name.startswith("/"):
            return self._data(module, name[1:]), ()
        if name == DYNAMIC:
            return self._dynamic(module)
        return self._define(module, "", (int(name.removeprefix(LOADED)),))

    def _item(self, module: Module, name: str) -> Known:
        if name in module.registries and self._is_registry(module, name):
            return self._registry(module, name)
        return self._define(module, name, self._counting(module, (
            *module.items[name], *self.linker.effects(module).owned.get(name, ()))))

    def _counting(self, module: Module, statements: tuple[int, ...]) -> tuple[int, ...]:
        """Statements without the unselected blocks of Params."""
        home, blocks = self._without
        if not blocks or module.name != home:
            return statements
        return tuple(index for index in statements if module.statements[index].get("block") not in blocks)

    def _define(self, module: Module, name: str, statements: tuple[int, ...]) -> Known:
        found = self.linker.definition(module, name, statements)
        label = name or f"<statement {module.statements[statements[0]]['digest'][:8]}>"
        self.definitions[f"{module.name}:{label}"] = found.digest
        self.third_party |= found.packages
        self.any_module_name |= found.any_module_name
        for loaded in found.loads:
            if loaded.name not in self._loaded:
                self._load(loaded)
        return found.digest, found.targets

    def _entry(self, module: str, name: str, location: str) -> list[Target]:
        """Targets of 'module:name', also of a re-exported name."""
        if self.modules.get(module) is None:
            raise SourceError(f"{location}: {module!r} is not a module of this project; correct the name")
        found = list(referents(self.modules, self.modules.get(module), f"@{module}:{name}"))  # type: ignore[arg-type]  # not None, see above
        if not found:
            raise SourceError(f"{location}: the module {module!r} has no {name!r}; correct the name")
        return list(filter(None, map(_target, found)))

    def _whole(self, module: Module, use: str) -> Known:
        """Digest and targets of a module used as a value: its own names, its imports, and its name.

        A module that is started also runs its program.
        """
        names = {name: [(module.name, name)] for name in module.items if name != MAIN or use == PROGRAM}
        for name in module.imports.keys() - set(module.typing):
            names.setdefault(name, []).extend(filter(None, map(_target, referents(self.modules, module, name))))
        attributes = sorted((name, list(dict.fromkeys(targets))) for name, targets in names.items())
        called = module.name if use == WHOLE else ""
        return (digest("afford-module", [called, [[name, len(targets)] for name, targets in attributes]]),
                tuple(target for _, targets in attributes for target in targets))

    def _is_registry(self, module: Module, name: str) -> bool:
        """Return True for a literal dict of "module:attribute" strings in the project that no other statement changes."""
        entries = module.registries[name].values()
        return len(module.items[name]) == 1 and name not in self.linker.effects(module).owned and all(
            self.modules.get(entry.partition(":")[0].partition(".")[0]) is not None for entry in entries)

    def _registry(self, module: Module, name: str) -> Known:
        entries = module.registries[name]
        keys = selected_entries(self.select.get(selector(name)), entries)
        targets = [self._entry(*_parted(entries[key]), f"{where(module, name)}: {name}[{key!r}]") for key in keys]
        code = digest("afford-registry", [name, [[key, len(found)] for key, found in zip(keys, targets, strict=True)]])
        self.definitions[f"{module.name}:{name}"] = code
        return code, tuple(target for found in targets for target in found)

    def _load(self, module: Module) -> None:
        """Add the statements that run on import and affect other modules, and the data that the module declares."""
        if module.name in self._loaded or module.name.partition(".")[0] in self.excluded:
            return
        self._loaded.add(module.name)
        self.files.add(module.path)
        registering = (i for i, names in module.decorated if any(self._ours(module, name) for name in names))
        for index in self._counting(module, tuple(dict.fromkeys((*self.linker.effects(module).wide, *registering)))):
            self._loose.append((module.name, f"{LOADED}{index}"))
        self._loose += [(module.name, f"/{name}") for name in module.literals.get("DATA_FILES", [])]
        self._loose += [(module.name, DYNAMIC)] if module.literals.get("DYNAMIC") else []
        for imported in self.linker.loads(module):
            if imported.name not in self._loaded:
                self._load(imported)

    def _ours(self, module: Module, name: str) -> bool:
        """Return True for a decorator from this project, which may register the decorated object elsewhere."""
        targets = [target.partition(":")[0] for target in module.imports.get(name, ())]
        return name in module.items or any(self.modules.get(target) is not None for target in targets)

    def _data(self, module: Module, name: str) -> str:
        path = Path(module.path).with_name(name) if module.path.endswith(".py") else Path(module.path) / name
        if not path.is_file():
            raise SourceError(f"{where(module, 'DATA_FILES')}: DATA_FILES names {name!r}, which is not beside the module; add the "
                              "file, or correct the name")
        self.files.add(str(path))
        self.modules.stamp(str(path))
        self.definitions[f"{module.name}:{name}"] = file_digest(path)
        return digest("afford-data", [name, self.definitions[f"{module.name}:{name}"]])

    def _dynamic(self, module: Module) -> Known:
        """Modules that a module may load by computed name, labelled by the last part of the name if it is unique."""
        names = module.literals["DYNAMIC"]
        last = [re.split("[.:]", name)[-1] for name in names]
        labels = sorted((short if last.count(short) == 1 else name, name) for short, name in zip(last, names, strict=True))
        return (digest("afford-dynamic", [label for label, _ in labels]),
                tuple(target for _, name in labels for target in self._declared(module, name)))

    def _declared(self, module: Module, name: str) -> list[Target]:
        target, colon, attribute = name.partition(":")
        if colon:
            return self._entry(target, attribute, f"{where(module, 'DYNAMIC')}: DYNAMIC")
        if self.modules.get(target) is None:
            raise SourceError(f"{where(module, 'DYNAMIC')}: DYNAMIC: {target!r} is not a module of this project; correct it")
        return [(target, LOADABLE)]


def _target(referent: Referent) -> Target | None:
    """Project item or module of a referent."""
    if referent.module is None:
        return None
    return (referent.name, referent.item) if referent.item is not None else (referent.name, WHOLE)


def _parted(entry: str) -> tuple[str, str]:
    module, _, attribute = entry.partition(":")
    return module, attribute
