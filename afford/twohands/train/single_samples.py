"""Arrow streams, and h5 files of the released 2HANDS, whose samples are read one by one when they are needed.

An Arrow stream is mapped into memory: a sample costs its own bytes alone. The outlines of a released video are read once, and its
file is opened for each picture.
"""

from __future__ import annotations

import json
from bisect import bisect_right
from collections.abc import Iterator
from contextlib import contextmanager
from itertools import accumulate
from pathlib import Path, PurePosixPath
from typing import Any, Protocol

import h5py
import numpy as np
import pyarrow as pa
import pyarrow.ipc as ipc

from afford.common.bounded import reason
from afford.dataset.export_2hands import STRINGS, first_row, read_sample
from afford.dataset.load import Item
from afford.twohands.train.samples import NO_MOTION, Files, item_of_row, wanted_columns

WORDS = ("sample_id", "video", "narration", "verb", "noun")
TEXT_SHARE = 10
"""memory of parsed outlines, in bytes of their file"""


class Shard(Protocol):
    """File of samples."""

    nbytes: int
    """memory that it keeps"""

    def labels(self) -> Iterator[dict[str, Any]]:
        """Yield sample_id, video, narration, verb, noun and taxonomy of every sample, as far as they are known."""

    def item(self, row: int) -> Item:
        """Decode a sample. ValueError for a damaged one."""


def open_shard(files: Files, name: str) -> Shard:
    """Open a file of samples by its suffix, .h5 or .arrow. ValueError, one sentence, for a damaged one."""
    if not name.endswith(".h5"):
        return ArrowShard(name, files[name])
    outlines = outlines_of(name)
    if outlines not in files:
        raise ValueError(f"{name}: expected its outlines in {outlines}, found no such file; copy both folders, h5 and jsons")
    return ReleasedShard(name, files[name], files[outlines])


def outlines_of(name: str) -> str:
    """Name of the outlines of a released video."""
    path = PurePosixPath(name)
    return str(path.parent.parent / "jsons" / f"{path.stem}.json")


class ArrowShard:
    """Samples of an Arrow stream, as `save_to_disk` writes it."""

    nbytes = 0

    def __init__(self, name: str, path: Path) -> None:
        """Map the stream. ValueError names missing columns, and refuses a stream whose buffers are compressed."""
        try:
            with pa.memory_map(str(path)) as source:
                whole = source.read_buffer()
            with ipc.open_stream(whole) as stream:
                wanted = wanted_columns(PurePosixPath(name), stream.schema)
                self._batches = [_in_place(name, batch.select(wanted), whole) for batch in stream]
        except (pa.ArrowException, OSError) as error:
            raise ValueError(f"{name}: expected an Arrow stream, as save_to_disk writes it; {reason(error)}") from error
        self._ends = list(accumulate(batch.num_rows for batch in self._batches))

    def labels(self) -> Iterator[dict[str, Any]]:
        """Yield the labels of every sample; where a taxonomy is missing, the masks are decoded."""
        for batch in self._batches:
            plain = batch.select([name for name in (*WORDS, "taxonomy") if name in batch.schema.names])
            for n, row in enumerate(plain.to_pylist()):
                yield row if row.get("taxonomy") is not None else {**row, "taxonomy": _item(batch, n).taxonomy}

    def item(self, row: int) -> Item:
        """Decode a sample. ValueError for a damaged one."""
        batch = bisect_right(self._ends, row)
        return _item(self._batches[batch], row - (self._ends[batch - 1] if batch else 0))


def _in_place(name: str, batch: pa.RecordBatch, whole: pa.Buffer) -> pa.RecordBatch:
    """Check that the buffers of a batch are those of the file, and consistent."""
    batch.validate(full=True)
    buffers = (buffer for column in batch.columns for buffer in column.buffers() if buffer is not None and buffer.size)
    if not all(whole.address <= buffer.address < whole.address + whole.size for buffer in buffers):
        raise ValueError(f"{name}: expected an Arrow stream without compression, whose samples can be read one by one; save the "
                         "data set with save_to_disk or as Parquet")
    return batch


def _item(batch: pa.RecordBatch, row: int) -> Item:
    return item_of_row(batch.slice(row, 1).to_pylist()[0])


class ReleasedShard:
    """Samples of one video in the released form; the file's name has its id and the number of the first sample."""

    def __init__(self, name: str, path: Path, outlines: Path) -> None:
        """Read the outlines. ValueError for a damaged file of them."""
        self.name, self.path = name, path
        stem = PurePosixPath(name).stem
        self.first, self.video = first_row(stem), stem.partition("_")[2]
        with _named(name):
            text = outlines.read_text(encoding="utf-8")
            self.outlines, self.nbytes = json.loads(text), TEXT_SHARE * len(text)

    def labels(self) -> Iterator[dict[str, Any]]:
        """Yield the labels of every sample."""
        with _named(self.name), h5py.File(self.path) as file:
            words = {name: file["data"][name].asstr()[:] for name in STRINGS}
            taxonomy = file["data/taxonomy"][:].argmax(1)
        for n, kind in enumerate(taxonomy.tolist()):
            yield {"sample_id": self._id(n), "video": self.video, "narration": words["narration"][n], "verb": words["verb"][n],
                   "noun": words["noun"][n], "taxonomy": kind}

    def item(self, row: int) -> Item:
        """Decode a sample. ValueError for a damaged one."""
        with _named(f"{self.name}, sample {row}"):
            found = read_sample(self.path, row, self.outlines[str(row)])
        return Item(sample_id=self._id(row), video=self.video, frame=self.first + row, image=np.ascontiguousarray(found["image"]),
                    masks=found["masks"], narration=found["narration"], verb=found["verb"], noun=found["noun"], verb_class=-1,
                    noun_class=-1, object_left=found["obj_id_left"], object_right=found["obj_id_right"],
                    taxonomy=int(np.argmax(found["taxonomy"])), quality=1.0, motion=NO_MOTION,
                    motion_time_ns=np.zeros(0, np.int64))  # fmt: skip

    def _id(self, row: int) -> str:
        return f"{self.video}_{self.first + row:06d}"


@contextmanager
def _named(where: str) -> Iterator[None]:
    """Context that reports damage of a released video as a ValueError with its name."""
    try:
        yield
    except (OSError, KeyError, ValueError, TypeError) as error:
        raise ValueError(f"{where}: expected a video of the released 2HANDS; {reason(error)}") from error
