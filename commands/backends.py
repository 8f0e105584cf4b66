"""`backends`: every backend of every stage: what it does, what it needs, whether it can be used here, and why not."""

from __future__ import annotations

import ast
import importlib.util
import json as encoder
import os
import re
import sys
from collections.abc import Iterable
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Any

from rich.console import Console
from rich.markup import escape
from rich.padding import Padding

from afford.common.registry import block
from commands.errors import UsageError, unknown
from commands.settings import settings
from maps.settings import SYSTEM_OF, Settings
from runner.fingerprint import fingerprint
from runner.modules import Modules
from runner.selection import selector

ROOT = Path(__file__).resolve().parent.parent
DECLARATIONS = ("WEIGHTS", "SERVER", "EXTRA", "PACKAGES")
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


def backends_of(stage: str) -> list[Backend]:
    """The backends of a stage; none for a name that no stage has."""
    return [one for path in (ROOT / "stages").glob(f"*/{stage}.py") for one in _of(_modules(), _name(path))]


def _name(path: Path) -> str:
    """The module of a file."""
    return ".".join(path.relative_to(ROOT).with_suffix("").parts)


def all_backends() -> list[Backend]:
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
    return [Backend(owner, registry, name, entry, **_said(name, entry, _shared(entry, entries.values())))
            for registry, entries in registries.items() for name, entry in entries.items()]


def _shared(entry: str, entries: Iterable[str]) -> bool:
    """Whether the module of an entry holds another entry of the registry."""
    module = entry.partition(":")[0]
    return any(other != entry and other.partition(":")[0] == module for other in entries)


@cache
def _said(name: str, entry: str, shared: bool) -> dict[str, Any]:
    """Sentence of a backend from its module, or from its own docstring where a module holds several; and what the backend needs.

    A module that serves several backends has a dict of needs by name.
    """
    module, _, attribute = entry.partition(":")
    tree = ast.parse((ROOT / Path(*module.split("."))).with_suffix(".py").read_text(encoding="utf-8"))
    own = [node for node in tree.body if isinstance(node, (ast.FunctionDef, ast.ClassDef)) and node.name == attribute]
    said = ast.get_docstring(tree) or ""
    constants = {node.targets[0].id: ast.literal_eval(node.value) for node in tree.body
                 if isinstance(node, ast.Assign) and isinstance(node.targets[0], ast.Name) and node.targets[0].id in DECLARATIONS}
    mine = ast.get_docstring(own[0]) if own and shared else None
    return {"about": _sentence(mine or said), **{
        need.lower(): value.get(name, "") if isinstance(value, dict) else value for need, value in constants.items()}}


def _sentence(text: str) -> str:
    """The first paragraph up to the end of its first sentence."""
    line = " ".join(text.partition("\n\n")[0].split())
    told = STOP.split(line, maxsplit=1)[0].rstrip(".").removeprefix(DECIDES)
    return f"{told[:1].upper()}{told[1:]}."


def third_party(backend: Backend) -> set[str]:
    """Import names of the packages that the code of a backend reaches, and of those that its extra brings."""
    select = {selector(backend.registry): backend.name}
    return set(fingerprint(_modules(), backend.entry, select).third_party) | set(backend.packages)


@cache
def _modules() -> Modules:
    return Modules(ROOT)


PIPED_WIDTH = 100
"""columns where no terminal says how many"""


@dataclass(frozen=True)
class Row:
    """One line of the table."""

    stage: str
    parameter: str
    """what chooses it: STAGE.backend, or MODULE:REGISTRY where parameters of other names do"""
    backend: str
    about: str
    needs: str
    usable: bool
    why_not: str


def show(stage: str | None, sets: Iterable[str], file: Path | None, json: bool, out: Path | None) -> int:
    """Print the table, or write it as Markdown to `out`; settings may name models, which are then looked at. Nothing heavy is
    imported, nothing fetched. UsageError for an unknown stage.
    """
    found = rows(settings(sets, file), (stage or "").replace("-", "_"))
    if out:
        _write(out, markdown(found))
    elif json:
        sys.stdout.write(encoder.dumps([vars(row) for row in found]) + "\n")
    else:
        _print(found)
    return 0


def rows(chosen: Settings, stage: str = "") -> list[Row]:
    """Every entry of every registry, in the order of the stages, or those of one. UsageError when it has none."""
    owners = {one.stage for one in all_backends()}
    if stage and stage not in owners:
        raise unknown("stage with backends", stage, owners)
    wanted = [one for one in all_backends() if stage in ("", one.stage)]
    return [_row(one, _params(chosen, one.stage)) for one in wanted]


