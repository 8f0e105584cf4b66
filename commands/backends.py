"""The verb `backends`: for each backend of each stage, its task, its requirements, and whether it is usable here.

Descriptions are read from source files; no backend is imported.
"""

from __future__ import annotations

import ast
import importlib.util
import json as encoder
import os
import re
import sys
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Any

from rich.console import Console
from rich.markup import escape
from rich.padding import Padding

from afford.common.registry import block
from commands.errors import UsageError, unknown
from commands.memory import measured_by_selection
from commands.session import STORE, open_existing
from commands.settings import settings
from maps.settings import SYSTEM_OF, Settings
from runner import is_store
from runner.fingerprint import fingerprint
from runner.modules import Modules
from runner.selection import declarations, selector

ROOT = Path(__file__).resolve().parent.parent
DECLARATIONS = ("WEIGHTS", "SERVER", "EXTRA", "PACKAGES", "MET")
"""constants of a backend's module: weights, a server, an extra of pyproject.toml, its packages, and what it has met (`LEVELS`)"""
LEVELS = ("published weights", "authors' package, random weights", "published size, random weights", "tiny random weights",
          "server of the tests")
"""beginnings of MET, the strongest evidence first; then a month and what was seen: 'LEVEL, YYYY-MM: figure or fact'"""
CHECKS = "CHECKED"
"""name of registries of checks, which no parameter selects"""
DECIDES = "Everything that decides "
"""prefix of a training module's docstring, before the description of the backend"""
STOP = re.compile(r"(?<!\bal)(?<!\be\.g)(?<!\bi\.e)(?<!\bcf)\. ")
"""end of a sentence, except in `et al.` and similar"""


@dataclass(frozen=True)
class Backend:
    """One entry of a registry."""

    owner: str
    """module of the registry: 'stages.extraction.mask_densify'"""
    registry: str
    name: str
    entry: str
    """'module:attribute'"""
    about: str
    """first sentence of its docstring"""
    weights: str = ""
    server: str = ""
    extra: str = ""
    packages: tuple[str, ...] = ()
    met: str = ""

    @property
    def stage(self) -> str:
        """Stage of the registry; the full module name for a registry outside the stages."""
        return self.owner.rpartition(".")[2] if self.owner.startswith("stages.") else self.owner

    @property
    def module(self) -> str:
        """Module of the backend."""
        return self.entry.partition(":")[0]


def backends_of(stage: str) -> list[Backend]:
    """Backends of a stage; none for an unknown name."""
    return [one for path in (ROOT / "stages").glob(f"*/{stage}.py") for one in _of(_modules(), _name(path))]


def _name(path: Path) -> str:
    """Module name of a file."""
    return ".".join(path.relative_to(ROOT).with_suffix("").parts)


def all_backends() -> list[Backend]:
    """Backends of every stage, then those of `afford` registries that stages select from by other names.

    A registry with the same entries as a stage's registry is omitted.
    """
    inside = [path for path in sorted((ROOT / "afford").rglob("*.py")) if not path.is_relative_to(ROOT / "afford" / "codecs")]
    stages = sorted((ROOT / "stages").glob("*/*.py"), key=lambda path: path.name)
    paths = [*stages, *inside]  # registries of the codecs are not for users
    names = [_name(path) for path in paths if '": "afford.' in path.read_text()]
    held = {name: _of(_modules(), name) for name in names}
    chosen = {_choice(found) for name, found in held.items() if name.startswith("stages.")}
    return [one for name, found in held.items() if name.startswith("stages.") or _choice(found) not in chosen for one in found]


def _choice(found: Iterable[Backend]) -> frozenset[tuple[str, str]]:
    """Registry and entry names of a module, for comparison."""
    return frozenset((one.registry, one.name) for one in found)


def _of(modules: Modules, owner: str) -> list[Backend]:
    found = modules.get(owner)
    registries = found.registries if found else {}
    return [Backend(owner, registry, name, entry, **_declared(name, entry, _shared(entry, entries.values())))
            for registry, entries in registries.items() if registry != CHECKS for name, entry in entries.items()]


