"""Parameters by backend: each block of a stage belongs to one backend, which reads all of its fields and no other block."""

from __future__ import annotations

import ast
import dataclasses
import importlib
import inspect
import shutil
import typing
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

from commands.settings import blocks
from runner.canonical import canonical
from runner.fingerprint import fingerprint
from runner.modules import Modules
from runner.selection import declarations, registries_of, select_of, unselected, without_blocks
from tests.helpers.stage_files import MODULES

ROOT = Path(__file__).resolve().parents[2]
BY_STAGE = {"hand_model"}
"""stages that also read the block of the selected backend themselves"""
READERS = {"endpoint": ("afford.models.chat_endpoint",), "vlm": ("afford.models.chat_model",), "umd": ("afford.rgbd.readers.umd",)}
"""backend -> modules that receive its parameters"""
QUESTIONS = 11
"""Protocols of backends that have parameters of their own"""


def entries(stage: str) -> dict[str, str]:
    """name -> 'module:attribute' of the backends of a stage."""
    registry: dict[str, str] = getattr(importlib.import_module(MODULES[stage]), "BACKENDS", {})
    return registry


def defaults(stage: str) -> Any:
    return importlib.import_module(MODULES[stage]).Params()


STAGES = [stage for stage in MODULES if entries(stage) and blocks(defaults(stage))]


def own(stage: str, name: str) -> Any:
    """Return the block of a backend, None for one without."""
    return getattr(defaults(stage), name.replace("-", "_"), None)


def changed(stage: str, name: str) -> Iterator[Any]:
    """Params of the default backend with another block of `name`, one field after the other."""
    block = own(stage, name)
    for field in dataclasses.fields(block):
        value = getattr(block, field.name)
        other = not value if isinstance(value, bool) else f"{value}X" if isinstance(value, str) else (*value, "a=b") if isinstance(
            value, tuple) else value * 2 or 1  # fmt: skip
        if field.name in ("url", "key_variable"):
            other = {"url": "http://127.0.0.1:1/v1", "key_variable": "OTHER"}[field.name]
        yield dataclasses.replace(defaults(stage), **{name.replace("-", "_"): dataclasses.replace(block, **{field.name: other})})


def test_stages_have_blocks() -> None:
    """Every stage with backends that have parameters is tested here."""
    assert set(STAGES) >= {"mask_densify", "hand_inpaint", "object_completion", "hand_detect", "mask_propose", "mask_score",
                           "part_describe", "mesh_texture", "grasp_judge", "scene_flow", "static_read", "static_evaluate",
                           "hand_model"}  # fmt: skip


@pytest.mark.parametrize("stage", STAGES)
def test_a_block_is_named_after_a_backend(stage: str) -> None:
    """The runner reads from the name when the block counts."""
    assert blocks(defaults(stage)).keys() <= {name.replace("-", "_") for name in entries(stage)}


@pytest.mark.parametrize("stage", STAGES)
def test_a_backend_takes_its_own_block(stage: str) -> None:
    """The annotation of `params` is the type of the block, None for a backend without."""
    for name, entry in entries(stage).items():
        module, _, attribute = entry.partition(":")
        function = getattr(importlib.import_module(module), attribute)
        if stage in BY_STAGE:
            assert "params" not in inspect.signature(function).parameters
            continue
        hint = typing.get_type_hints(function)["params"]
        assert hint is (type(None) if own(stage, name) is None else type(own(stage, name))), (stage, name)


@pytest.mark.parametrize("stage", STAGES)
def test_a_backend_reads_every_field_of_its_block(stage: str) -> None:
    """Every field of a block is read in the modules of its backend."""
    for name, entry in entries(stage).items():
        block = own(stage, name)
        readers = [MODULES[stage]] if stage in BY_STAGE else [entry.partition(":")[0], *READERS.get(name, ())]
        read = {node.attr for module in readers for node in ast.walk(ast.parse(inspect.getsource(importlib.import_module(module))))
                if isinstance(node, ast.Attribute)}
        assert block is None or {field.name for field in dataclasses.fields(block)} <= read, (stage, name)


