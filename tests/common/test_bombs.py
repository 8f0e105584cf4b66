"""A file cannot make a reader allocate or compute without bound."""

from __future__ import annotations

from pathlib import Path

import pytest

from tests.helpers.bombs import Bomb, defuse
from tests.helpers.fuzz_readers import BOMBS


@pytest.mark.filterwarnings("ignore")
@pytest.mark.parametrize("bomb", BOMBS, ids=lambda bomb: bomb.name)
def test_bombs_are_refused_before_memory_is_allocated(bomb: Bomb, tmp_path: Path) -> None:
    """The error is declared; memory and time are bounded."""
    assert defuse(bomb, tmp_path / "bomb") == ""
