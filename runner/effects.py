"""Effects of importing a module on the rest of the process, beyond binding its own names.

Each statement that an import runs may change an object: by assignment to a part of it, by a method, or by a call. If the object
belongs to the module, the statement counts for the name of the object (`owned`). If the object belongs to another module, or its
owner is unknown, the statement counts for all code that loads the module (`wide`).
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import dataclass, field
from typing import Any

from runner.external import harmless, sets_state
from runner.modules import Modules
from runner.references import Referent, referents
from runner.scopes import ARGUMENT, CALLED, READS
from runner.source import MAIN, Module, SourceError, line_of

Changed = set[tuple[str, str]]
"""(module, name) of changed objects; see `SOMEWHERE`"""
SOMEWHERE = ("", "")
"""object whose name cannot be determined"""
PARAMETER, PARAMETER_CALLED = (ARGUMENT, ""), (CALLED, "")


@dataclass
class Effects:
    """Indices of statements that count for more than the names they bind."""

    wide: list[int] = field(default_factory=list)
    owned: dict[str, list[int]] = field(default_factory=dict)
    outside: set[int] = field(default_factory=set)
    """members of `wide` that affect only packages outside the project"""


def effects_of(modules: Modules, module: Module) -> Effects:
    """Effects of importing a module; SourceError for a module that sets global state of another package."""
    found = Effects(list(module.effects))
    program = module.items.get(MAIN, ())
    for index, statement in enumerate(module.statements):
        if index in program or not ("sets" in statement or "bases" in statement):
            continue
        changed = _at_import(modules, module, statement)
        if any(home != module.name for home, _ in changed) and index not in found.wide:
            found.wide.append(index)
        for name in sorted(name for home, name in changed if home == module.name):
            if index not in module.items.get(name, ()):
                found.owned.setdefault(name, []).append(index)
    found.outside = {index for index in found.wide if not _touches_ours(modules, module, module.statements[index])}
    return found


def _touches_ours(modules: Modules, module: Module, statement: dict[str, Any]) -> bool:
    return any(referent.module is not None and referent.module is not module for ref in statement["refs"] if not ref.startswith("=")
               for referent in referents(modules, module, ref))


def _at_import(modules: Modules, module: Module, statement: dict[str, Any]) -> Changed:
    changed: Changed = set()
    walk = _EffectWalk(modules)
    for entry in statement.get("sets", ()):
        _check_state(modules, module, statement, entry)
        changed |= walk.entry(module, entry)
    if any(entry.endswith("()") for entry in statement.get("sets", ())):
        changed |= walk.called(module, statement)
    if any(_hooked(modules, module, base) for base in statement.get("bases", ())):
        changed.add(SOMEWHERE)
    return changed


def _check_state(modules: Modules, module: Module, statement: dict[str, Any], entry: str) -> None:
    if entry.startswith(ARGUMENT):
        return
    for referent in referents(modules, module, _plain(entry)):
        if referent.module is None and referent.name != "builtins" and sets_state(referent.dotted + entry[len(_plain(entry)):]):
            where = f"{module.path}:{line_of(module, statement, entry)}"
            raise SourceError(f"{where}: importing this module sets global state of {referent.name!r} ({referent.dotted}), which "
                              "affects every later task of the process; set it inside the function that needs it")


def _plain(entry: str) -> str:
    """Reference in an entry, without the operation on it."""
    return entry.partition("!")[0].removesuffix("()")


def _hooked(modules: Modules, module: Module, base: str) -> bool:
    """Return True when subclassing a project class runs project code."""
    for referent in referents(modules, module, base):
        for at in _statements(referent):
            assert referent.module is not None
            if at.get("hook") or any(_hooked(modules, referent.module, other) for other in at.get("bases", ())):
                return True
    return False


def _statements(referent: Referent) -> Iterator[dict[str, Any]]:
    if referent.module is not None and referent.item is not None:
        yield from (referent.module.statements[i] for i in referent.module.items[referent.item])


@dataclass
class _EffectWalk:
    """Changes that one statement causes, through all its calls.

    Any function that the statement refers to may be called.
    """

    modules: Modules
    seen: set[tuple[str, str]] = field(default_factory=set)

    def entry(self, module: Module, entry: str) -> Changed:
        """Owners of the object of an entry in `sets`, `does` or `gives`."""
        if entry.startswith(ARGUMENT):
            return {PARAMETER_CALLED if entry == CALLED else PARAMETER}
        changed: Changed = set()
        ref = _plain(entry)
        for referent in referents(self.modules, module, ref):
            changed |= self._referent(referent, entry[len(ref):])
        return changed

    def _referent(self, referent: Referent, done: str) -> Changed:
        """Objects that change when an operation is applied to a referent.

        Operations: '' changes the object, '()' calls it, '!...' applies to its return value.
        """
        if referent.module is None:
            return set() if referent.name == "builtins" or harmless(referent.dotted + done) else {SOMEWHERE}
        if done.startswith("!"):
            return set() if done == "!()" else self._returned(referent)
        if done == "()" and (len(referent.chain) == 1 or self._is(referent, "class", "function") or self._reads(referent)):
            return set()
        return self._object(referent)

    def _returned(self, referent: Referent) -> Changed:
        """Owners of the return value of a project function; a new object has none."""
        if len(referent.chain) != 1 or not self._is(referent, "class", "function"):
            return {SOMEWHERE}
        changed: Changed = set()
        if ("returned", f"{referent.name}:{referent.item}") not in self.seen:
            self.seen.add(("returned", f"{referent.name}:{referent.item}"))
            for statement in _statements(referent):
                assert referent.module is not None
                for given in statement.get("gives", ()) if statement.get("kind") == "function" else ():
                    changed |= self.entry(referent.module, given)
        return changed

    def called(self, module: Module, statement: dict[str, Any]) -> Changed:
        """Changes by the functions that a statement calls, and by those that it passes to callers."""
        now = statement.get("now", ())
        calls = {entry[:-2] for entry in statement["sets"] if entry.endswith("()")}
        passed = [ref for ref in now if ref not in calls]
        made = {ref for ref in calls.intersection(now) if not any(call.startswith(f"{ref}!") for call in calls)}
        changed = self._refs(module, calls.intersection(now), made)
        if PARAMETER_CALLED in changed or calls - {*now}:
            changed |= self._does(module, statement) if statement.get("kind") is None else self._refs(module, passed)
        if PARAMETER in changed:
            changed |= {(referent.name, referent.chain[0] if referent.chain else "") for ref in passed
                        for referent in referents(self.modules, module, ref)
                        if referent.module and not self._is(referent, "function")}
        return changed - {PARAMETER, PARAMETER_CALLED}

    def _does(self, module: Module, statement: dict[str, Any]) -> Changed:
        """Changes inside the functions of a statement."""
        changed: Changed = set()
        for entry in statement.get("does", ()):
            changed |= self.entry(module, entry)
        return changed | self._refs(module, statement["refs"] if SOMEWHERE not in changed else ())

    def _refs(self, module: Module, refs: Iterable[str], made: Iterable[str] = ()) -> Changed:
        """Changes when everything that is referred to is called; classes in `made` are only instantiated."""
        changed: Changed = set()
        for ref in refs:
            for referent in referents(self.modules, module, ref) if SOMEWHERE not in changed else ():
                if referent.module is None:
                    changed |= self._other(referent)
                elif not (ref in made and self._is(referent, "class") and not self._builds(referent)):
                    changed |= self._item(referent)
        return changed

    def _item(self, referent: Referent) -> Changed:
        changed: Changed = set()
        if referent.item is not None and (referent.name, referent.item) not in self.seen:
            self.seen.add((referent.name, referent.item))
            for statement in _statements(referent):
                assert referent.module is not None
                changed |= self._does(referent.module, statement)
        return changed

    def _builds(self, referent: Referent) -> bool:
        """Return True when constructing an object of a class runs project code."""
        return any(at.get("builds") or any(self._builds(base) for name in at.get("bases", ())
                                           for base in referents(self.modules, referent.module, name))  # type: ignore[arg-type]
                   for at in _statements(referent))

    def _other(self, referent: Referent) -> Changed:
        stateful = referent.name != "builtins" and referent.chain and sets_state(f"{referent.dotted}()")
        return {SOMEWHERE} if stateful else set()

    def _object(self, referent: Referent) -> Changed:
        """A project object by its name, and all objects to which the name may refer."""
        if referent.item is None:
            return {(referent.name, referent.chain[0] if referent.chain else "")}
        changed: Changed = {(referent.name, referent.item)}
        if ("object", f"{referent.name}:{referent.item}") not in self.seen:
            self.seen.add(("object", f"{referent.name}:{referent.item}"))
            for statement in _statements(referent):
                assert referent.module is not None
                for alias in statement.get("alias", ()):
                    changed |= self.entry(referent.module, alias)
        return changed

    def _reads(self, referent: Referent) -> bool:
        """Return True for a method without effect, of an object that no project class constructed."""
        return referent.chain[-1] in READS and not any(
            self._is(other, "class", "function") for statement in _statements(referent) for ref in statement["refs"]
            for other in referents(self.modules, referent.module, ref) if referent.module and other.module)  # type: ignore[arg-type]

    @staticmethod
    def _is(referent: Referent, *kinds: str) -> bool:
        """Return True when a referent is a definition of one of these kinds: 'class', 'function'."""
        return any(statement.get("kind") in kinds for statement in _statements(referent))
