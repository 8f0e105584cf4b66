"""What a long stage may ask of whoever runs it. It must not change the output."""

from __future__ import annotations

from pathlib import Path
from typing import Protocol


class Context(Protocol):
    """Handed to a stage whose `run` has a last parameter `ctx`."""

    @property
    def scratch(self) -> Path:
        """A private folder of this key: it survives a kill and is deleted when the output is safe."""

    def progress(self, done: int, total: int) -> None:
        """Say how far the work is."""
