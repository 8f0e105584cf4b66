"""Mutations of files, and what a reader may do with a mutated one: read it, or refuse it with a declared error in one sentence."""

from __future__ import annotations

import random
import re
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

NUMBER = re.compile(rb"-?\d+(?:\.\d+)?")
NUMBERS = (b"0", b"-1", b"1e999", b"NaN", b"4294967296", b"9" * 5000, b"0.5", b"")
LONGEST_SENTENCE = 600


@dataclass(frozen=True)
class FuzzedReader:
    """A public reader, a valid file for it, and the errors that its docstring declares."""

    name: str
    write: Callable[[Path], Path]
    """writes a valid sample into an empty folder and returns the file to mutate"""
    read: Callable[[Path], object]
    """reads that file the way the pipeline does; what is lazy is forced"""
    errors: tuple[type[Exception], ...]


def mutated(data: bytes, rng: random.Random) -> bytes:
    """One mutation: a flipped bit, a cut, a doubled, dropped, swapped or random stretch, another number."""
    kind = rng.randrange(7)
    if not data or kind == 0:
        return data + rng.randbytes(rng.randrange(1, 64))
    at = rng.randrange(len(data))
    end = min(len(data), at + rng.randrange(1, 64))
    if kind == 1:
        return data[:at] + bytes([data[at] ^ (1 << rng.randrange(8))]) + data[at + 1:]
    if kind == 2:
        return data[:at]
    if kind == 3:
        return data[:end] + data[at:end] + data[end:]
    if kind == 4:
        return data[:at] + data[end:]
    if kind == 5:
        return data[:at] + rng.randbytes(end - at) + data[end:]
    numbers = list(NUMBER.finditer(data))
    if not numbers:
        return data[:at]
    found = rng.choice(numbers)
    return data[:found.start()] + rng.choice(NUMBERS) + data[found.end():]


def fuzz(reader: FuzzedReader, folder: Path, tries: int, seed: int) -> dict[str, int]:
    """Read `tries` mutations of the reader's sample; returns how many were accepted and refused.

    AssertionError, with the seed of the mutation, for an undeclared error or a message that is not one sentence.
    """
    folder.mkdir(parents=True, exist_ok=True)
    path = reader.write(folder)
    whole = path.read_bytes()
    reader.read(path)  # the sample itself is valid
    counts = {"accepted": 0, "refused": 0}
    for n in range(tries):
        path.write_bytes(mutated(whole, random.Random(f"{reader.name} {seed} {n}")))
        try:
            reader.read(path)
            counts["accepted"] += 1
        except reader.errors as error:
            sentence = str(error)
            fits = sentence and "\n" not in sentence and len(sentence) <= LONGEST_SENTENCE
            assert fits, f"{reader.name}, seed {seed}, n {n}: {sentence!r}"
            counts["refused"] += 1
        except Exception as error:
            raise AssertionError(f"{reader.name}, seed {seed}, n {n}: {type(error).__name__}: {error}") from error
    path.write_bytes(whole)
    return counts
