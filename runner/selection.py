"""Declarations of the backends of a stage, and removal of unselected backends from the key.

A registry of a stage is a literal dict ``name -> "module:attribute"`` that its module defines or imports. The field `backend` of
Params selects from `BACKENDS`, `refine` from `REFINES`. A field of Params named after an entry holds that entry's parameters as a
frozen dataclass (`-` in the entry's name becomes `_`):

    BACKENDS = {"flow": "afford.flow:propagate", "sam2": "afford.sam2:propagate"}
    LIBRARIES = ("numpy",)                                    needed by every backend
    BACKEND_LIBRARIES = {"sam2": ("torch", "transformers")}   needed by this backend as well
    BACKEND_MEMORY_GIB = {"sam2": 6.0}                        replaces MEMORY_GIB; likewise all others below

    @dataclass(frozen=True)
    class Params:
        backend: str = "flow"
        flow: Flow = Flow()
        sam2: Sam2 = Sam2()

What a stage declares, each with a default:

    LIBRARIES = ("numpy",)    distributions whose versions are in the key; default: none
    THREADS = 1               CPU threads; part of the key, because the number of threads may decide the last bits
    MACHINE = False           True, or a parameter that makes the bytes depend on the kind of machine where it is set, and not "cpu"
    MEMORY_GIB = 1.0          memory of the process that runs the stage, its libraries included
    GPUS = 0                  a number; or the name of a parameter ("device", "sam2.device"): one GPU if its value starts with
                              "cuda"; or ("device", "devices"): as many as the second parameter says
    GPU_SHARED = False        True: other tasks that say so may use the same GPU at the same time
    SCRATCH_GIB = 0.0         disk space for files in the scratch folder
    TIMEOUT_S = 3600.0        the task fails after so many seconds without progress; reports through ctx restart the clock

Memory, GPUs, scratch and time-outs decide where and when a task runs, never its bytes, and are in no key.

With backend="flow", the key contains neither the values of `sam2`, nor the class Sam2, nor the version of torch. `Unselected`
replaces the block, and raises an error when the stage reads one of its attributes.
"""

from __future__ import annotations

import copy
import dataclasses
from collections.abc import Iterable, Iterator, Mapping
from typing import Any

from runner.modules import Modules
from runner.references import referents
from runner.source import Module

NUMBER = (int, float)
KINDS: dict[str, type | tuple[type, ...]] = {
    "LIBRARIES": list, "THREADS": int, "MEMORY_GIB": NUMBER, "MACHINE": (bool, str), "GPUS": (int, str, list), "GPU_SHARED": bool,
    "SCRATCH_GIB": NUMBER, "TIMEOUT_S": NUMBER}
DEFAULTS: dict[str, Any] = {
    "LIBRARIES": [], "THREADS": 1, "MEMORY_GIB": 1.0, "MACHINE": False, "GPUS": 0, "GPU_SHARED": False, "SCRATCH_GIB": 0.0,
    "TIMEOUT_S": 3600.0}
LOGICAL = ("MACHINE", "GPU_SHARED")
"""declarations that may be True or False"""
SHAPE = ('LIBRARIES = ("name", ...), THREADS = int, MEMORY_GIB, SCRATCH_GIB and TIMEOUT_S = float, GPU_SHARED = bool, '
         'MACHINE = True or the name of a parameter, or of a parameter of a block ("block.name"), GPUS = int, or the name of a '
         'parameter, or ("device", "devices"), as literals; BACKEND_LIBRARIES = {"entry": ("name", ...)} and so on for the entries '
         "of BACKENDS")


def selected_entries(value: object, entries: Mapping[str, str]) -> list[str]:
    """Entries of a registry that a parameter selects: one name, or a tuple of names.

    All entries without such a parameter. A frozenset comes from a codec's `selects`, and is used unchanged.
    """
    if isinstance(value, frozenset):
        return sorted(value & entries.keys())
    names = sorted({name for name in value if isinstance(name, str)}) if isinstance(value, tuple) else [value]
    return [name for name in names if isinstance(name, str)] if names and all(n in entries for n in names) else sorted(entries)


def selector(registry: str) -> str:
    """Name of the Params field that selects from a registry: `backend` from BACKENDS, `policy` from POLICIES."""
    name = registry.lower()
    return f"{name.removesuffix('ies')}y" if name.endswith("ies") else name.removesuffix("s")


def select_of(params: object) -> dict[str, object]:
    """Map each field of Params to its value."""
    fields = () if params is None else dataclasses.fields(params)  # type: ignore[arg-type]  # a dataclass, see `Graph.add`
    return {field.name: getattr(params, field.name) for field in fields}


def unselected(modules: Modules, module: str, select: Mapping[str, object]) -> frozenset[str]:
    """Names of the fields that hold parameters of entries that are not selected."""
    known, picked = set[str](), set[str]()
    for field, entries in registries_of(modules, module):
        if field in select:
            known |= entries.keys()
            picked.update(selected_entries(select[field], entries))
    return frozenset(name.replace("-", "_") for name in known - picked)


