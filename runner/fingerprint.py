"""The code that can run behind a stage, as one digest: static, transitive, importing nothing, free of locations.

From the stage function every name is followed through our own modules: helpers, constants, classes with their methods and
bases, default arguments, nested functions and lambdas, every import of a name, names that are passed on by another module.
A registry (a literal dict ``name -> "module:attribute"``) is followed at the entries that Params selects: `BACKENDS` by the
field `backend`, `REFINES` by `refine`, a name or a tuple of names; at every entry when there is no such field. Of Params, the
blocks of entries that are not selected do not count (`runner.selection`). What importing
a module does to other modules counts (`runner.effects`), and so do files listed in its `DATA_FILES`. A module that imports by
computed name must say what, in `DYNAMIC = ("module", ...)`. Code that cannot be followed is refused with file and line
(`runner.foreign`). What is not code is not seen: the environment, the working directory, the time.

A closure is a graph: definitions, and from each the links that its text names. Walked from the stage along these links, in the
order of their labels, every definition gets a number; the digest is taken over the definitions and the numbers that they link to.
Where a definition lies and what its module is called is no part of it: two closures have the same digest when one can be laid over
the other. What runs only because a module is loaded follows, in an order of its own. Where the code uses names of modules, as
`__name__` and `__module__` do, these count.
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
from runner.resolve import Referent, referents
from runner.selection import selected_entries, selector, unselected
from runner.source import MAIN, Module, SourceError, untyped, where

DYNAMIC, LOADED = "<dynamic>", "<loaded>"
"""names of what a module may load, and, with the number of a statement, of what it runs when it is loaded"""
Known = tuple[str, tuple[Target, ...]]
"""what a definition is, and where it leads"""
Row = list[Any]
"""[what a definition is, numbers of the definitions that it leads to]"""


@dataclass
class Fingerprint:
    """`definitions` maps 'module:name' to the digest of its source; `files` is everything that was read to know."""

    digest: str
    definitions: dict[str, str]
    third_party: set[str]
    """top-level names of imported packages that are neither ours nor Python's"""
    files: set[str]
    numbers: dict[Target, int] = field(default_factory=dict)
    """(module, name) -> where the definition comes in the digest"""


def fingerprint(modules: Modules, function: str, select: Mapping[str, object], apart: tuple[str, ...] = ()) -> Fingerprint:
    """Fingerprint of 'module:function' under these parameters; SourceError when some code cannot be followed. What lies in the
    packages `apart` is not followed, and does not count.
    """
    walk = _Closure(modules, select, linker_of(modules), apart)
    module, _, name = function.partition(":")
    walk.start(module, name.partition(".")[0])
    walk.finish()
    return Fingerprint(walk.digest(), walk.definitions, walk.third_party, walk.files, walk.numbers)


def merged(parts: Sequence[Fingerprint]) -> Fingerprint:
    """One fingerprint of several functions that work on the same task: of each, and of what they have in common."""
    definitions = {name: code for part in parts for name, code in part.definitions.items()}
    common = [sorted([part.numbers[key], other.numbers[key]] for key in part.numbers.keys() & other.numbers.keys())
              for part, other in combinations(parts, 2)]
    return Fingerprint(digest("afford-closures", [[part.digest for part in parts], common]), definitions,
                       set().union(*(part.third_party for part in parts)), set().union(*(part.files for part in parts)))


def reachable_third_party(root: Path, function: str, select: Mapping[str, object] | None = None) -> set[str]:
    """Top-level import names of all packages that a stage can reach under these parameters, or whichever backend is selected: what
    its LIBRARIES must cover.
    """
    return fingerprint(Modules(root), function, select or {}).third_party


def changed(old: Mapping[str, str], new: Mapping[str, str]) -> list[str]:
    """Which definitions differ: '~m:f' changed, '+m:f' came, '-m:f' went. One that only moved to another module does not."""
    went, came = _without_moved(old, new), _without_moved(new, old)
    homes = {name: [full for full in came if _bare(full) == name] for name in map(_bare, came)}
    edited = {full: full for full in went.keys() & came.keys()}
    for full in sorted(went.keys() - edited.keys()):  # moved and edited at once
        rest = [other for other in homes.get(_bare(full), ()) if other not in edited.values()]
        edited |= {full: rest[0]} if len(rest) == 1 else {}
    return [*(f"~{name}" for name in sorted(edited.values())), *(f"+{name}" for name in sorted(came.keys() - {*edited.values()})),
            *(f"-{name}" for name in sorted(went.keys() - edited.keys()))]


