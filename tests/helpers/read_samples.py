"""Samples of a part of a data set, in full size, as a training reads them."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from tempfile import TemporaryDirectory

from afford.dataset.load import Item
from afford.twohands.train.sample_stream import SampleStream, write_samples
from afford.twohands.train.samples import Files, Split


def read_items(files: Files, part: str, division: Split | None = None) -> Iterator[Item]:
    """Yield the samples in order."""
    with TemporaryDirectory() as folder:
        write_samples(files, division or Split(), part, Path(folder), (1 << 20, 1 << 20))
        yield from SampleStream(Path(folder))
