"""Pipeline from video to data set with a learned inpainter: tiny random weights, the real loading code, all stages."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pyarrow.parquet as pq
import pytest

from tests.helpers.command import PER_CLIP, PER_RUN, Called, call
from tests.helpers.tiny_inpainters import save_lama, save_vidm
from tests.helpers.tiny_source import VIDEOS, write_source

pytestmark = pytest.mark.slow


def weights(backend: str, folder: Path, seed: int) -> Path:
    return save_vidm(folder / str(seed), seed) if backend == "vidm" else save_lama(folder / f"{seed}.safetensors", seed)


def dataset(source: Path, store: Path, backend: str, model: Path) -> Called:
    chosen = {"backend": backend, f"{backend}.model": model, "vidm.ddim_steps": 1, f"{backend}.device": "cpu"}
    words = [word for name, value in chosen.items() for word in ("--set", f"hand_inpaint.{name}={value}")]
    return call("run", "dataset", "--source", source, "--store", store, "--jobs", "0", "--json", *words)


def images(store: Path, source: Path) -> list[bytes]:
    shards = sorted((store / "datasets" / source.name / "data").glob("*.parquet"))
    return [image["bytes"] for shard in shards for image in pq.read_table(shard, columns=["image"])["image"].to_pylist()]


@pytest.mark.parametrize("backend", ["vidm", "lama"])
def test_a_learned_inpainter_in_the_whole_pipeline(backend: str, tmp_path: Path) -> None:
    """A data set comes out; other weights give other pictures and rerun nothing above; a broken file fails in one sentence."""
    source, store = write_source(tmp_path / "tiny", VIDEOS[:1]), tmp_path / "store"
    first = dataset(source, store, backend, weights(backend, tmp_path, 0))
    assert first.code == 0, first.words
    assert first.json["ran"] == dict.fromkeys((*PER_CLIP, *PER_RUN), 1)
    before = images(store, source)
    again = dataset(source, store, backend, weights(backend, tmp_path, 1))
    assert again.code == 0 and {"hand_inpaint", "dataset_pack"} <= set(again.json["ran"])
    assert not {"frame_decode", "mask_densify"} & set(again.json["ran"])
    after = images(store, source)
    assert len(before) == len(after) > 0 and not np.array_equal(before, after)
    nothing = dataset(source, store, backend, tmp_path / "none.safetensors")
    assert nothing.code == 2 and "none.safetensors" in nothing.words
    page = tmp_path / "page.safetensors"
    page.write_text("a page that says 404")
    broken = dataset(source, store, backend, page)
    assert broken.code == 1 and "page.safetensors: expected" in broken.words and "hand_inpaint" in broken.json["failed"]
