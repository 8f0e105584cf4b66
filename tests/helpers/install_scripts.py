"""Scripts of the folder install/, loaded as modules."""

from __future__ import annotations

import importlib.util
import sys
from pathlib import Path
from types import ModuleType
from unittest.mock import patch

ROOT = Path(__file__).resolve().parents[2]


def of_install(name: str) -> ModuleType:
    """Load a script of the folder install/."""
    spec = importlib.util.spec_from_file_location(f"install_{name}", ROOT / "install" / f"{name}.py")
    assert spec is not None and spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    with patch.object(sys, "path", [str(ROOT / "install"), *sys.path]):  # as Python does for a script
        spec.loader.exec_module(module)
    return module