def _shared(entry: str, entries: Iterable[str]) -> bool:
    """Return True when the module of an entry holds another entry of the registry."""
    module = entry.partition(":")[0]
    return any(other != entry and other.partition(":")[0] == module for other in entries)


@cache
def _declared(name: str, entry: str, shared: bool) -> dict[str, Any]:
    """Description and requirements of a backend.

    The description is from its module, or from its own docstring if several backends share the module. Such a module declares its
    requirements in dicts by name.
    """
    module, _, attribute = entry.partition(":")
    found = _modules().get(module)
    tree = ast.parse(Path(found.path).read_text(encoding="utf-8") if found else "")
    own = [node for node in tree.body if isinstance(node, (ast.FunctionDef, ast.ClassDef)) and node.name == attribute]
    module_text = ast.get_docstring(tree) or ""
    constants = {node.targets[0].id: ast.literal_eval(node.value) for node in tree.body
                 if isinstance(node, ast.Assign) and isinstance(node.targets[0], ast.Name) and node.targets[0].id in DECLARATIONS}
    own_text = ast.get_docstring(own[0]) if own and shared else None
    return {"about": _sentence(own_text or module_text), **{
        need.lower(): value.get(name, "") if isinstance(value, dict) else value for need, value in constants.items()}}


def _sentence(text: str) -> str:
    """First sentence of the first paragraph."""
    line = " ".join(text.partition("\n\n")[0].split())
    sentence = STOP.split(line, maxsplit=1)[0].rstrip(".").removeprefix(DECIDES)
    return f"{sentence[:1].upper()}{sentence[1:]}."


def third_party(backend: Backend) -> set[str]:
    """Import names of the packages that the code of a backend reaches, and of those of its extra."""
    select = {selector(backend.registry): backend.name}
    return set(fingerprint(_modules(), backend.entry, select).third_party) | set(backend.packages)


@cache
def _modules() -> Modules:
    return Modules(ROOT)


PIPED_WIDTH = 100
"""width in columns without a terminal"""


@dataclass(frozen=True)
class Row:
    """One row of the table."""

    stage: str
    parameter: str
    """parameter that selects it: STAGE.backend, or MODULE:REGISTRY for parameters of other names"""
    backend: str
    about: str
    needs: str
    usable: bool
    why_not: str
    met: str = ""
    """weights that a learned backend has met (`LEVELS`), when, and with which result"""
    resources: str = ""
    """memory, declared and measured, and the parameter that chooses a GPU"""


