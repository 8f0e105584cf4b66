"""Which backends there are and what they say of themselves, read from source: nothing is imported."""

from __future__ import annotations

import ast
import re
from collections.abc import Iterable
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Any

from runner.fingerprint import fingerprint
from runner.modules import Modules

ROOT = Path(__file__).resolve().parent.parent
SAID = ("WEIGHTS", "SERVER", "EXTRA", "PACKAGES")
"""constants by which the module of a backend says what it needs: weights, a server, an extra of pyproject.toml and its packages"""
DECIDES = "Everything that decides "
"""how the module of a training begins; what follows is what the backend does"""
STOP = re.compile(r"(?<!\bal)(?<!\be\.g)(?<!\bi\.e)(?<!\bcf)\. ")
"""the end of a sentence; `et al.` is none"""


@dataclass(frozen=True)
class Backend:
    """One entry of a registry."""

    owner: str
    """module that holds the registry: 'stages.extraction.mask_densify'"""
    registry: str
    name: str
    entry: str
    """'module:attribute'"""
    about: str
    """what it does, in its own words"""
    weights: str = ""
    server: str = ""
    extra: str = ""
    packages: tuple[str, ...] = ()

    @property
    def stage(self) -> str:
        """The stage that holds the registry; the full name of a module that is no stage."""
        return self.owner.rpartition(".")[2] if self.owner.startswith("stages.") else self.owner

    @property
    def module(self) -> str:
        return self.entry.partition(":")[0]


def of_stage(stage: str) -> list[Backend]:
    """The backends of a stage; none for a name that no stage has."""
    return [one for path in (ROOT / "stages").glob(f"*/{stage}.py") for one in _of(_modules(), _name(path))]


def _name(path: Path) -> str:
    """The module of a file."""
    return ".".join(path.relative_to(ROOT).with_suffix("").parts)


def everywhere() -> list[Backend]:
    """Those of every stage, then those of `afford` that stages choose from by other names; not those that only find the other
    half of what a stage has chosen.
    """
    inside = [path for path in sorted((ROOT / "afford").rglob("*.py")) if not path.is_relative_to(ROOT / "afford" / "codecs")]
    stages = sorted((ROOT / "stages").glob("*/*.py"), key=lambda path: path.name)
    paths = [*stages, *inside]  # how a codec writes a field is no choice of a user
    names = [_name(path) for path in paths if '": "afford.' in path.read_text()]
    held = {name: _of(_modules(), name) for name in names}
    chosen = {_choice(found) for name, found in held.items() if name.startswith("stages.")}
    return [one for name, found in held.items() if name.startswith("stages.") or _choice(found) not in chosen for one in found]


def _choice(found: Iterable[Backend]) -> frozenset[tuple[str, str]]:
    """Between what a module chooses."""
    return frozenset((one.registry, one.name) for one in found)


def _of(modules: Modules, owner: str) -> list[Backend]:
    found = modules.get(owner)
    registries = found.registries if found else {}
    return [Backend(owner, registry, name, entry, **_said(entry, _shared(entry, entries.values())))
            for registry, entries in registries.items() for name, entry in entries.items()]


def _shared(entry: str, entries: Iterable[str]) -> bool:
    """Whether several entries of a registry lie in the same module."""
    module = entry.partition(":")[0]
    return sum(other.partition(":")[0] == module for other in entries) > 1


@cache
def _said(entry: str, shared: bool) -> dict[str, Any]:
    """The sentence of a backend: of its module, or of its own where a module holds several; and what it needs."""
    module, _, attribute = entry.partition(":")
    tree = ast.parse((ROOT / Path(*module.split("."))).with_suffix(".py").read_text(encoding="utf-8"))
    own = [node for node in tree.body if isinstance(node, (ast.FunctionDef, ast.ClassDef)) and node.name == attribute]
    said = ast.get_docstring(tree) or ""
    constants = {node.targets[0].id: ast.literal_eval(node.value) for node in tree.body
                 if isinstance(node, ast.Assign) and isinstance(node.targets[0], ast.Name) and node.targets[0].id in SAID}
    mine = ast.get_docstring(own[0]) if own and shared else None
    return {"about": _sentence(mine or said), **{name.lower(): value for name, value in constants.items()}}


def _sentence(text: str) -> str:
    """The first paragraph up to the end of its first sentence."""
    line = " ".join(text.partition("\n\n")[0].split())
    told = STOP.split(line, maxsplit=1)[0].rstrip(".").removeprefix(DECIDES)
    return f"{told[:1].upper()}{told[1:]}."


def third_party(backend: Backend) -> set[str]:
    """Import names of the packages that the code of a backend reaches, and of those that its extra brings."""
    return set(fingerprint(_modules(), backend.entry, {}).third_party) | set(backend.packages)


@cache
def _modules() -> Modules:
    return Modules(ROOT)
