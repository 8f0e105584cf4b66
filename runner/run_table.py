r"""Tables stage -> shard -> key of whole runs, stored in pieces that runs share.

    runs/tables/<digest>.zst     some hundred lines "<stage>\t<shard>\t<key>\n", compressed

A table is sorted, and cut behind each line whose key has one of four endings, on average every thousandth. A piece is named by the
BLAKE3 digest of its lines. Two runs share all pieces without a difference: a run with nothing to do writes no piece, and a change
of one shard among 100,000 writes one.
"""

from __future__ import annotations

import json
import os
import re
from collections.abc import Iterable, Iterator, Mapping
from pathlib import Path

from blake3 import blake3

from runner.files import write_atomic

CUT = re.compile(rb"[048c]00\n")
"""end of the key behind which a piece ends: one key of 1,024"""
Keys = dict[str, dict[str, str]]
"""stage -> shard -> key"""


class LostTableError(ValueError):
    """A piece of a run's table is missing or damaged."""


def write_table(runs: Path, keys: Mapping[str, Mapping[str, str]]) -> list[str]:
    """Store the table of a run under the folder `runs`; return the digests of its pieces, equal for equal tables."""
    digests = []
    for piece in _pieces(_lines(keys)):
        digests.append(blake3(piece).hexdigest())
        place = piece_path(runs, digests[-1])
        if not os.path.exists(place):
            import zstandard

            write_atomic(place, zstandard.compress(piece))
    return digests


def read_table(runs: Path, digests: Iterable[str]) -> Keys:
    """Read a table back. LostTableError when a piece is missing or damaged."""
    keys: Keys = {}
    for digest in digests:
        for line in _piece(piece_path(runs, digest), digest).decode().splitlines():
            stage, shard, key = line.split("\t")
            keys.setdefault(_read(stage), {})[_read(shard)] = key
    return keys


def piece_path(runs: Path, digest: str) -> Path:
    """Path of a piece."""
    return runs / "tables" / f"{digest}.zst"


def _lines(keys: Mapping[str, Mapping[str, str]]) -> bytes:
    rows = []
    for stage in sorted(keys):
        name, shards = _shown(stage), keys[stage]
        joined = "".join(shards)
        plain = joined.isprintable() and '"' not in joined  # the usual case, found out at once for all shards
        rows += [f"{name}\t{shard if plain else _shown(shard)}\t{shards[shard]}\n" for shard in sorted(shards)]
    return "".join(rows).encode()


def _pieces(lines: bytes) -> Iterator[bytes]:
    start = 0
    for cut in CUT.finditer(lines):
        yield lines[start:cut.end()]
        start = cut.end()
    if start < len(lines):
        yield lines[start:]


def _piece(path: Path, digest: str) -> bytes:
    import zstandard

    try:
        lines = zstandard.decompress(path.read_bytes())
    except FileNotFoundError:
        raise LostTableError(f"{path} is missing, so this run cannot be compared") from None
    except zstandard.ZstdError as error:
        raise LostTableError(f"{path} is damaged, so this run cannot be compared; delete it") from error
    if blake3(lines).hexdigest() != digest:
        raise LostTableError(f"{path} is damaged, so this run cannot be compared; delete it")
    return lines


def _shown(name: str) -> str:
    """Name of a stage or shard on one line."""
    return name if name.isprintable() and not name.startswith('"') else json.dumps(name)


def _read(name: str) -> str:
    return json.loads(name) if name.startswith('"') else name
