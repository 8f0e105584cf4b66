"""Every third-party package that a stage can reach stands in its LIBRARIES, so that its version is in the key."""

from __future__ import annotations

from importlib.metadata import packages_distributions
from pathlib import Path

import pytest

from runner.fingerprint import declarations, reachable_third_party
from runner.modules import Modules
from tests.helpers.stage_files import MODULES

ROOT = Path(__file__).resolve().parents[2]
STAGES = sorted(MODULES)


@pytest.fixture(scope="module")
def distributions() -> dict[str, list[str]]:
    return dict(packages_distributions())


@pytest.mark.parametrize("stage", STAGES)
def test_libraries_are_complete(stage: str, distributions: dict[str, list[str]]) -> None:
    """Whichever backend is selected; import names are turned into names of distributions."""
    declared = set(declarations(Modules(ROOT), MODULES[stage])["LIBRARIES"])
    reached = reachable_third_party(ROOT, f"{MODULES[stage]}:run")
    missing = {name for name in reached if not declared & set(distributions.get(name, [name]))}
    assert not missing, f"stages/{stage}.py reaches {sorted(missing)}; name their distributions in LIBRARIES"
