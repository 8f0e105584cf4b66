"""One damaged file in a store: the next run ends with the right outputs, no manual step, and the store is whole again."""

from __future__ import annotations

import random
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import pytest

from tests.helpers.flipped_stores import DAMAGES, FORMER, KINDS, STORED, built, healed, settled

FLIPS = 4
"""positions that are tried of each kind of file"""
RARE = ("[]", "null")


def cases(kinds: Sequence[str]) -> list[Any]:
    """Kind of file, damage and seed; most seeds of a damage are slow."""
    found = [(kind, how, seed) for kind in kinds for how in DAMAGES for seed in range(FLIPS if how == "flip" else 1)]
    return [pytest.param(*case, marks=pytest.mark.slow if case[2] or case[1] in RARE else ()) for case in found]


@pytest.mark.parametrize(("kind", "how", "seed"), cases(KINDS))
def test_a_damaged_file_is_healed_by_the_next_run(kind: str, how: str, seed: int, tmp_path: Path) -> None:
    """With every cache in place; `verify` after the run finds nothing."""
    project = built(tmp_path, kind)
    assert healed(project, kind, how, random.Random(f"{kind} {how} {seed}"), cache=True, verify_first=False) == []


@pytest.mark.parametrize(("kind", "how", "seed"), cases(STORED))
def test_a_damaged_file_is_healed_without_caches(kind: str, how: str, seed: int, tmp_path: Path) -> None:
    """With .cache gone, as after a kill before it was written or in a store that was copied without it."""
    project = built(tmp_path, kind)
    assert healed(project, kind, how, random.Random(f"{kind} {how} {seed}"), cache=False, verify_first=False) == []


@pytest.mark.parametrize(("kind", "how", "seed"), cases(KINDS))
def test_verify_sees_a_damaged_file(kind: str, how: str, seed: int, tmp_path: Path) -> None:
    """Damage of blobs, manifests and traces is reported, no damage stops `verify`, and the run after it heals."""
    project = built(tmp_path, kind)
    assert healed(project, kind, how, random.Random(f"{kind} {how} {seed}"), cache=True, verify_first=True) == []


@pytest.mark.parametrize("how", [how for how in DAMAGES if how != "remove"])
@pytest.mark.parametrize("kind", FORMER)
def test_damage_of_what_no_run_uses_any_more_is_no_lasting_complaint(kind: str, how: str, tmp_path: Path) -> None:
    """A result of former code is damaged: `verify` says so at most once, and is content after the next run; undoing the edit still
    ends right.
    """
    assert settled(built(tmp_path, kind), kind, how, random.Random(f"{kind} {how}")) == []
