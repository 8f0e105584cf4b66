"""Token ids as CLIP's text tower reads them."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import torch
from torch import Tensor

from afford.models.tokens import Tokens


def text_batch(tokens: Tokens, config: Any, texts: Sequence[str]) -> tuple[Tensor, Tensor]:
    """(b, n) ids and (b, n) 1 where they count, as CLIP's text tower reads them; what is too long is cut."""
    rows = [tokens.encode(text)[: config.max_position_embeddings - 2] for text in texts]
    begin, end = text_ends(tokens, config)
    longest = max(map(len, rows)) + 2
    ids = torch.tensor([[begin, *row] + [end] * (longest - 1 - len(row)) for row in rows])
    lengths = torch.tensor([len(row) + 2 for row in rows])
    return ids, (torch.arange(longest) < lengths[:, None]).long()


def text_ends(tokens: Tokens, config: Any) -> tuple[int, int]:
    """Ids that begin and end a text. The tokenizer is asked first: old configs of CLIP give 0 and 2, which it never meant."""
    begin, end = tokens.find("<|startoftext|>"), tokens.find("<|endoftext|>")
    return config.bos_token_id if begin is None else begin, config.eos_token_id if end is None else end
