"""Measure how training samples are read from a large data set; writes benchmarks/sample_stream.md.

    PYTHONPATH=. python benchmarks/bench_sample_stream.py --dataset DIR [--rows 278000] [--scratch DIR]

The shards of a data set of ours (`run train-set`, `run dataset`) are linked under further names until there are as many rows as the
published 2HANDS has. Compared with OpenCV alone, which decodes the same JPEGs in the same order, on one thread.
"""

from __future__ import annotations

import argparse
import os
import subprocess
import sys
import time
from pathlib import Path
from tempfile import TemporaryDirectory

import cv2
import numpy as np
import pyarrow.parquet as pq

from afford.twohands.train.samples import Split, files_below
from benchmarks.bench_weights_import import anonymous_mib
from benchmarks.pages import ROOT

PAGE = ROOT / "benchmarks" / "sample_stream.md"
SIZE, SHRUNK, BATCH, SAMPLES = (1024, 1024), (256, 320), 16, 2000


def repeated(dataset: Path, folder: Path, rows: int) -> int:
    """Link the shards of the split train until there are `rows` rows; the number of rows."""
    shards = sorted((dataset / "data").glob("train-*.parquet"))
    count, number = 0, 0
    while count < rows:
        for shard in shards:
            os.symlink(shard.resolve(), folder / f"train-{number:05d}.parquet")
            count, number = count + pq.ParquetFile(shard).metadata.num_rows, number + 1
    return count


def first_batch(folder: Path, scratch: Path) -> None:
    """Index the data set and read one batch, in a process of its own; prints the seconds."""
    from afford.training.sampler import BalancedSampler
    from afford.twohands.train.augment import Augmentation
    from afford.twohands.train.sample_stream import SampleStream, label_rows, write_samples
    from afford.twohands.train.task import Batches, InputSize

    began = time.perf_counter()
    write_samples(files_below(folder), Split(), "train", scratch / "train", SIZE)
    samples = SampleStream(scratch / "train")
    sampler = BalancedSampler(list(label_rows(samples, "verb", "taxonomy")), 0.5, 0)
    Batches(samples, sampler, Augmentation(), InputSize((128, 160)), BATCH, 0)(0)
    sys.stdout.write(f"{time.perf_counter() - began:.1f}\n")


def peak(command: list[str]) -> tuple[float, float]:
    """Seconds that a command prints, and its largest anonymous memory in GiB."""
    found = 0.0
    with subprocess.Popen(command, stdout=subprocess.PIPE, text=True, cwd=ROOT) as process:
        while process.poll() is None:
            found = max(found, anonymous_mib(process.pid))
            time.sleep(0.02)
        assert process.stdout is not None
        printed = process.stdout.read()
    if process.returncode:
        raise SystemExit(f"{' '.join(command)}: exit code {process.returncode}")
    return float(printed), found / 1024


def rates(scratch: Path, shard: Path) -> dict[str, float]:
    """Samples a second on one thread: pictures and masks in random order, at their size, and shrunk; and JPEGs by OpenCV alone."""
    from afford.twohands.train.sample_stream import SampleStream, write_samples

    cv2.setNumThreads(1)
    jpegs = [row["bytes"] for row in pq.read_table(shard, columns=["image"])["image"].to_pylist()]
    order = np.random.default_rng(0).permutation(len(jpegs))[:SAMPLES]
    out = {"JPEGs alone, OpenCV": timed(lambda n: cv2.imdecode(np.frombuffer(jpegs[n], np.uint8), cv2.IMREAD_COLOR_RGB), order)}
    for title, largest in (("samples with four masks", SIZE), ("the same, shrunk to 320 px", SHRUNK)):
        folder = scratch / f"rate-{largest[0]}"
        write_samples({"train-0.parquet": shard}, Split(), "train", folder, largest)
        samples = SampleStream(folder, decoded_bytes=0)
        out[title] = timed(samples.__getitem__, order)
        out[f"{title}, the second time (kept in memory)"] = second(SampleStream(folder, decoded_bytes=4 << 30), order)
    return out


def second(samples: object, order: np.ndarray) -> float:
    """Samples a second once all are in memory."""
    timed(samples.__getitem__, order)  # type: ignore[attr-defined]  # a sequence
    return timed(samples.__getitem__, order)  # type: ignore[attr-defined]


def timed(read: object, order: np.ndarray) -> float:
    """Calls a CPU second."""
    began = time.process_time()
    for n in order:
        read(int(n))  # type: ignore[operator]  # a function of a number
    return len(order) / (time.process_time() - began)


def main() -> None:
    """Measure, then write."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--dataset", type=Path)
    parser.add_argument("--rows", type=int, default=278_000)
    parser.add_argument("--scratch", type=Path)
    parser.add_argument("--first", nargs=2, type=Path, help=argparse.SUPPRESS)
    args = parser.parse_args()
    if args.first:
        first_batch(*args.first)
        return
    with TemporaryDirectory(dir=args.scratch) as scratch:
        folder, index = Path(scratch) / "set", Path(scratch) / "index"
        folder.mkdir()
        rows = repeated(args.dataset, folder, args.rows)
        seconds, memory = peak([sys.executable, __file__, "--first", str(folder), str(index)])
        written = sum(path.stat().st_size for path in index.rglob("*") if path.is_file())
        size = sum(path.stat().st_size for path in folder.iterdir())
        found = rates(Path(scratch), sorted((args.dataset / "data").glob("train-*.parquet"))[0])
    own = found["JPEGs alone, OpenCV"]
    PAGE.write_text("\n".join((
        "# Reading training samples", "",
        f"Written by `benchmarks/bench_sample_stream.py`: {rows:,} rows, {size / 1e9:.1f} GB.", "",
        f"- First batch after {seconds:.0f} s, with {memory:.2f} GiB of anonymous memory.",
        f"- Written to disk: {written / 1e6:.0f} MB, {100 * written / size:.1f} % of the data set.", "",
        "| read in random order, one thread | a CPU second | of OpenCV alone |", "|---|--:|--:|",
        *(f"| {title} | {rate:.0f} | {rate / own:.2f} |" for title, rate in found.items()), "")))


if __name__ == "__main__":
    main()
