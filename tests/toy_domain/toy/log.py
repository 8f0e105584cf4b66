"""Write a line per execution to the file in TOY_LOG, so that a test can count them."""

from __future__ import annotations

import os
from pathlib import Path


def note(stage: str, name: str) -> None:
    with Path(os.environ["TOY_LOG"]).open("a") as stream:
        stream.write(f"{stage} {name}\n")