def show(stage: str | None, sets: Iterable[str], file: Path | None, json: bool, out: Path | None) -> int:
    """Print the table, or write it as Markdown to `out`.

    Models that the settings name are looked up. Nothing heavy is imported and nothing is downloaded. UsageError for an unknown
    stage.
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
    """Rows of every registry entry, in the order of the stages, or those of one stage.

    UsageError when the stage has no backends.
    """
    owners = {one.stage for one in all_backends()}
    if stage and stage not in owners:
        raise unknown("stage with backends", stage, owners)
    wanted = [one for one in all_backends() if stage in ("", one.stage)]
    measured = measured_by_selection(open_existing()) if is_store(STORE) else {}
    return [_row(one, _params(chosen, one.stage), measured) for one in wanted]


def _params(chosen: Settings, stage: str) -> Any:
    """Parameters of a stage; None for a module that is not a stage with parameters."""
    return chosen.params(stage) if stage in SYSTEM_OF else None


def markdown(found: list[Row]) -> str:
    """Table of docs/backends.md: backends and their requirements, independent of this machine."""
    lines = ["| chosen by | backend | what it does | needs | has met |", "|---|---|---|---|---|"]
    lines += [f"| {row.parameter} | `{row.backend}` | {row.about} | {row.needs} | {row.met} |" for row in found]
    return "\n".join(lines) + "\n"


def _row(backend: Backend, params: Any, measured: Mapping[tuple[str, str, str], float]) -> Row:
    owner, field = backend.stage, selector(backend.registry)
    chosen_by = f"{owner}.{field}" if backend.owner != owner else f"{owner}:{backend.registry}"
    wants = [f"weights: {backend.weights}"] if backend.weights else []
    wants += [f"server: {backend.server}"] if backend.server else []
    wants += [f"extra `{backend.extra}`"] if backend.extra else []
    reasons = (_packages(backend), _weights(backend, owner, params), _server(backend, owner, params))
    why = "; ".join(reason for reason in reasons if reason)
    return Row(owner, chosen_by, backend.name, backend.about, "; ".join(wants), not why, why, backend.met,
               _resources(backend, field, measured))  # fmt: skip


def _resources(backend: Backend, field: str, measured: Mapping[tuple[str, str, str], float]) -> str:
    """Declared and measured memory of a backend, and its GPUs; '' for a registry outside the stages."""
    if not backend.owner.startswith("stages."):
        return ""
    declared = declarations(_modules(), backend.owner, {field: backend.name})
    peak = measured.get((backend.owner, field, backend.name))
    parts = [f"memory {declared['MEMORY_GIB']:g} GiB" + (f", measured {peak:.1f}" if peak else "")]
    for gpus in declared["GPUS"]:
        named = gpus if isinstance(gpus, str) else ", ".join(gpus) if isinstance(gpus, list) else ""
        parts.append(f"GPU by {named}" if named else f"GPUs: {gpus}")
    return "; ".join(parts)


def _packages(backend: Backend) -> str:
    """Missing packages, '' for none."""
    missing = [name for name in sorted(third_party(backend)) if importlib.util.find_spec(name) is None]
    hint = f"; make setup EXTRA={backend.extra}" if backend.extra else "; make setup"
    return f"not installed: {', '.join(missing)}{hint}" if missing else ""


def _weights(backend: Backend, owner: str, params: Any) -> str:
    """Reason why the model files that the settings name are missing here, '' if they exist."""
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
        return f"{model}: no .json and .safetensors files of a model; name the folder of a model"
    return "" if _in_cache(model) else f"{model}: no such folder, and no such hub id in the download cache"


def _in_cache(model: str) -> bool:
    """Return True when a hub id was downloaded before, in the revision that it names."""
    from huggingface_hub import try_to_load_from_cache
    from huggingface_hub.errors import HFValidationError

    from afford.models.weights import split_revision

    try:
        repository, revision = split_revision(model)
        return isinstance(try_to_load_from_cache(repository, "config.json", revision=revision), str)
    except HFValidationError:  # a path
        return False


def _server(backend: Backend, owner: str, params: Any) -> str:
    """Reason why the server cannot be used, '' if an address and a key are given.

    The key is not read, and no request is sent.
    """
    if not backend.server:
        return ""
    own = block(params, backend.name)
    if not getattr(own, "url", ""):
        return f"no server named; --set {owner}.backend={backend.name} --set {owner}.{backend.name}.url=http://HOST:PORT/v1"
    variable = getattr(own, "key_variable", "")
    return f"environment variable {variable} is not set" if variable and variable not in os.environ else ""


def _print(found: list[Row]) -> None:
    """Print one block per backend: parameter and usability, then description and requirements, wrapped."""
    console = Console(width=None if sys.stdout.isatty() else PIPED_WIDTH)
    for row in found:
        here = "[green]usable[/]" if row.usable else "[red]not usable[/]"
        console.print(f"[bold]{row.parameter}[/] = [bold]{row.backend}[/]  {here}", highlight=False, overflow="fold")
        needs = f"needs {row.needs}" if row.needs else ""
        met = f"has met {row.met}" if row.met else ""
        why = f"not usable here: {row.why_not}" if row.why_not else ""
        for text in filter(None, (row.about, needs, met, row.resources, why)):
            console.print(Padding(escape(text), (0, 0, 0, 4)), highlight=False, overflow="fold")


def _write(out: Path, table: str) -> None:
    """Write the table between the markers of a page."""
    text = out.read_text(encoding="utf-8") if out.is_file() else ""
    before, start, rest = text.partition(START)
    _, end, after = rest.partition(END)
    if not (start and end):
        raise UsageError(f"--out {out}: the page lacks the lines {START} and {END}, between which the table is written")
    out.write_text(f"{before}{START}\n{table}{END}{after}", encoding="utf-8")


START, END = "<!-- backends: written by `pipeline.py backends --out` -->", "<!-- /backends -->"