def _params(chosen: Settings, stage: str) -> Any:
    """The parameters of a stage, None for what is no stage with parameters of its own."""
    return chosen.params(stage) if stage in SYSTEM_OF else None


def markdown(found: list[Row]) -> str:
    """The table of docs/backends.md: what there is and what it needs, without what this machine has."""
    lines = ["| chosen by | backend | what it does | needs |", "|---|---|---|---|"]
    return "\n".join([*lines, *(f"| {row.parameter} | `{row.backend}` | {row.about} | {row.needs} |" for row in found)]) + "\n"


def _row(backend: Backend, params: Any) -> Row:
    owner, field = backend.stage, selector(backend.registry)
    chosen_by = f"{owner}.{field}" if backend.owner != owner else f"{owner}:{backend.registry}"
    wants = [f"weights: {backend.weights}"] if backend.weights else []
    wants += [f"server: {backend.server}"] if backend.server else []
    wants += [f"extra `{backend.extra}`"] if backend.extra else []
    reasons = (_packages(backend), _weights(backend, owner, params), _server(backend, owner, params))
    why = "; ".join(reason for reason in reasons if reason)
    return Row(owner, chosen_by, backend.name, backend.about, "; ".join(wants), not why, why)


def _packages(backend: Backend) -> str:
    """Which packages are missing, '' for none."""
    missing = [name for name in sorted(third_party(backend)) if importlib.util.find_spec(name) is None]
    hint = f"; make setup EXTRA={backend.extra}" if backend.extra else "; make setup"
    return f"not installed: {', '.join(missing)}{hint}" if missing else ""


def _weights(backend: Backend, owner: str, params: Any) -> str:
    """Whether the files of the model that the settings name are here, by their names alone."""
    if not backend.weights:
        return ""
    own = block(params, backend.name)
    model = getattr(own, "model", "") if getattr(params, "backend", "") == backend.name else ""
    if not model:
        return f"no weights named; --set {owner}.backend={backend.name} --set {owner}.{backend.name}.model=FOLDER"
    place = Path(model).expanduser()
    if place.is_file() or (place.is_dir() and any(place.rglob("*.safetensors")) and any(place.rglob("*.json"))):
        return ""
    if place.exists():
        return f"{model}: expected .json and .safetensors files of a model, got none"
    return "" if _in_cache(model) else f"{model}: no such folder, and no such hub id among what was downloaded"


def _in_cache(model: str) -> bool:
    """Whether a hub id was downloaded before, in the revision that it names."""
    from huggingface_hub import try_to_load_from_cache
    from huggingface_hub.errors import HFValidationError

    from afford.models.weights import split_revision

    try:
        repository, revision = split_revision(model)
        return isinstance(try_to_load_from_cache(repository, "config.json", revision=revision), str)
    except HFValidationError:  # a path
        return False


def _server(backend: Backend, owner: str, params: Any) -> str:
    """Whether an address and a key are given; the key is not looked at, and nobody is asked."""
    if not backend.server:
        return ""
    own = block(params, backend.name)
    if not getattr(own, "url", ""):
        return f"no server named; --set {owner}.backend={backend.name} --set {owner}.{backend.name}.url=http://HOST:PORT/v1"
    variable = getattr(own, "key_variable", "")
    return f"environment variable {variable} is not set" if variable and variable not in os.environ else ""


def _print(found: list[Row]) -> None:
    """A block for each: what chooses it and whether it can be used here, then what it does and needs, wrapped; nothing is cut."""
    console = Console(width=None if sys.stdout.isatty() else PIPED_WIDTH)
    for row in found:
        here = "[green]here[/]" if row.usable else "[red]not here[/]"
        console.print(f"[bold]{row.parameter}[/] = [bold]{row.backend}[/]  {here}", highlight=False, overflow="fold")
        needs = f"needs {row.needs}" if row.needs else ""
        why = f"not here, for {row.why_not}" if row.why_not else ""
        for text in filter(None, (row.about, needs, why)):
            console.print(Padding(escape(text), (0, 0, 0, 4)), highlight=False, overflow="fold")


def _write(out: Path, table: str) -> None:
    """Between the marks of a page that has them."""
    text = out.read_text(encoding="utf-8") if out.is_file() else ""
    before, start, rest = text.partition(START)
    _, end, after = rest.partition(END)
    if not (start and end):
        raise UsageError(f"--out {out}: expected a page with the lines {START} and {END}, between which the table is written")
    out.write_text(f"{before}{START}\n{table}{END}{after}", encoding="utf-8")


START, END = "<!-- backends: written by `pipeline.py backends --out` -->", "<!-- /backends -->"
