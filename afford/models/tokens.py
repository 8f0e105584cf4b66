"""Tokenizers: a tokenizer.json of the `tokenizers` library, or hashed words for models that start from random weights."""

from __future__ import annotations

import json
import re
from collections.abc import Sequence
from pathlib import Path
from typing import Any, Protocol
from zlib import crc32

import torch
from tokenizers import Tokenizer
from torch import Tensor


def tokenize_batch(tokens: Tokens, config: Any, texts: Sequence[str]) -> tuple[Tensor, Tensor]:
    """Ids (b, n) and attention mask (b, n) of texts for CLIP's text tower; long texts are cut."""
    rows = [tokens.encode(text)[: config.max_position_embeddings - 2] for text in texts]
    begin, end = text_ends(tokens, config)
    longest = max(map(len, rows)) + 2
    ids = torch.tensor([[begin, *row] + [end] * (longest - 1 - len(row)) for row in rows])
    lengths = torch.tensor([len(row) + 2 for row in rows])
    return ids, (torch.arange(longest) < lengths[:, None]).long()


def text_ends(tokens: Tokens, config: Any) -> tuple[int, int]:
    """Ids that begin and end a text, from the tokenizer if it has them: old configs of CLIP contain the wrong ids 0 and 2."""
    begin, end = tokens.find("<|startoftext|>"), tokens.find("<|endoftext|>")
    return config.bos_token_id if begin is None else begin, config.eos_token_id if end is None else end


IMAGE, SEG = "<image>", "[SEG]"
WORD = re.compile(r"<image>|\[SEG\]|[\w']+|[^\w\s]")
HASHED = "afford_hashed_words"


class Tokens(Protocol):
    """Tokenizer interface of the models."""

    size: int
    """number of ids"""

    def encode(self, text: str) -> list[int]:
        """Encode a text without special ids at its ends; `<image>` and `[SEG]` are one id each."""
        ...

    def decode(self, ids: Sequence[int]) -> str:
        """Text of ids, special ones included."""
        ...

    def id(self, special: str) -> int:
        """Id of `<image>` or `[SEG]`."""
        ...

    def find(self, token: str) -> int | None:
        """Id of a token; None when the vocabulary lacks it."""
        ...

    def to_json(self) -> str:
        """Return the text of its tokenizer.json."""
        ...


class HashedTokens:
    """Tokenizer that hashes words to ids; 0 is padding, 1 begin, 2 end, 3 the image, 4 [SEG]."""

    FIRST = 5
    SPECIAL = {IMAGE: 3, SEG: 4}  # noqa: RUF012  # never written to

    def __init__(self, size: int) -> None:
        self.size = size

    def encode(self, text: str) -> list[int]:
        """Encode a text."""
        return [self.SPECIAL.get(word, self._hash(word)) for word in WORD.findall(text)]

    def decode(self, ids: Sequence[int]) -> str:
        """Decode ids: special tokens, and numbers for words, which hashing loses."""
        names = {number: token for token, number in self.SPECIAL.items()}
        return " ".join(names.get(one, f"#{one}") for one in ids)

    def id(self, special: str) -> int:
        """Id of a special token."""
        return self.SPECIAL[special]

    def find(self, token: str) -> int | None:
        """Id of a token, None when it is unknown."""
        return self.SPECIAL.get(token)

    def to_json(self) -> str:
        """Return the text of tokenizer.json."""
        return json.dumps({HASHED: self.size}) + "\n"

    def _hash(self, word: str) -> int:
        return self.FIRST + crc32(word.lower().encode()) % (self.size - self.FIRST)


class FileTokens:
    """Tokenizer of a tokenizer.json, to which `<image>` and `[SEG]` are added if missing."""

    def __init__(self, text: str) -> None:
        self.tokenizer = Tokenizer.from_str(text)
        self.tokenizer.no_padding()
        self.tokenizer.no_truncation()
        self.tokenizer.add_special_tokens([token for token in (IMAGE, SEG) if self.tokenizer.token_to_id(token) is None])
        vocabulary = self.tokenizer.get_vocab(with_added_tokens=True)
        self.size = max(vocabulary.values()) + 1
        self.special = {token: vocabulary[token] for token in (IMAGE, SEG)}

    def encode(self, text: str) -> list[int]:
        """Encode a text."""
        ids: list[int] = self.tokenizer.encode(text, add_special_tokens=False).ids
        return ids

    def decode(self, ids: Sequence[int]) -> str:
        """Decode ids."""
        text: str = self.tokenizer.decode(list(ids), skip_special_tokens=False)
        return text.strip()

    def id(self, special: str) -> int:
        """Id of a special token."""
        return self.special[special]

    def find(self, token: str) -> int | None:
        """Id of a token, None when it is unknown."""
        found: int | None = self.tokenizer.token_to_id(token)
        return found

    def to_json(self) -> str:
        """Return the text of tokenizer.json."""
        text: str = self.tokenizer.to_str()
        return text


def read_tokens(path: Path) -> Tokens:
    """Read a tokenizer.json. ValueError for a missing file or another kind of file."""
    try:
        text = path.read_text(encoding="utf-8")
        found = json.loads(text)
        return HashedTokens(int(found[HASHED])) if HASHED in found else FileTokens(text)
    except Exception as error:  # the library raises bare Exception for another kind of file
        raise ValueError(f"{path}: expected a tokenizer.json of the tokenizers library; {error}") from error
