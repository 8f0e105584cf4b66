"""Join words: words -> one word."""

from __future__ import annotations

from typing import Any

from toy.log import note
from toy.values import Word


def run(words: tuple[Word, ...], ctx: Any) -> Word:
    note("join", "all")
    (ctx.scratch / "draft").write_text("draft")
    ctx.progress(1, 1)
    return Word("all", " ".join(word.text for word in words))