def declarations(modules: Modules, module: str, select: Mapping[str, object] | None = None) -> dict[str, Any]:
    """Declarations of a stage's module under these parameters, by name.

    Of several backends, and without parameters of all of them, the largest value counts. MACHINE is True, False or a list of
    parameter names. GPUS is a list of its different values. ValueError when a declaration has the wrong type.
    """
    found = modules.get(module)
    literals = found.literals if found else {}
    own = {name: _checked(module, name, literals.get(name, default)) for name, default in DEFAULTS.items()}
    special: dict[str, list[Any]] = {name: [own[name]] for name in KINDS}
    tables = {name for name, table in literals.items() if isinstance(table, dict)}
    for field, entries in registries_of(modules, module):
        names = selected_entries((select or {}).get(field), entries)
        for kind in KINDS:
            name = f"{field.upper()}_{kind}"
            tables.discard(name)
            if name in literals:
                table = _of_entries(module, name, literals[name], entries)
                values = [_checked(module, kind, table[entry]) if entry in table else own[kind] for entry in names]
                special[kind] = values if special[kind] == [own[kind]] else [*special[kind], *values]
    if tables:
        raise ValueError(f"{module}: {min(tables)} belongs to no registry of this module; expected {SHAPE}")
    return _together(own["LIBRARIES"], special)


def _together(libraries: list[str], values: Mapping[str, list[Any]]) -> dict[str, Any]:
    """One value of each declaration from those of the selected backends."""
    machines = [value for value in values["MACHINE"] if value]
    return {"LIBRARIES": sorted({name for names in (libraries, *values["LIBRARIES"]) for name in names}),
            "THREADS": max(values["THREADS"]), "MEMORY_GIB": float(max(values["MEMORY_GIB"])),
            "MACHINE": True if True in machines else machines,
            "GPUS": [value for at, value in enumerate(values["GPUS"]) if value and value not in values["GPUS"][:at]],
            "GPU_SHARED": all(values["GPU_SHARED"]), "SCRATCH_GIB": float(max(values["SCRATCH_GIB"])),
            "TIMEOUT_S": float(max(values["TIMEOUT_S"]))}


def hide_unselected(params: Any, blocks: Iterable[str]) -> Any:
    """Copy Params with `Unselected` in place of the unselected blocks."""
    names = [name for name in blocks if _is_block(params, name)]
    if not names:
        return params
    reduced = copy.copy(params)
    for name in names:
        object.__setattr__(reduced, name, Unselected(name))  # bypasses the checks of Params, which would read the block
    return reduced


def without_blocks(tree: Any, params: Any, blocks: Iterable[str]) -> Any:
    """Canonical tree of Params without the unselected blocks."""
    gone = {name for name in blocks if _is_block(params, name)}
    return tree if not gone else tree | {"fields": {name: value for name, value in tree["fields"].items() if name not in gone}}


class Unselected:
    """Placeholder for the parameters of an unselected backend, which are not part of the key.

    Reading an attribute is a ValueError.
    """

    def __init__(self, name: str) -> None:
        self.__dict__["_block"] = name

    def __getattr__(self, name: str) -> Any:
        if name.startswith("__"):
            raise AttributeError(name)
        raise ValueError(f"params.{self.__dict__['_block']}.{name} belongs to a backend that is not selected, and is not in the "
                         "key; read only the block of the selected backend")

    def __repr__(self) -> str:
        return f"<{self.__dict__['_block']} is not selected>"

    def __reduce__(self) -> tuple[type[Unselected], tuple[str]]:
        return Unselected, (self.__dict__["_block"],)


def _is_block(params: Any, name: str) -> bool:
    value = getattr(params, name, None)
    return dataclasses.is_dataclass(value) and not isinstance(value, type)


def registries_of(modules: Modules, module: str) -> Iterator[tuple[str, dict[str, str]]]:
    """Yield (selecting field, entries) for every registry that a module defines or imports."""
    found = modules.get(module)
    for name in sorted({*found.registries, *(name for name in found.imports if name.isupper())}) if found else ():
        for home, item in _homes(modules, found, name):  # type: ignore[arg-type]  # not None, see above
            if item in home.registries:
                yield selector(item), home.registries[item]


def _homes(modules: Modules, module: Module, name: str) -> Iterator[tuple[Module, str]]:
    if name in module.registries:
        yield module, name
        return
    for place in referents(modules, module, name):
        if place.module is not None and place.item is not None and len(place.chain) == 1:
            yield place.module, place.item


def _of_entries(module: str, name: str, table: Any, entries: Mapping[str, str]) -> dict[str, Any]:
    """Check a table of declarations by entry; ValueError for unknown entries or another form."""
    if not isinstance(table, dict) or not table.keys() <= entries.keys():
        known = ", ".join(sorted(entries))
        raise ValueError(f"{module}: {name}: expected entries of the registry ({known}), got {table}; correct the names")
    return table


def _checked(module: str, kind: str, value: Any) -> Any:
    fits = isinstance(value, KINDS[kind]) and (kind in LOGICAL or not isinstance(value, bool))
    if isinstance(value, NUMBER):
        fits = fits and (value > 0 if kind in ("THREADS", "TIMEOUT_S") else value >= 0)
    if kind == "GPUS" and isinstance(value, list):
        fits = len(value) == 2 and all(isinstance(name, str) for name in value)
    if not fits:
        raise ValueError(f"{module}: expected {SHAPE}, got {kind} = {value!r}")
    return value
