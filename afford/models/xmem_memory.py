"""Feature memory of XMem (Cheng and Schwing 2022): a working memory of recent frames, consolidated into a long-term memory.

Elements are the places of stored frames. A query reads the `top_k` elements most similar to it. When the working memory is full,
the most used elements of its older frames become prototypes; the least used prototypes make room for them. Frames that are pinned,
the key frames, are not consolidated.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import torch
from torch import Tensor
from torch.nn.functional import embedding_bag

from afford.models.xmem_network import Keys


@dataclass(frozen=True)
class MemorySize:
    """Bounds of a memory; defaults of the release. ValueError for bounds that exclude each other."""

    top_k: int = 30
    """elements that a query reads"""
    least_frames: int = 5
    """frames after a consolidation, a key frame included (T_min)"""
    most_frames: int = 10
    """frames that start a consolidation, a key frame included (T_max)"""
    prototypes: int = 128
    """elements that a consolidation adds to the long-term memory (P)"""
    long_term: int = 10_000
    """elements of the long-term memory (LT_max)"""

    def __post_init__(self) -> None:
        if not 1 <= self.least_frames < self.most_frames:
            raise ValueError(f"memory of XMem: expected 1 <= least_frames < most_frames, got {self.least_frames} and "
                             f"{self.most_frames}")  # fmt: skip
        if self.top_k < 1 or not 1 <= self.prototypes <= self.long_term:
            raise ValueError(f"memory of XMem: expected top_k of 1 or more and 1 <= prototypes <= long_term, got {self.top_k}, "
                             f"{self.prototypes} and {self.long_term}")  # fmt: skip


RELEASED = MemorySize()


class Elements(NamedTuple):
    """Elements of a memory, a row each."""

    key: Tensor
    """(N, key_dim)"""
    shrinkage: Tensor
    """(N, 1)"""
    selection: Tensor
    """(N, key_dim)"""
    value: Tensor
    """(N, n value_dim) of n objects"""
    used: Tensor
    """(N,) sum of the weights with which an element was read"""
    shown: Tensor
    """(N,) number of frames that could read it"""

    def rows(self, which: slice | Tensor) -> Elements:
        """Elements of some rows."""
        return Elements(*(part[which] for part in self))

    def usage(self) -> Tensor:
        """Mean weight (N,) with which an element was read, over the frames that could."""
        return self.used / self.shown.clamp(min=1)


def join(*parts: Elements) -> Elements:
    """Concatenate elements."""
    return Elements(*(torch.cat(columns) for columns in zip(*parts, strict=True)))


def similarity(memory: Keys | Elements, query: Keys | Elements) -> Tensor:
    """Anisotropic L2 similarity (M, N) of M queries and N keys in memory: -s sum_c e_c (k_c - q_c)^2 / sqrt(C).

    s is the shrinkage of the key k in memory, e the selection of the query q.
    """
    chosen = query.selection * query.key
    squares = query.selection @ (memory.key**2).T - 2 * chosen @ memory.key.T + (chosen * query.key).sum(dim=1, keepdim=True)
    return -squares * memory.shrinkage.T / memory.key.shape[1] ** 0.5


def top_weights(similar: Tensor, count: int) -> tuple[Tensor, Tensor]:
    """Softmax over the `count` largest similarities of each row (M, N): their weights and columns, both (M, min(count, N))."""
    best, at = similar.topk(min(count, similar.shape[1]), dim=1)
    return best.softmax(dim=1), at


class Memory:
    """Memory of one pass through a video: rows are prototypes, then pinned elements, then the other stored frames."""

    def __init__(self, size: MemorySize) -> None:
        self.size = size
        self.elements: Elements | None = None
        self.long = self.pinned = 0
        self.place: tuple[int, ...] = ()
        """objects, channels, rows and columns of a value"""

    def __len__(self) -> int:
        return 0 if self.elements is None else len(self.elements.key)

    def add(self, keys: Keys, value: Tensor, *, pinned: bool = False) -> None:
        """Store a frame. value: (n, value_dim, h, w). Pinned frames come before others."""
        self.place = tuple(value.shape)
        flat = value.float().flatten(2).permute(2, 0, 1).flatten(1).contiguous()
        fresh = Elements(*keys, flat, *flat.new_zeros(2, len(flat)))
        self.elements = fresh if self.elements is None else join(self.elements, fresh)
        if pinned:
            self.pinned += len(flat)
        elif len(self) - self.long - self.pinned >= (self.size.most_frames - 1) * len(flat):
            self._consolidate(len(flat))

    def read(self, query: Keys) -> Tensor:
        """Values (n, value_dim, h, w) float32 at the places of a query; counts which elements were read."""
        kept = self.elements
        assert kept is not None, "a memory is read after a frame was stored"
        similar = similarity(kept, query)
        weights, at = top_weights(similar, self.size.top_k)
        kept.used.add_(similar.zero_().scatter_(1, at, weights).sum(dim=0))
        kept.shown.add_(1)
        found = embedding_bag(at, kept.value, per_sample_weights=weights, mode="sum")
        objects, channels, rows, columns = self.place
        return found.view(rows, columns, objects, channels).permute(2, 3, 0, 1)

    def _consolidate(self, per_frame: int) -> None:
        """Replace the older frames of the working memory by prototypes, and the least used prototypes by these."""
        assert self.elements is not None
        first, last = self.long + self.pinned, len(self) - (self.size.least_frames - 1) * per_frame
        fresh = potentiated(self.elements.rows(slice(first, last)), self.size.prototypes)
        old = most_used(self.elements.rows(slice(0, self.long)), self.size.long_term - len(fresh.key))
        pinned, recent = (self.elements.rows(part) for part in (slice(self.long, first), slice(last, None)))
        self.elements = join(old, fresh, pinned, recent)
        self.long = len(old.key) + len(fresh.key)


def most_used(elements: Elements, count: int) -> Elements:
    """The `count` most used elements in their order; of equally used ones the earlier."""
    order = elements.usage().sort(descending=True, stable=True).indices[:count]
    return elements.rows(order.sort().values)


def potentiated(elements: Elements, count: int) -> Elements:
    """The `count` most used elements as prototypes: their value and shrinkage are means over elements similar to them."""
    chosen = most_used(elements, count)
    weights = similarity(elements, chosen).softmax(dim=1)
    fresh = torch.zeros_like(chosen.used)
    return Elements(chosen.key, weights @ elements.shrinkage, chosen.selection, weights @ elements.value, fresh, fresh.clone())
