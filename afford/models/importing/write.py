"""Write imported models: safetensors, tensor by tensor, in shards, with a record and a digest of every file.

One tensor is in memory at a time. A folder appears under its name when all of it is written and was read again.
"""

from __future__ import annotations

import json
import re
import shutil
from collections.abc import Callable, Iterator, Mapping
from pathlib import Path
from typing import Any

import torch
from blake3 import blake3
from safetensors import safe_open
from torch import Tensor

from afford.models.importing import Imported
from afford.models.importing.source import INDEX, RECORD, Source
from afford.models.tensor_files import LENGTH, SAFE_DTYPES

FORMAT = "afford-imported-1"
ONE, SHARD = "model.safetensors", "model-{:05d}-of-{:05d}.safetensors"
SHARD_BYTES = 4_000_000_000
CODES = {dtype: code for code, dtype in SAFE_DTYPES.items()}
Progress = Callable[[int, int], None]
"""called with (written bytes, all bytes)"""


def check_fit(made: Imported, where: str) -> None:
    """ValueError names every tensor that is missing, left over, or of another shape."""
    faults = [f"missing {name}" for name in sorted(made.expected.keys() - made.tensors.keys())]
    faults += [f"left over {name}" for name in sorted(made.tensors.keys() - made.expected.keys())]
    for name in sorted(made.expected.keys() & made.tensors.keys()):
        want, got = tuple(made.expected[name].shape), tuple(made.tensors[name].shape)
        faults += [] if want == got else [f"misshaped {name}: expected {want}, got {got}"]
    if faults:
        raise ValueError(f"{where}: {len(faults)} of {len(made.expected)} tensors do not fit {made.title}: {'; '.join(faults)}")


def write_model(made: Imported, source: Source, kind: str, out: Path, dtype: torch.dtype, progress: Progress) -> dict[str, Any]:
    """Write a model and its record into `out`, which must not exist; returns the record.

    Floats become `dtype`. ValueError names a tensor with a number that is not finite, before or after that.
    """
    check_fit(made, ", ".join(path.name for path in source.files))
    part = out.with_name(f".{out.name}.part")
    shutil.rmtree(part, ignore_errors=True)
    part.mkdir(parents=True)
    try:
        for name, text in made.texts.items():
            (part / name).parent.mkdir(parents=True, exist_ok=True)
            (part / name).write_text(text, encoding="utf-8")
        types = {name: target_type(name, tensor, made, dtype) for name, tensor in made.tensors.items()}
        digests = dict(_write_shards(made, types, part, progress))
        record = record_of(made, source, kind, types) | {"files": digests | {name: file_digest(part / name) for name in made.texts}}
        (part / RECORD).write_text(json.dumps(record, indent=1, sort_keys=True) + "\n", encoding="utf-8")
        part.rename(out)
    except BaseException:
        shutil.rmtree(part, ignore_errors=True)
        raise
    return record


def record_of(made: Imported, source: Source, kind: str, types: Mapping[str, torch.dtype]) -> dict[str, Any]:
    """Record of an imported model, without its files."""
    count = sum(tensor.numel() for tensor in made.tensors.values())
    return {"format": FORMAT, "kind": kind, "title": made.title, "use": made.use, "parameters": made.counted or count,
            "dtype": ", ".join(sorted({str(kept).removeprefix("torch.") for kept in types.values() if kept.is_floating_point})),
            "licence": source.licence(), "from": [path.name for path in source.files], "fresh": list(made.fresh),
            "notes": list(made.notes)}  # fmt: skip


def target_type(name: str, tensor: Tensor, made: Imported, dtype: torch.dtype) -> torch.dtype:
    """Type in which a tensor is written: integers and `keep` stay as they are."""
    if not tensor.is_floating_point():
        return tensor.dtype
    return torch.float32 if made.keep and name.startswith(made.keep) else dtype