@pytest.mark.parametrize("stage", STAGES)
def test_a_value_counts_only_where_its_backend_is_selected(stage: str) -> None:
    """The parameters of a key change with a field only if the block is selected; every field of every block."""
    modules = Modules(ROOT)
    for name in blocks(defaults(stage)):
        backend = next(entry for entry in entries(stage) if entry.replace("-", "_") == name)
        for other in changed(stage, name):
            for selected in entries(stage):
                before, after = (dataclasses.replace(one, backend=selected) for one in (defaults(stage), other))
                there = unselected(modules, MODULES[stage], select_of(before))
                differ = without_blocks(canonical(before), before, there) != without_blocks(canonical(after), after, there)
                assert differ == (selected == backend), (stage, name, selected)


def test_torch_is_no_library_of_optical_flow() -> None:
    """A new version of it reruns SAM 2 alone."""
    modules, stage = Modules(ROOT), MODULES["mask_densify"]
    flow, sam2 = (declarations(modules, stage, {"backend": name}) for name in ("flow", "sam2"))
    assert "torch" in sam2["LIBRARIES"] and "torch" not in flow["LIBRARIES"] and sam2["MEMORY_GIB"] > flow["MEMORY_GIB"]


def test_a_new_field_of_sam_2_changes_the_code_of_sam_2_alone(tmp_path: Path) -> None:
    """The class of a block is in the fingerprint of its backend and of no other."""
    for folder in ("afford", "stages", "schemas"):
        shutil.copytree(ROOT / folder, tmp_path / folder, ignore=shutil.ignore_patterns("__pycache__"))
    file = tmp_path / "afford/extraction/tracks/__init__.py"
    old = "    cache_frames: int = 16\n"
    assert old in file.read_text()
    before = {name: coded(ROOT, name) for name in entries("mask_densify")}
    assert {name: coded(tmp_path, name) for name in before} == before
    file.write_text(file.read_text().replace(old, f"    patience: int = 3\n{old}"))
    after = {name: coded(tmp_path, name) for name in before}
    assert {name for name in before if before[name] != after[name]} == {"sam2"}


def coded(root: Path, backend: str) -> str:
    """Digest of the code of mask_densify with a backend."""
    params = dataclasses.replace(defaults("mask_densify"), backend=backend)
    return fingerprint(Modules(root), f"{MODULES['mask_densify']}:run", select_of(params)).digest


def test_protocols_have_no_any() -> None:
    """The Protocols of backends name the type of every argument and of what comes back; `params` is the backend's own."""
    found = 0
    for path in sorted((ROOT / "afford").rglob("*.py")):
        for node in ast.walk(ast.parse(path.read_text())):
            if isinstance(node, ast.ClassDef) and any(ast.unparse(base) == "Protocol[Own]" for base in node.bases):
                found += 1
                assert "Any" not in {name.id for name in ast.walk(node) if isinstance(name, ast.Name)}, f"{path}: {node.name}"
    assert found == QUESTIONS


def test_params_are_typed() -> None:
    """An argument called `params` has a type, here and in the stages."""
    paths = [path for folder in ("afford", "stages") for path in (ROOT / folder).rglob("*.py")]
    named = [(path, node) for path in paths for node in ast.walk(ast.parse(path.read_text()))
             if isinstance(node, ast.arg) and node.arg == "params"]  # fmt: skip
    loose = [f"{path}:{node.lineno}" for path, node in named
             if node.annotation is None or ast.unparse(node.annotation) == "Any"]  # fmt: skip
    assert named and not loose


def test_registries_of_the_runner_equal_those_of_python() -> None:
    """The runner finds the same backends as Python."""
    modules = Modules(ROOT)
    for stage in STAGES:
        assert dict(registries_of(modules, MODULES[stage]))["backend"] == entries(stage)