def _without_moved(some: Mapping[str, str], others: Mapping[str, str]) -> dict[str, str]:
    """What the others do not have, wherever they have it."""
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
    apart: tuple[str, ...] = ()
    definitions: dict[str, str] = field(default_factory=dict)
    third_party: set[str] = field(default_factory=set)
    files: set[str] = field(default_factory=set)
    numbers: dict[Target, int] = field(default_factory=dict)
    everywhere: bool = False
    """whether the names of modules may be part of what is made"""
    _without: tuple[str, frozenset[str]] = ("", frozenset())
    """the module of the stage, and the blocks of its Params that do not count"""
    _roots: list[int | None] = field(default_factory=list)
    _rows: list[Row] = field(default_factory=list)
    _todo: deque[Target] = field(default_factory=deque)
    _known: dict[Target, Known] = field(default_factory=dict)
    _loose: list[Target] = field(default_factory=list)
    """what runs, or may, because a module is loaded, and has no number yet"""
    _loaded: set[str] = field(default_factory=set)

    def start(self, module: str, name: str) -> None:
        """Begin at a definition. Parameters need a type: the code of their methods counts."""
        found = self.modules.get(module)
        if found is not None and (loose := untyped(found, name)):
            raise SourceError(f"{where(found, name)}: the parameter {loose[0]!r} of {name}() may be anything; annotate it with its "
                              "class, so that the code of its methods counts")
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
        homes = [module for module, _ in self.numbers] if self.everywhere else []
        return digest("afford-closure", [self._roots, self._rows, homes])

    def _number(self, key: Target) -> int | None:
        """The number of a definition; None for one that does not count."""
        if self.apart and key[0].partition(".")[0] in self.apart:
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
        """Digest of what is reached from here, apart from where what is numbered already lies: by this loose ends are ordered."""
        own, rows, todo = {root: 0}, list[Row](), deque([root])
        while todo:
            code, targets = self._know(todo.popleft())
            fresh = [key for key in dict.fromkeys(targets) if key not in self.numbers and key not in own
                     and key[0].partition(".")[0] not in self.apart]
            own |= {key: len(own) + count for count, key in enumerate(fresh)}
            todo += fresh
            rows.append([code, [self.numbers.get(key, -own.get(key, 0) - 1) for key in targets]])
        return digest("afford-form", rows)

    def _know(self, key: Target) -> Known:
        if key not in self._known:
            self._known[key] = self._look(*key)
        return self._known[key]

    def _look(self, module_name: str, name: str) -> Known:
        """What a definition is, and where it leads; what its module runs when it is loaded counts from now on."""
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
        """Statements without the blocks of Params that are not selected."""
        home, blocks = self._without
        if not blocks or module.name != home:
            return statements
        return tuple(index for index in statements if module.statements[index].get("block") not in blocks)

    def _define(self, module: Module, name: str, statements: tuple[int, ...]) -> Known:
        found = self.linker.definition(module, name, statements)
        label = name or f"<statement {module.statements[statements[0]]['digest'][:8]}>"
        self.definitions[f"{module.name}:{label}"] = found.digest
        self.third_party |= found.packages
        self.everywhere |= found.everywhere
        for loaded in found.loads:
            if loaded.name not in self._loaded:
                self._load(loaded)
        return found.digest, found.targets

    def _entry(self, module: str, name: str, place: str) -> list[Target]:
        """What 'module:name' is, wherever the module has it from."""
        if self.modules.get(module) is None:
            raise SourceError(f"{place}: expected a module of this project, got {module!r}; correct the name")
        found = list(referents(self.modules, self.modules.get(module), f"@{module}:{name}"))  # type: ignore[arg-type]  # not None, see above
        if not found:
            raise SourceError(f"{place}: expected a name of the module {module!r}, got {name!r}; correct the name")
        return list(filter(None, map(_target, found)))

    def _whole(self, module: Module, use: str) -> Known:
        """A module used as a value: whatever it has may be used, its own names, those that it imports, and what it is called. One
        that is started runs its program.
        """
        names = {name: [(module.name, name)] for name in module.items if name != MAIN or use == PROGRAM}
        for name in module.imports.keys() - set(module.typing):
            names.setdefault(name, []).extend(filter(None, map(_target, referents(self.modules, module, name))))
        stands = sorted((name, list(dict.fromkeys(targets))) for name, targets in names.items())
        called = module.name if use == WHOLE else ""
        return (digest("afford-module", [called, [[name, len(targets)] for name, targets in stands]]),
                tuple(target for _, targets in stands for target in targets))

    def _is_registry(self, module: Module, name: str) -> bool:
        """A literal dict of "module:attribute" strings that all name packages of ours, and that no other statement touches."""
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
        """Everything that importing the module runs and that touches other modules, and the data it declares."""
        if module.name in self._loaded or module.name.partition(".")[0] in self.apart:
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
        """Whether a decorator is code of this project: it may register what it decorates somewhere else."""
        targets = [target.partition(":")[0] for target in module.imports.get(name, ())]
        return name in module.items or any(self.modules.get(target) is not None for target in targets)

    def _data(self, module: Module, name: str) -> str:
        path = Path(module.path).with_name(name) if module.path.endswith(".py") else Path(module.path) / name
        if not path.is_file():
            raise SourceError(f"{where(module, 'DATA_FILES')}: DATA_FILES names {name!r}, which is not beside it; put it there, or "
                              "correct the name")
        self.files.add(str(path))
        self.modules.stamp(str(path))
        self.definitions[f"{module.name}:{name}"] = file_digest(path)
        return digest("afford-data", [name, self.definitions[f"{module.name}:{name}"]])

    def _dynamic(self, module: Module) -> Known:
        """What a module may load by a computed name, labelled by the last part of that name where no other ends so."""
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
            raise SourceError(f"{where(module, 'DYNAMIC')}: DYNAMIC: expected a module of this project, got {target!r}; correct it")
        return [(target, LOADABLE)]


def _target(place: Referent) -> Target | None:
    """The item or the module of ours at a place."""
    if place.module is None:
        return None
    return (place.name, place.item) if place.item is not None else (place.name, WHOLE)


def _parted(entry: str) -> tuple[str, str]:
    module, _, attribute = entry.partition(":")
    return module, attribute
