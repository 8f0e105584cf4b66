"""Measure the speed of writing and reading the data set, compared with Hugging Face `datasets`. Writes benchmarks/dataset.md.

Run with `PYTHONPATH=. python benchmarks/bench_dataset.py`. Times are CPU seconds of this process, since wall time depends on
the load of the machine.
"""

from __future__ import annotations

import os
import tempfile
import time
from collections.abc import Callable
from dataclasses import replace
from itertools import islice
from pathlib import Path

import cv2
import datasets
import numpy as np
import pyarrow.parquet as pq

from afford.dataset import load, parquet_shards, table_schema
from schemas.affordance import Samples
from tests.helpers.made_samples import clip

SAMPLES = 1500
BATCH = 300
GOAL_PER_S = 1000
PAGE = Path(__file__).with_name("dataset.md")


def made() -> list[Samples]:
    """Build samples at EPIC's size; a fifth of them is drawn, the rest reuses the same arrays under other names."""
    drawn = clip("P01_01", SAMPLES // 5, split="train", height=256, width=456)
    out = []
    for copy in range(5):
        named = tuple(replace(one, sample_id=f"{copy}_{one.sample_id}") for one in drawn.samples)
        out.append(replace(drawn, clip_id=f"P01_01_s{copy}", samples=named))
    return out


def cpu(work: Callable[[], object]) -> float:
    """Return the CPU seconds of the better of two runs."""
    found = []
    for _ in range(2):
        start = time.process_time()
        work()
        found.append(time.process_time() - start)
    return min(found)


def schema(clips: list[Samples]):
    """Return the classes of verbs and nouns, and the Arrow schema."""
    said = [one.narration for made in clips for one in made.samples]
    verbs = table_schema.collect_classes((one.verb_key, one.verb_class) for one in said)
    nouns = table_schema.collect_classes((one.noun_key, one.noun_class) for one in said)
    return verbs, nouns, table_schema.arrow_schema(table_schema.columns(verbs, nouns))


def write_ours(clips: list[Samples], root: Path) -> None:
    """Write shards from mask arrays and JPEG images: PNG, run lengths, boxes and areas of four masks, and all columns."""
    verbs, nouns, described = schema(clips)
    found = (table_schema.table_row(made, one, verbs.labels(), nouns.labels(), "") for made in clips for one in made.samples)
    parquet_shards.write_shards(found, described, root, parquet_shards.shard_names("train", SAMPLES, 10_000), 10_000)


def write_hf(clips: list[Samples], path: Path) -> None:
    """Write the same content through `datasets`: encoded JPEG, four masks as arrays, the same words."""
    verbs, nouns, described = schema(clips)
    plain = [name for name in described.names if not name.startswith(("mask_", "object_left_mask", "object_right_mask"))]
    features = datasets.Features.from_arrow_schema(described)
    kept = datasets.Features({name: features[name] for name in (*plain, *table_schema.MASKS)})

    def generate():
        for made_ in clips:
            for one in made_.samples:
                row = table_schema.task_columns(one, verbs.labels(), nouns.labels()) | table_schema.source_columns(made_, one)
                yield {name: row.get(name) for name in plain} | {
                    "image": {"bytes": one.image_jpeg.tobytes(), "path": None}, "sample_id": one.sample_id,
                    **dict(zip(table_schema.MASKS, one.masks, strict=True))}

    batch: dict[str, list] = {}
    writer = None
    source = generate()
    while group := list(islice(source, BATCH)):
        batch = {name: [row[name] for row in group] for name in kept}
        table = datasets.Dataset.from_dict(batch, features=kept).data.table
        writer = writer or pq.ParquetWriter(path, table.schema, compression="zstd")
        writer.write_table(table)
    writer.close()


def read_ours(root: Path) -> None:
    """Decode every sample: JPEG, four masks, words and motion."""
    for item in load.Dataset(root, "train"):
        assert item.image.shape[:2] == item.masks.shape[1:]


def read_hf(root: Path, cache: Path) -> None:
    """Decode our shards with `load_dataset`: JPEG and two masks as arrays."""
    files = [str(path) for path in load.shards(root, "train")]
    found = datasets.load_dataset("parquet", data_files=files, split="train", cache_dir=str(cache))
    for row in found.select_columns(["image", "mask_left", "mask_right", "narration", "taxonomy"]):
        assert np.asarray(row["image"]).shape[:2] == np.asarray(row["mask_left"]).shape == np.asarray(row["mask_right"]).shape


def measure(folder: Path) -> dict[str, float]:
    """Measure the samples per CPU second of each method."""
    clips = made()
    seconds = {
        "write_ours": cpu(lambda: write_ours(clips, folder)),
        "write_hf": cpu(lambda: write_hf(clips, folder / "hf.parquet")),
        "read_ours": cpu(lambda: read_ours(folder)),
        "read_hf": cpu(lambda: read_hf(folder, folder / "cache")),
    }
    return {name: SAMPLES / found for name, found in seconds.items()}


def page(rate: dict[str, float], size: int) -> str:
    """The Markdown page."""
    def line(what: str, ours: str, peer: str) -> str:
        return f"| {what} | {rate[ours]:,.0f} | {rate[peer]:,.0f} | {rate[ours] / rate[peer]:.1f} |"

    verdict = "met" if min(rate["write_ours"], rate["read_ours"]) >= GOAL_PER_S else "missed"
    return "\n".join([
        "# Speed of the data set", "",
        f"{SAMPLES:,} samples of 456 x 256, half with both hands; {size / SAMPLES / 1e3:.1f} kB a sample. "
        "Samples per CPU second, one thread.", "",
        "| | ours | `datasets` | ratio |", "|---|--:|--:|--:|",
        line("write (JPEG encoding apart)", "write_ours", "write_hf"),
        line("read, pictures and masks decoded", "read_ours", "read_hf"), "",
        f"Goal: at least {GOAL_PER_S:,} each way: {verdict}.", "",
        "Writing: ours makes four 1-bit PNG, four run lengths, boxes and areas of every sample; `datasets` makes the four PNG. "
        "Reading: ours decodes the JPEG and all four masks, motion and words; `datasets` reads our shards and "
        "decodes the JPEG and two masks.", "",
        f"Written by `benchmarks/bench_dataset.py` (numpy {np.__version__}, OpenCV {cv2.__version__}, "
        f"datasets {datasets.__version__}).", ""])


def main() -> None:
    """Measure and write the page."""
    cv2.setNumThreads(1)
    datasets.disable_progress_bars()
    with tempfile.TemporaryDirectory() as name:
        rate = measure(Path(name))
        size = sum(path.stat().st_size for path in load.shards(Path(name), "train"))
    PAGE.write_text(page(rate, size), encoding="utf-8")
    print(PAGE.read_text(encoding="utf-8"))


if __name__ == "__main__":
    os.environ.setdefault("HF_HUB_OFFLINE", "1")
    main()
