"""Questions and answers as padded token ids, and where [SEG] stands among them."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import torch
from torch import Tensor

from afford.models.tokens import IMAGE, Tokens

IGNORE = -100
"""label of what is not to be predicted"""


class Dialogue(NamedTuple):
    """b rows, padded on the right."""

    ids: Tensor
    """(b, n) int64"""
    keep: Tensor
    """(b, n) bool: what is not padding"""
    labels: Tensor
    """(b, n) int64: the answer's own ids, IGNORE elsewhere"""


def dialogue(tokens: Tokens, pairs: Sequence[tuple[str, str]], image_tokens: int, begin: int, end: int, pad: int) -> Dialogue:
    """Ids of (question, answer) pairs. Every `<image>` becomes as many ids as the vision tower gives tokens, so that ids and
    hidden states are in the same places, wherever the image stands.
    """
    rows = []
    for asked, answered in pairs:
        before, answer = [begin] + _spread(tokens, asked, image_tokens), tokens.encode(" " + answered) + [end]
        rows.append((before + answer, [IGNORE] * len(before) + answer))
    longest = max(len(ids) for ids, _ in rows)
    ids = torch.tensor([ids + [pad] * (longest - len(ids)) for ids, _ in rows])
    labels = torch.tensor([label + [IGNORE] * (longest - len(label)) for _, label in rows])
    lengths = torch.tensor([len(ids) for ids, _ in rows])
    return Dialogue(ids, torch.arange(longest) < lengths[:, None], labels)


def seg_positions(ids: Tensor, seg: int, state: str = "paper") -> Tensor:
    """(b,) where the state of [SEG] is: at the token itself (paper), or one before, where it is predicted (code).

    ids (b, n); ValueError when a row has not exactly one [SEG].
    """
    found = ids == seg
    counts = found.sum(1)
    if (counts != 1).any():
        raise ValueError(f"expected exactly one [SEG] in each row, got {counts.tolist()}")
    return found.int().argmax(1) - int(state == "code")


def _spread(tokens: Tokens, text: str, count: int) -> list[int]:
    image = tokens.id(IMAGE)
    return [one for token in tokens.encode(text) for one in ([token] * count if token == image else [token])]
