"""Scripts of the folder install/, loaded as modules."""

from __future__ import annotations

import importlib.util
from pathlib import Path
from types import ModuleType

ROOT = Path(__file__).resolve().parents[2]


def of_install(name: str) -> ModuleType:
    """Load a script of the folder install/."""
    spec = importlib.util.spec_from_file_location(f"install_{name}", ROOT / "install" / f"{name}.py")
    assert spec is not None and spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module
