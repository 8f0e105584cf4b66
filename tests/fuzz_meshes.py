"""Readers of meshes: a valid sample and the declared errors of each."""

from __future__ import annotations

from tests.bombs import Bomb
from tests.fuzzing import FuzzedReader

READERS: list[FuzzedReader] = []
BOMBS: list[Bomb] = []