def _write_shards(made: Imported, types: Mapping[str, torch.dtype], folder: Path, progress: Progress) -> Iterator[tuple[str, str]]:
    """Write all shards, and the index of several; yields each file with its digest."""
    sizes = {name: tensor.numel() * types[name].itemsize for name, tensor in made.tensors.items()}
    groups = [list(sizes)] if made.single else _groups(sizes)
    names = [ONE] if len(groups) == 1 else [SHARD.format(n, len(groups)) for n in range(1, len(groups) + 1)]
    done, total = 0, sum(sizes.values())
    for file, group in zip(names, groups, strict=True):
        yield file, write_safetensors(folder / file, ((name, made.tensors[name], types[name]) for name in group),
                                      lambda size, done=done: progress(done + size, total))  # type: ignore[misc]  # bound now
        done += sum(sizes[name] for name in group)
    if len(groups) > 1:
        index = {"metadata": {"total_size": total}, "weight_map": {name: file for file, group in zip(names, groups, strict=True)
                                                                    for name in group}}  # fmt: skip
        (folder / INDEX).write_text(json.dumps(index, indent=1, sort_keys=True) + "\n")
        yield INDEX, file_digest(folder / INDEX)


def _groups(sizes: Mapping[str, int]) -> list[list[str]]:
    groups: list[list[str]] = [[]]
    filled = 0
    for name, size in sizes.items():
        if groups[-1] and filled + size > SHARD_BYTES:
            groups.append([])
            filled = 0
        groups[-1].append(name)
        filled += size
    return groups


def write_safetensors(path: Path, tensors: Iterator[tuple[str, Tensor, torch.dtype]], progress: Callable[[int], None]) -> str:
    """Write (name, tensor, type) triples to one file, one tensor in memory at a time; the digest of the file.

    ValueError names a tensor with a number that is not finite in its type.
    """
    rows, header, at = list(tensors), {}, 0
    for name, tensor, dtype in rows:
        size = tensor.numel() * dtype.itemsize
        header[name] = {"dtype": CODES[dtype], "shape": list(tensor.shape), "data_offsets": [at, at + size]}
        at += size
    text = json.dumps(header, separators=(",", ":")).encode()
    text += b" " * (-len(text) % 8)
    digest, done = blake3(), 0
    with path.open("wb") as file:
        for first in (LENGTH.pack(len(text)), text):
            file.write(first)
            digest.update(first)
        for name, tensor, dtype in rows:
            data = _bytes(name, tensor, dtype)
            file.write(data)
            digest.update(data)
            done += len(data)
            progress(done)
    with safe_open(path, "pt") as again:
        assert set(again.keys()) == header.keys()
    return digest.hexdigest()


def _bytes(name: str, tensor: Tensor, dtype: torch.dtype) -> Any:
    kept = tensor.detach().to(dtype).contiguous()
    if kept.is_floating_point() and not torch.isfinite(kept).all():
        what = "numbers that are not finite" if not torch.isfinite(tensor).all() else f"numbers beyond the range of {dtype}"
        raise ValueError(f"{name}: expected finite weights, got {what}; the checkpoint is damaged, or needs another --dtype")
    return memoryview(kept.flatten().view(torch.uint8).numpy().data) if kept.numel() else b""


def file_digest(path: Path) -> str:
    """blake3 of a file."""
    digest = blake3()
    if path.stat().st_size:
        digest.update_mmap(path)
    return digest.hexdigest()


def read_record(folder: Path) -> dict[str, Any]:
    """Read the record of an imported model. ValueError, one sentence, for a folder without one, or with another file."""
    path = folder / RECORD
    try:
        found = json.loads(path.read_text(encoding="utf-8"))
        if found["format"] == FORMAT and all(re.fullmatch(r"[0-9a-f]{64}", digest) for digest in found["files"].values()):
            return dict(found)
    except (OSError, ValueError, LookupError, TypeError, AttributeError, RecursionError) as error:
        raise ValueError(f"{folder}: expected a folder that `weights import` wrote, with {RECORD}; "
                         f"got {type(error).__name__}") from error  # fmt: skip
    raise ValueError(f'{path}: expected "format": "{FORMAT}"')


def damaged(folder: Path) -> list[str]:
    """Files of an imported model that are missing or differ from their digests."""
    files = read_record(folder)["files"]
    return sorted(name for name, digest in files.items()
                  if not (folder / name).is_file() or file_digest(folder / name) != digest)  # fmt: skip
