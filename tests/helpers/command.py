"""Call commands of afford in this process; a source with a finished store to call them on."""

from __future__ import annotations

import io
import json
import shutil
from contextlib import redirect_stderr, redirect_stdout
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from pipeline import main
from runner.index import Index

KEYS = {"target", "ran", "cached", "failed", "outputs", "metrics", "seconds"}
RECORDED = ("source_read", "frame_decode", "mask_densify", "hand_inpaint", "object_completion", "affordance_intersect",
            "narration_labelling", "sample_assemble")
PER_CLIP = (*RECORDED, *(f"record_{stage}" for stage in RECORDED), "clip_footage", "clip_record")
PER_RUN = ("dataset_pack", "record_dataset_pack")


@dataclass(frozen=True)
class Called:
    """Output and exit code of a command."""

    code: int
    out: str
    err: str

    @property
    def json(self) -> Any:
        """Object in the last line of the output."""
        return json.loads(self.out.splitlines()[-1])

    @property
    def words(self) -> str:
        """Complete output on one line, since tables wrap."""
        return " ".join((self.out + self.err).split())


def call(*words: str | Path) -> Called:
    """Run `python pipeline.py WORDS`."""
    with redirect_stdout(io.StringIO()) as out, redirect_stderr(io.StringIO()) as err:
        code = main([str(word) for word in words])
    return Called(code, out.getvalue(), err.getvalue())


@dataclass(frozen=True)
class Made:
    """A tiny source, the store of its targets, and the output of the first run of `dataset`."""

    source: Path
    store: Path
    first: dict[str, Any]

    def copy(self, folder: Path) -> Made:
        """Copy for a test that changes or breaks files."""
        source, store = folder / self.source.name, folder / "store"
        shutil.copytree(self.source, source)
        shutil.copytree(self.store, store)
        return Made(source, store, self.first)

    def run(self, target: str, *words: str) -> Called:
        """Run `run TARGET` on this source, in this process, with JSON."""
        return call("run", target, "--source", self.source, "--store", self.store, "--jobs", "0", "--json", *words)

    def ask(self, verb: str, *words: str | Path, source: bool = True) -> Called:
        """Run another verb on this store."""
        return call(verb, *words, *(["--source", self.source] if source else []), "--store", self.store)

    @property
    def traces(self) -> set[str]:
        """Keys of all finished tasks."""
        return set(Index(self.store).keys())
