"""The command line on a tiny source: two videos of a second, 39 tasks, and the digests of what it publishes."""

from __future__ import annotations

import shutil
import subprocess
import sys
from dataclasses import dataclass
from pathlib import Path

from blake3 import blake3

from benchmarks.pages import ROOT
from benchmarks.reliability.toy import traced
from tests.helpers.tiny_source import write_source

END_S = 300.0


@dataclass(frozen=True)
class Tiny:
    """Source, and a store next to it."""

    folder: Path

    @property
    def source(self) -> Path:
        """Folder of the tiny source."""
        return self.folder / "tiny"

    @property
    def store(self) -> Path:
        """Folder of the store."""
        return self.folder / "store"

    def write(self, kernels: Tiny | None = None) -> Tiny:
        """The source, and compiled kernels of another store, which spare most of a run's time."""
        write_source(self.source)
        if kernels is not None:
            shutil.copytree(kernels.store / ".cache" / "numba", self.store / ".cache" / "numba", dirs_exist_ok=True)
        return self

    def copy(self, folder: Path) -> Tiny:
        """Copy the source with its store; hard links stay links of one file."""
        shutil.rmtree(folder, ignore_errors=True)
        subprocess.run(["cp", "-a", str(self.folder), str(folder)], check=True)
        return Tiny(folder)

    def start(self, *more: str, jobs: int = 2) -> subprocess.Popen[str]:
        """Begin `run dataset` in a session of its own."""
        command = [sys.executable, "pipeline.py", "run", "dataset", "--source", str(self.source), "--store", str(self.store),
                   "--jobs", str(jobs), "--json", *more]
        return subprocess.Popen(command, cwd=ROOT, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True,
                                start_new_session=True)  # fmt: skip

    def run(self, *more: str, jobs: int = 2) -> list[str]:
        """Return the faults of a complete run."""
        process = self.start(*more, jobs=jobs)
        _, message = process.communicate(timeout=END_S)
        return [] if process.returncode == 0 else [f"exit {process.returncode}: {_tail(message)}"]

    def published(self) -> dict[str, str]:
        """Path below datasets/ and recordings/ -> digest of every file."""
        rooms = (self.store / "datasets", self.store / "recordings")
        return {str(path.relative_to(self.store)): blake3(path.read_bytes()).hexdigest()
                for room in rooms for path in sorted(room.rglob("[!.]*")) if path.is_file()}  # fmt: skip

    def traces(self) -> int:
        """Finished tasks."""
        return len(traced(self.store))


def _tail(message: str) -> str:
    return " ".join(message.split())[-300:]
