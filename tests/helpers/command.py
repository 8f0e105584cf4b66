"""Commands of afford, called in this process, and a source with a finished store to call them on."""

from __future__ import annotations

import io
import json
import shutil
from contextlib import redirect_stderr, redirect_stdout
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from pipeline import main

KEYS = {"target", "ran", "cached", "failed", "outputs", "metrics", "seconds"}
RECORDED = ("source_read", "frame_decode", "mask_densify", "hand_inpaint", "object_completion", "affordance_intersect",
            "narration_labelling", "sample_assemble")
PER_CLIP = (*RECORDED, *(f"record_{stage}" for stage in RECORDED), "clip_footage", "clip_record")
PER_RUN = ("dataset_pack", "record_dataset_pack")


@dataclass(frozen=True)
class Called:
    """What a command said, and its exit code."""

    code: int
    out: str
    err: str

    @property
    def json(self) -> Any:
        """The object in the last line."""
        return json.loads(self.out.splitlines()[-1])

    @property
    def words(self) -> str:
        """Everything said, on one line (tables wrap)."""
        return " ".join((self.out + self.err).split())


def call(*words: str | Path) -> Called:
    """`python pipeline.py WORDS`."""
    with redirect_stdout(io.StringIO()) as out, redirect_stderr(io.StringIO()) as err:
        code = main([str(word) for word in words])
    return Called(code, out.getvalue(), err.getvalue())


@dataclass(frozen=True)
class Made:
    """A tiny source, the store in which its targets were made, and what the first run of `dataset` printed."""

    source: Path
    store: Path
    first: dict[str, Any]

    def copy(self, folder: Path) -> Made:
        """The same, for a test that breaks things."""
        source, store = folder / self.source.name, folder / "store"
        shutil.copytree(self.source, source)
        shutil.copytree(self.store, store)
        return Made(source, store, self.first)

    def run(self, target: str, *words: str) -> Called:
        """`run TARGET` on this source, in this process, with JSON."""
        return call("run", target, "--source", self.source, "--store", self.store, "--jobs", "0", "--json", *words)

    def ask(self, verb: str, *words: str | Path, source: bool = True) -> Called:
        """Another verb on this store."""
        return call(verb, *words, *(["--source", self.source] if source else []), "--store", self.store)

    @property
    def traces(self) -> set[Path]:
        """One file per task that was ever finished."""
        return set((self.store / "traces").glob("??/[!.]*.json"))
