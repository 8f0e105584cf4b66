"""Text to token ids: a tokenizer.json of the `tokenizers` library, or hashed words for models that start from nothing."""

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


IMAGE, SEG = "<image>", "[SEG]"
WORD = re.compile(r"<image>|\[SEG\]|[\w']+|[^\w\s]")
HASHED = "afford_hashed_words"


class Tokens(Protocol):
    """What the models ask of a tokenizer."""

    size: int
    """number of ids"""

    def encode(self, text: str) -> list[int]:
        """Ids of a text, nothing added at its ends; `<image>` and `[SEG]` are one id each."""
        ...

    def id(self, special: str) -> int:
        """The id of `<image>` or `[SEG]`."""
        ...

    def find(self, token: str) -> int | None:
        """The id of a token, None when it is none of its own."""
        ...

    def to_json(self) -> str:
        """The text of its tokenizer.json."""
        ...


class HashedTokens:
    """Every word has the id that its hash gives; 0 pads, 1 begins, 2 ends, 3 is the image, 4 is [SEG]."""

    FIRST = 5
    SPECIAL = {IMAGE: 3, SEG: 4}  # noqa: RUF012  # never written to

    def __init__(self, size: int) -> None:
        self.size = size

    def encode(self, text: str) -> list[int]:
        return [self.SPECIAL.get(word, self._hash(word)) for word in WORD.findall(text)]

    def id(self, special: str) -> int:
        return self.SPECIAL[special]

    def find(self, token: str) -> int | None:
        return self.SPECIAL.get(token)

    def to_json(self) -> str:
        return json.dumps({HASHED: self.size}) + "\n"

    def _hash(self, word: str) -> int:
        return self.FIRST + crc32(word.lower().encode()) % (self.size - self.FIRST)


class FileTokens:
    """A tokenizer.json; `<image>` and `[SEG]` are added where it does not know them."""

    def __init__(self, text: str) -> None:
        self.tokenizer = Tokenizer.from_str(text)
        self.tokenizer.no_padding()
        self.tokenizer.no_truncation()
        self.tokenizer.add_special_tokens([token for token in (IMAGE, SEG) if self.tokenizer.token_to_id(token) is None])
        vocabulary = self.tokenizer.get_vocab(with_added_tokens=True)
        self.size = max(vocabulary.values()) + 1
        self.special = {token: vocabulary[token] for token in (IMAGE, SEG)}

    def encode(self, text: str) -> list[int]:
        ids: list[int] = self.tokenizer.encode(text, add_special_tokens=False).ids
        return ids

    def id(self, special: str) -> int:
        return self.special[special]

    def find(self, token: str) -> int | None:
        found: int | None = self.tokenizer.token_to_id(token)
        return found

    def to_json(self) -> str:
        text: str = self.tokenizer.to_str()
        return text


def read_tokens(path: Path) -> Tokens:
    """The tokenizer of a file; ValueError when there is none, or it is not one."""
    try:
        text = path.read_text(encoding="utf-8")
        found = json.loads(text)
        return HashedTokens(int(found[HASHED])) if HASHED in found else FileTokens(text)
    except Exception as error:  # the library raises bare Exception for a file that is not a tokenizer
        raise ValueError(f"{path}: expected a tokenizer.json of the tokenizers library; {error}") from error
