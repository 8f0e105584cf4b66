"""Write in capitals: part and its word -> the part in capitals."""

from __future__ import annotations

import os
import signal
import time
from dataclasses import dataclass

from toy.helper import loud
from toy.log import note
from toy.values import Word

LIBRARIES = ("blake3",)


@dataclass(frozen=True)
class Params:
    sleep_s: float = 0.0
    backend: str = "plain"


def run(part: Word, word: Word, params: Params) -> Word:
    note("shout", part.name)
    time.sleep(params.sleep_s)
    if part.text.startswith("bad"):
        raise ValueError(f"{part.name}: bad words are refused")
    if part.text.startswith("bug"):
        raise RuntimeError("a bug")
    if part.text.startswith("quit"):
        raise SystemExit
    if part.text.startswith("kill"):
        os.kill(os.getpid(), signal.SIGKILL)
    return Word(part.name, loud(part.text))
