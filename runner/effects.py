"""What importing a module does to the rest of the process, beyond binding its own names.

Every statement of a module that is run by its import may change an object: by an assignment to a part of it, by a method, by a
call of a function that does so. Where the object belongs to the module, the statement belongs to the object's name (`owned`);
where it belongs to another module, or its owner cannot be determined, the statement counts for whoever loads the module (`wide`).
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import dataclass, field
from typing import Any

from runner.foreign import harmless, sets_state
from runner.modules import Modules
from runner.resolve import Place, places
from runner.scopes import ARGUMENT, CALLED, READS
from runner.source import MAIN, Module, SourceError, line_of

Changed = set[tuple[str, str]]
"""(module, name) of what is changed; see `SOMEWHERE`"""
SOMEWHERE = ("", "")
"""an object without a name that can be determined"""
PARAMETER, PARAMETER_CALLED = (ARGUMENT, ""), (CALLED, "")


@dataclass
class Effects:
    """Statements, by index, that belong to more than the names they bind."""

    wide: list[int] = field(default_factory=list)
    owned: dict[str, list[int]] = field(default_factory=dict)
    outside: set[int] = field(default_factory=set)
    """those of `wide` that touch packages of others only"""


def effects_of(modules: Modules, module: Module) -> Effects:
    """Effects of importing a module; SourceError for one that sets a state of another package."""
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
    return any(place.module is not None and place.module is not module for ref in statement["refs"] if not ref.startswith("=")
               for place in places(modules, module, ref))


def _at_import(modules: Modules, module: Module, statement: dict[str, Any]) -> Changed:
    changed: Changed = set()
    walk = _Walk(modules)
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
    for place in places(modules, module, _plain(entry)):
        if place.module is None and place.name != "builtins" and sets_state(place.dotted + entry[len(_plain(entry)):]):
            where = f"{module.path}:{line_of(module, statement, entry)}"
            raise SourceError(f"{where}: importing this module sets a state of {place.name!r}, which every later task of the "
                              f"process sees ({place.dotted}); do it inside the function that needs it")


def _plain(entry: str) -> str:
    """The reference in an entry, without what is done to it."""
    return entry.partition("!")[0].removesuffix("()")


def _hooked(modules: Modules, module: Module, base: str) -> bool:
    """Whether making a subclass of a class of ours runs code of ours."""
    for place in places(modules, module, base):
        for at in _statements(place):
            assert place.module is not None
            if at.get("hook") or any(_hooked(modules, place.module, other) for other in at.get("bases", ())):
                return True
    return False


def _statements(place: Place) -> Iterator[dict[str, Any]]:
    if place.module is not None and place.item is not None:
        yield from (place.module.statements[i] for i in place.module.items[place.item])


@dataclass
class _Walk:
    """What one statement changes, through all that it calls. Any function that it refers to may be called."""

    modules: Modules
    seen: set[tuple[str, str]] = field(default_factory=set)

    def entry(self, module: Module, entry: str) -> Changed:
        """Owners of the object that an entry of `sets`, `does` or `gives` is about."""
        if entry.startswith(ARGUMENT):
            return {PARAMETER_CALLED if entry == CALLED else PARAMETER}
        changed: Changed = set()
        ref = _plain(entry)
        for place in places(self.modules, module, ref):
            changed |= self._place(place, entry[len(ref):])
        return changed

    def _place(self, place: Place, done: str) -> Changed:
        """What changes when this is `done` to a place: '' to itself, '()' it is called, '!...' to what it returned."""
        if place.module is None:
            return set() if place.name == "builtins" or harmless(place.dotted + done) else {SOMEWHERE}
        if done.startswith("!"):
            return set() if done == "!()" else self._returned(place)
        if done == "()" and (len(place.chain) == 1 or self._is(place, "class", "function") or self._reads(place)):
            return set()
        return self._object(place)

    def _returned(self, place: Place) -> Changed:
        """Owners of what a function of ours returned; a new object has none."""
        if len(place.chain) != 1 or not self._is(place, "class", "function"):
            return {SOMEWHERE}
        changed: Changed = set()
        if ("returned", f"{place.name}:{place.item}") not in self.seen:
            self.seen.add(("returned", f"{place.name}:{place.item}"))
            for statement in _statements(place):
                assert place.module is not None
                for given in statement.get("gives", ()) if statement.get("kind") == "function" else ():
                    changed |= self.entry(place.module, given)
        return changed

    def called(self, module: Module, statement: dict[str, Any]) -> Changed:
        """What the functions do that a statement calls, and those that it passes to one that calls them; and to what."""
        now = statement.get("now", ())
        calls = {entry[:-2] for entry in statement["sets"] if entry.endswith("()")}
        passed = [ref for ref in now if ref not in calls]
        made = {ref for ref in calls.intersection(now) if not any(call.startswith(f"{ref}!") for call in calls)}
        changed = self._refs(module, calls.intersection(now), made)
        if PARAMETER_CALLED in changed or calls - {*now}:
            changed |= self._does(module, statement) if statement.get("kind") is None else self._refs(module, passed)
        if PARAMETER in changed:
            changed |= {(place.name, place.chain[0] if place.chain else "") for ref in passed
                        for place in places(self.modules, module, ref) if place.module and not self._is(place, "function")}
        return changed - {PARAMETER, PARAMETER_CALLED}

    def _does(self, module: Module, statement: dict[str, Any]) -> Changed:
        """What the inside of functions does."""
        changed: Changed = set()
        for entry in statement.get("does", ()):
            changed |= self.entry(module, entry)
        return changed | self._refs(module, statement["refs"] if SOMEWHERE not in changed else ())

    def _refs(self, module: Module, refs: Iterable[str], made: Iterable[str] = ()) -> Changed:
        """What happens when all that is referred to is called; of classes in `made` only an object is made."""
        changed: Changed = set()
        for ref in refs:
            for place in places(self.modules, module, ref) if SOMEWHERE not in changed else ():
                if place.module is None:
                    changed |= self._other(place)
                elif not (ref in made and self._is(place, "class") and not self._builds(place)):
                    changed |= self._item(place)
        return changed

    def _item(self, place: Place) -> Changed:
        changed: Changed = set()
        if place.item is not None and (place.name, place.item) not in self.seen:
            self.seen.add((place.name, place.item))
            for statement in _statements(place):
                assert place.module is not None
                changed |= self._does(place.module, statement)
        return changed

    def _builds(self, place: Place) -> bool:
        """Whether making an object of a class runs code of ours."""
        return any(at.get("builds") or any(self._builds(base) for name in at.get("bases", ())
                                           for base in places(self.modules, place.module, name))  # type: ignore[arg-type]
                   for at in _statements(place))

    def _other(self, place: Place) -> Changed:
        stateful = place.name != "builtins" and place.chain and sets_state(f"{place.dotted}()")
        return {SOMEWHERE} if stateful else set()

    def _object(self, place: Place) -> Changed:
        """An object of ours by its name, and all that the name may stand for."""
        if place.item is None:
            return {(place.name, place.chain[0] if place.chain else "")}
        changed: Changed = {(place.name, place.item)}
        if ("object", f"{place.name}:{place.item}") not in self.seen:
            self.seen.add(("object", f"{place.name}:{place.item}"))
            for statement in _statements(place):
                assert place.module is not None
                for alias in statement.get("alias", ()):
                    changed |= self.entry(place.module, alias)
        return changed

    def _reads(self, place: Place) -> bool:
        """A method that changes nothing, of an object that no class of ours made."""
        return place.chain[-1] in READS and not any(
            self._is(other, "class", "function") for statement in _statements(place) for ref in statement["refs"]
            for other in places(self.modules, place.module, ref) if place.module and other.module)  # type: ignore[arg-type]

    @staticmethod
    def _is(place: Place, *kinds: str) -> bool:
        """Whether a place is a definition of one of these kinds: 'class', 'function'."""
        return any(statement.get("kind") in kinds for statement in _statements(place))
