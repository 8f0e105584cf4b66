"""List of fonts that matplotlib keeps in a store, for stages that draw in a process without one."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]


def with_fonts(store: Path) -> Path:
    """The store, with the list of fonts that matplotlib keeps in it."""
    code = f"from pathlib import Path; from afford.common.worker import use_font_cache; use_font_cache(Path({str(store)!r}))"
    subprocess.run([sys.executable, "-c", f"{code}; import matplotlib.font_manager"], cwd=ROOT, check=True)
    return store
