"""Word vectors of a task: each word is the mean of its hashed subwords, so that an unseen noun shares subwords with known ones.

Method of Bojanowski et al. 2017, "Enriching Word Vectors with Subword Information".
"""

from __future__ import annotations

import functools
import re
from zlib import crc32

import torch
from torch import Tensor, nn

WORD = re.compile(r"[\w']+")
PIECE_LENGTHS = (3, 4, 5)


@functools.lru_cache(maxsize=4096)
def subwords(word: str, buckets: int) -> tuple[int, ...]:
    """Rows of a word in a table of `buckets`: the whole word, and its subwords of 3 to 5 letters with < and > as its ends."""
    framed = f"<{word}>"
    parts = [framed] + [framed[i : i + n] for n in PIECE_LENGTHS for i in range(len(framed) - n + 1)]
    return tuple(crc32(part.encode()) % buckets for part in parts)


def split_words(task: str) -> list[str]:
    """Split a task into lower-case words without punctuation."""
    return WORD.findall(task.lower())


class WordVectors(nn.Module):
    """Embedding of the words of tasks."""

    def __init__(self, buckets: int, words: int, width: int) -> None:
        super().__init__()
        self.buckets, self.words = buckets, words
        self.table = nn.EmbeddingBag(buckets, width // 2, mode="mean")
        self.widen = nn.Linear(width // 2, width)
        self.place = nn.Parameter(0.02 * torch.randn(words, width))
        nn.init.normal_(self.table.weight, std=0.5)

    def forward(self, tasks: tuple[str, ...]) -> tuple[Tensor, Tensor]:
        """Embed b tasks: vectors (b, n, width) and mask (b, n) bool of the words, where n is the length of the longest task.

        A task without words has one empty word.
        """
        rows = [[subwords(word, self.buckets) for word in split_words(task)[: self.words]] or [()] for task in tasks]
        longest = max(map(len, rows))
        flat = [piece for row in rows for piece in row + [()] * (longest - len(row))]
        ids, starts = self._bags(flat)
        vectors = self.widen(self.table(ids, starts)).unflatten(0, (len(tasks), longest)) + self.place[:longest]
        count = torch.tensor([len(row) for row in rows], device=vectors.device)
        return vectors, torch.arange(longest, device=vectors.device) < count[:, None]

    def _bags(self, flat: list[tuple[int, ...]]) -> tuple[Tensor, Tensor]:
        device = self.place.device
        ids = torch.tensor([row for piece in flat for row in piece], dtype=torch.long, device=device)
        lengths = torch.tensor([0] + [len(piece) for piece in flat[:-1]], device=device)
        return ids, lengths.cumsum(0)
