"""One damaged file in a store: the next run gives the right outputs without manual steps, and repairs the store."""

from __future__ import annotations

import random
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import pytest

from tests.helpers.flipped_stores import DAMAGES, FORMER, KINDS, STORED, built, healed, settled

FLIPS = 4
"""positions of a flipped byte per kind of file"""
SWIFT = ("flip", "remove")
"""damages that run by default; the others take the same paths, and are slow"""


def cases(kinds: Sequence[str], swift: Sequence[str] = SWIFT) -> list[Any]:
    """Combine kind of file, damage and seed."""
    found = [(kind, how, seed) for kind in kinds for how in DAMAGES for seed in range(FLIPS if how == "flip" else 1)]
    return [pytest.param(*case, marks=pytest.mark.slow if case[2] or case[1] not in swift else ()) for case in found]


@pytest.mark.parametrize(("kind", "how", "seed"), cases(KINDS))
def test_a_damaged_file_is_healed_by_the_next_run(kind: str, how: str, seed: int, tmp_path: Path) -> None:
    """Caches are in place; `verify` after the run finds nothing."""
    project = built(tmp_path, kind)
    assert healed(project, kind, how, random.Random(f"{kind} {how} {seed}"), cache=True, verify_first=False) == []


@pytest.mark.parametrize(("kind", "how", "seed"), cases(STORED))
def test_a_damaged_file_is_healed_without_caches(kind: str, how: str, seed: int, tmp_path: Path) -> None:
    """The folder .cache is missing, as after an early kill or in a copied store."""
    project = built(tmp_path, kind)
    assert healed(project, kind, how, random.Random(f"{kind} {how} {seed}"), cache=False, verify_first=False) == []


@pytest.mark.parametrize(("kind", "how", "seed"), cases(KINDS, ("field",)))
def test_verify_reports_a_damaged_file(kind: str, how: str, seed: int, tmp_path: Path) -> None:
    """Damage of blobs, manifests and traces is reported, no damage stops `verify`, and the run after it repairs."""
    project = built(tmp_path, kind)
    assert healed(project, kind, how, random.Random(f"{kind} {how} {seed}"), cache=True, verify_first=True) == []


@pytest.mark.parametrize(("kind", "how", "seed"), [
    case for case in cases(FORMER, ("cut",)) if case.values[1] != "remove" and not case.values[2]])
def test_damage_of_an_unused_result_is_reported_at_most_once(kind: str, how: str, seed: int, tmp_path: Path) -> None:
    """The next run settles it, and undoing the edit still gives the right outputs."""
    assert settled(built(tmp_path, kind), kind, how, random.Random(f"{kind} {how} {seed}" if seed else f"{kind} {how}")) == []
