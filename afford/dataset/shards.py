"""Rows -> Parquet shards, written as they come: at most one row group is in memory."""

from __future__ import annotations

from collections.abc import Iterator
from itertools import islice
from pathlib import Path
from typing import Any

import pyarrow as pa
import pyarrow.parquet as pq

ROW_GROUP = 100


def shard_names(split: str, samples: int, per_shard: int) -> list[str]:
    """Names of the shards of a split, as the Hub spells them."""
    number = -(-samples // per_shard)
    return [f"data/{split}-{k:05d}-of-{number:05d}.parquet" for k in range(number)]


def write(rows: Iterator[dict[str, Any]], schema: pa.Schema, root: Path, names: list[str], per_shard: int) -> None:
    """Write all rows of a split into `names`, `per_shard` into each."""
    for name in names:
        path = root / name
        path.parent.mkdir(parents=True, exist_ok=True)
        with _writer(path, schema) as writer:
            shard = islice(rows, per_shard)
            while group := list(islice(shard, ROW_GROUP)):
                writer.write_table(pa.Table.from_pylist(group, schema=schema))


def _writer(path: Path, schema: pa.Schema) -> pq.ParquetWriter:
    """zstd but for the JPEGs, which it cannot shorten; page index and content-defined pages for the Hub; checksums of pages."""
    codec = dict.fromkeys(_leaves(schema), "zstd") | {"image.bytes": "none"}
    return pq.ParquetWriter(path, schema, compression=codec, use_dictionary=False, write_page_index=True,
                            write_page_checksum=True, use_content_defined_chunking=True)


def _leaves(schema: pa.Schema) -> list[str]:
    """Parquet's dotted name of every leaf column."""
    return [name for field in schema for name in _below(field.name, field.type)]


def _below(name: str, kind: pa.DataType) -> Iterator[str]:
    if pa.types.is_struct(kind):
        for field in kind:
            yield from _below(f"{name}.{field.name}", field.type)
    elif pa.types.is_list(kind) or pa.types.is_fixed_size_list(kind):
        yield from _below(f"{name}.list.element", kind.value_type)
    else:
        yield name
