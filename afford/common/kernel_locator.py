"""Places of compiled kernels for numba, which imports this module in every process whose environment names it.

The import also replaces the `open` of `numba.core.caching` by one that verifies compiled files (`afford.common.kernel_cache`). The
format of the files is numba's own.
"""

from __future__ import annotations

import os
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

from numba.core import caching, config

from afford.common.kernel_cache import folder_of, open_sealed


def _process_start() -> float:
    """Start of this process, seconds since 1970; the time of this import where the system does not report it."""
    stat = Path("/proc/self/stat")
    if not stat.exists():
        return time.time()
    ticks = int(stat.read_text().rpartition(")")[2].split()[19]) + 1  # the field counts from the boot, and is rounded down
    return time.time() - time.clock_gettime(time.CLOCK_BOOTTIME) + ticks / os.sysconf("SC_CLK_TCK")


BEGAN = _process_start()


class SourcesLocator(caching.UserProvidedCacheLocator):
    """Locator of a kernel's files, in the folder for the present state of all sources that it compiles."""

    def __init__(self, function: Callable[..., Any], file: str) -> None:
        super().__init__(function, file)
        inside = "<locals>" in function.__qualname__
        cache: str = config.CACHE_DIR  # type: ignore[attr-defined]  # numba sets it from the environment
        self._cache_path = os.path.join(cache, folder_of(function.__module__, Path(file).resolve(), inside, BEGAN))


caching.open = open_sealed  # type: ignore[attr-defined]  # a global that hides the builtin
