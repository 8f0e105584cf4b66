"""3: mutated files for every reader that docs/ names, and small files that state something very large."""

from __future__ import annotations

import multiprocessing
import os
import random
import resource
import warnings
from multiprocessing.connection import Connection
from pathlib import Path

from benchmarks.reliability.rows import Plan, Row
from tests.helpers.bombs import defuse
from tests.helpers.fuzz_readers import BOMBS, READERS
from tests.helpers.fuzzing import LONGEST_SENTENCE, FuzzedReader, mutated

QUIET_S = 20.0
"""a reader that is silent for so long hangs"""
MEMORY_BYTES = 6 << 30
"""address space of a reader's process"""


def rows(plan: Plan) -> list[Row]:
    """One for each reader, one for all bombs."""
    return [*(_fuzzed(reader, plan) for reader in READERS), _bombs(plan)]


def _fuzzed(reader: FuzzedReader, plan: Plan) -> Row:
    """Each mutation is read or refused with a declared error; a process that dies or hangs is replaced."""
    row, counts, n = Row(f"fuzzing: {reader.name}"), {"accepted": 0, "refused": 0}, 0
    folder = plan.place(f"fuzz {reader.name.replace('/', '-')}")
    while n < plan.fuzz:
        ours, theirs = multiprocessing.Pipe(duplex=False)
        process = multiprocessing.get_context("fork").Process(target=_read_all, args=(reader, folder, plan, n, theirs))
        process.start()
        theirs.close()
        n = _take(ours, row, counts, n, plan.fuzz)
        process.kill()
        process.join()
    row.figures = f"{counts['refused']} refused, {counts['accepted']} accepted"
    return row


def _take(ours: Connection, row: Row, counts: dict[str, int], n: int, end: int) -> int:
    """Count answers until all are there, or the process is lost with a mutation; the number of the next one."""
    while n < end:
        try:
            message = ours.recv() if ours.poll(QUIET_S) else "the reader hangs"
        except EOFError:
            message = "the reader's process died"
        n += 1
        counts[message] = counts.get(message, 0) + 1
        row.count([] if message in ("accepted", "refused") else [f"n {n - 1}: {message}"])
        if message in ("the reader hangs", "the reader's process died"):
            return n
    return n


def _read_all(reader: FuzzedReader, folder: Path, plan: Plan, first: int, answer: Connection) -> None:
    warnings.simplefilter("ignore")
    os.dup2(os.open(os.devnull, os.O_WRONLY), 2)  # libraries in C write a line for every damaged picture
    resource.setrlimit(resource.RLIMIT_AS, (MEMORY_BYTES, MEMORY_BYTES))
    path = reader.write(_empty(folder, first))
    whole = path.read_bytes()
    reader.read(path)
    for n in range(first, plan.fuzz):
        path.write_bytes(mutated(whole, random.Random(f"{reader.name} {plan.seed} {n}")))
        answer.send(_read(reader, path))


def _empty(folder: Path, first: int) -> Path:
    place = folder / str(first)
    place.mkdir()
    return place


def _read(reader: FuzzedReader, path: Path) -> str:
    try:
        reader.read(path)
        return "accepted"
    except reader.errors as error:
        message = str(error)
        whole = message and "\n" not in message and len(message) <= LONGEST_SENTENCE
        return "refused" if whole else f"no sentence: {message[:200]!r}"
    except Exception as error:
        return f"{type(error).__name__}: {str(error)[:200]}"


def _bombs(plan: Plan) -> Row:
    row = Row("bombs: small files that state or unpack to something very large")
    for bomb in BOMBS:
        message = defuse(bomb, plan.folder / f"bomb {bomb.name.replace('/', '-')}")
        row.count([f"{bomb.name}: {message}"] if message else [])
    return row
