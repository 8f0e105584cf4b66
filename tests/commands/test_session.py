"""Cores and memory that the command line uses, also on systems that report less than Linux."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import pytest

from commands import session

ROOT = Path(__file__).resolve().parents[2]


def test_a_system_without_affinity_is_used_fully(monkeypatch: pytest.MonkeyPatch) -> None:
    """Cores are those of the machine, and memory depends on the number of workers, without affinity and a count of free pages."""
    monkeypatch.delattr(os, "sched_getaffinity", raising=False)
    monkeypatch.delitem(os.sysconf_names, session.FREE_PAGES, raising=False)
    assert session.cores() == os.cpu_count()
    assert session._memory_gib() == max(2.0, 3.0 * session.DEFAULT_JOBS)


def test_memory_is_bounded_by_what_is_free(monkeypatch: pytest.MonkeyPatch) -> None:
    """Three quarters of it; 2 GiB at least."""
    monkeypatch.setitem(os.sysconf_names, session.FREE_PAGES, -1)
    monkeypatch.setattr(session, "DEFAULT_JOBS", 8)
    for free_gib, budget in ((1, 2.0), (8, 6.0), (100, 24.0)):
        shown = {session.FREE_PAGES: free_gib * 2**18, "SC_PAGE_SIZE": 4096}
        monkeypatch.setattr(os, "sysconf", shown.__getitem__)
        assert session._memory_gib() == budget


def test_the_command_line_starts_without_affinity() -> None:
    """Importing it on macOS needs no missing function."""
    code = ("import os; del os.sched_getaffinity; os.sysconf_names.pop('SC_AVPHYS_PAGES'); "
            "import commands.session as s; s._memory_gib()")  # fmt: skip
    subprocess.run([sys.executable, "-c", code], cwd=ROOT, check=True)
