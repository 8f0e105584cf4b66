"""Readers of mutated files: each file is read, or refused with a declared error in one sentence."""

from __future__ import annotations

from pathlib import Path

import pytest

from tests.helpers.fuzz_readers import READERS
from tests.helpers.fuzzing import FuzzedReader, fuzz


@pytest.mark.slow
@pytest.mark.filterwarnings("ignore")
@pytest.mark.parametrize("reader", READERS, ids=lambda reader: reader.name)
def test_mutated_files_are_read_or_refused_with_a_declared_error(reader: FuzzedReader, tmp_path: Path) -> None:
    """50 mutations; `benchmarks/bench_reliability.py --fuzz N` takes more."""
    assert sum(fuzz(reader, tmp_path / "sample", 50, seed=1).values()) == 50
