"""LIBRARIES of a stage list every third-party package that it can reach, so that its version is in the key."""

from __future__ import annotations

from importlib.metadata import packages_distributions
from pathlib import Path

import pytest

from runner.fingerprint import fingerprint
from runner.modules import Modules
from runner.selection import declarations, registries_of
from tests.helpers.stage_files import MODULES

ROOT = Path(__file__).resolve().parents[2]
STAGES = sorted(MODULES)


@pytest.fixture(scope="module")
def modules() -> Modules:
    """Modules of the project, parsed once."""
    return Modules(ROOT)


@pytest.fixture(scope="module")
def distributions() -> dict[str, list[str]]:
    """Import name -> names of distributions."""
    return dict(packages_distributions())


@pytest.mark.parametrize("stage", STAGES)
def test_libraries_are_complete(stage: str, modules: Modules, distributions: dict[str, list[str]]) -> None:
    """LIBRARIES hold for every backend; import names are mapped to distribution names."""
    declared = set(declarations(modules, MODULES[stage])["LIBRARIES"])
    reached = fingerprint(modules, f"{MODULES[stage]}:run", {}).third_party
    missing = {name for name in reached if not declared & set(distributions.get(name, [name]))}
    assert not missing, f"stages/{stage}.py reaches {sorted(missing)}; name their distributions in LIBRARIES"


def test_libraries_of_each_backend_are_complete(modules: Modules, distributions: dict[str, list[str]]) -> None:
    """A stage that declares libraries by backend declares all that each of them reaches."""
    for stage in MODULES.values():
        for field, entries in registries_of(modules, stage):
            by_backend = f"{field.upper()}_LIBRARIES" in modules.get(stage).literals  # type: ignore[union-attr]  # a module of ours
            for entry in entries if by_backend else ():
                declared = set(declarations(modules, stage, {field: entry})["LIBRARIES"])
                reached = fingerprint(modules, f"{stage}:run", {field: entry}).third_party
                missing = {name for name in reached if not declared & set(distributions.get(name, [name]))}
                assert not missing, f"{stage} with {field}={entry} reaches {sorted(missing)}; declare them"
