"""Parquet shards: a streaming writer, and a reader that bounds stated sizes and verifies page checksums.

Any damage of a shard is reported as one SourceError.
"""

from __future__ import annotations

import json
import struct
import zlib
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from itertools import islice
from pathlib import Path
from typing import Any

import cv2
import pyarrow as pa
import pyarrow.parquet as pq

from afford.common.bounded import TooLargeError, reason
from afford.common.errors import SourceError
from afford.common.files import FOOTER, MANIFEST, footer_digest

ROW_GROUP = 100


def shard_names(split: str, samples: int, per_shard: int) -> list[str]:
    """Return the shard names of a split, in the Hub's naming scheme."""
    number = -(-samples // per_shard)
    return [f"data/{split}-{k:05d}-of-{number:05d}.parquet" for k in range(number)]


def write_shards(rows: Iterator[dict[str, Any]], schema: pa.Schema, root: Path, names: list[str], per_shard: int) -> None:
    """Stream all rows of a split into the files `names`, `per_shard` rows each, with one row group in memory."""
    for name in names:
        path = root / name
        path.parent.mkdir(parents=True, exist_ok=True)
        with _writer(path, schema) as writer:
            shard = islice(rows, per_shard)
            while group := list(islice(shard, ROW_GROUP)):
                writer.write_table(pa.Table.from_pylist(group, schema=schema))


def _writer(path: Path, schema: pa.Schema) -> pq.ParquetWriter:
    """Open a writer: zstd except for JPEGs, page index and content-defined chunking for the Hub, page checksums."""
    codec = dict.fromkeys(_leaves(schema), "zstd") | {"image.bytes": "none"}
    return pq.ParquetWriter(path, schema, compression=codec, use_dictionary=False, write_page_index=True,
                            write_page_checksum=True, use_content_defined_chunking=True)


def _leaves(schema: pa.Schema) -> list[str]:
    """Return Parquet's dotted name of every leaf column."""
    return [name for field in schema for name in _leaves_below(field.name, field.type)]


def _leaves_below(name: str, kind: pa.DataType) -> Iterator[str]:
    if pa.types.is_struct(kind):
        for field in kind:
            yield from _leaves_below(f"{name}.{field.name}", field.type)
    elif pa.types.is_list(kind) or pa.types.is_fixed_size_list(kind):
        yield from _leaves_below(f"{name}.list.element", kind.value_type)
    else:
        yield name


MOST_BYTES = 1 << 30
"""limit of the uncompressed size of a row group: 100 images of 10 MB"""
MOST_ROWS = 1 << 17
"""limit of the rows of a row group"""
DAMAGE = (pa.ArrowException, cv2.error, zlib.error, struct.error, OSError, ValueError, TypeError, LookupError, AttributeError,
          MemoryError, OverflowError)  # fmt: skip
"""exceptions that Arrow, OpenCV and column unpacking raise for a damaged or foreign file"""


@contextmanager
def damage_as_error(path: Path, name: str = "") -> Iterator[None]:
    """Convert any damage inside the context to one SourceError that names the file (or `name`)."""
    try:
        yield
    except SourceError:
        raise
    except DAMAGE as error:
        raise SourceError(name or f"{path.parent.name}/{path.name}", "a whole shard of a data set", reason(error),
                          "compare it with manifest.json; get the file, or make the data set, again") from error


def open_shard(path: Path, name: str = "") -> pq.ParquetFile:
    """Open a shard with page checksum verification.

    Raises SourceError when it is not a Parquet file, or its footer differs from the one in manifest.json, where there is one.
    """
    with damage_as_error(path, name):
        stated = _stated_footer(path)
        if stated and stated != footer_digest(path):
            raise ValueError("a footer that is not the one in manifest.json")
        return pq.ParquetFile(path, page_checksum_verification=True)


def _stated_footer(path: Path) -> str:
    """Return the digest of a shard's footer from the manifest of its data set; '' when there is none."""
    root = path.parent.parent
    if not (root / MANIFEST).is_file():
        return ""
    entry = json.loads((root / MANIFEST).read_bytes())
    for key in ("files", path.relative_to(root).as_posix(), FOOTER):  # a manifest of another form has no such entry
        entry = entry.get(key) if isinstance(entry, dict) else None
    return str(entry or "")


def read_group(path: Path, group: int, columns: Sequence[str]) -> pa.Table:
    """Read columns of one row group.

    Raises SourceError when the file is damaged or lacks a column, and TooLargeError beyond `MOST_BYTES` or `MOST_ROWS`, before
    decompression.
    """
    with open_shard(path) as file, damage_as_error(path):
        _check_size(file, path, group)
        missing = [name for name in columns if name not in file.schema_arrow.names]
        if missing:
            raise SourceError(f"{path.parent.name}/{path.name}", f"columns {', '.join(columns)}", f"no {', '.join(missing)}",
                              "give the folder of a data set that `dataset_pack` wrote")
        return file.read_row_group(group, columns=list(columns), use_threads=False)


def _check_size(file: pq.ParquetFile, path: Path, group: int) -> None:
    """Check the stated size of a row group. Sizes of single columns are not read, because Arrow crashes on damaged statistics."""
    stated = file.metadata.row_group(group)
    size = stated.total_byte_size
    if size > MOST_BYTES or stated.num_rows > MOST_ROWS:
        raise TooLargeError(f"{path.parent.name}/{path.name}", f"row groups of at most {MOST_BYTES >> 20} MiB and {MOST_ROWS} rows",
                            f"{size >> 20} MiB and {stated.num_rows} rows", "write it in smaller row groups")
