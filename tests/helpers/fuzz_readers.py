"""Tables of the fuzzed readers and of the bombs, by what they read."""

from __future__ import annotations

from tests.helpers import fuzz_meshes, fuzz_models, fuzz_motion, fuzz_sources
from tests.helpers.bombs import Bomb
from tests.helpers.fuzzing import FuzzedReader

ROOMS = (fuzz_sources, fuzz_meshes, fuzz_motion, fuzz_models)
READERS: list[FuzzedReader] = [reader for room in ROOMS for reader in room.READERS]
BOMBS: list[Bomb] = [bomb for room in ROOMS for bomb in room.BOMBS]
