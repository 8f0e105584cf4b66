"""Build backend: setuptools, plus one file that registers afford's environments with gymnasium.

gymnasium before 1.0 reads the entry points `gymnasium.envs`; since 1.0 it requires an import of the package first. The editable
wheel therefore contains a `.pth` file, which Python reads at start-up, and the module that it imports: see
install/_afford_gymnasium.py. Only editable wheels are built, because data, documentation and the store are found relative to the
sources.
"""

from __future__ import annotations

import base64
import hashlib
import zipfile
from pathlib import Path
from typing import Any

from setuptools import build_meta
from setuptools.build_meta import (
    get_requires_for_build_editable,
    get_requires_for_build_wheel,
    prepare_metadata_for_build_editable,
    prepare_metadata_for_build_wheel,
)

__all__ = ["build_editable", "build_sdist", "build_wheel", "get_requires_for_build_editable", "get_requires_for_build_wheel",
           "prepare_metadata_for_build_editable", "prepare_metadata_for_build_wheel"]  # fmt: skip
HOOK = Path(__file__).with_name("_afford_gymnasium.py")
ONLY_EDITABLE = "cannot build {}: afford is installed from its own folder, with `make setup` or `pip install --editable .`"


def build_editable(wheel_directory: str, config_settings: Any = None, metadata_directory: str | None = None) -> str:
    """Build the wheel with setuptools, and add the hook."""
    name = build_meta.build_editable(wheel_directory, config_settings, metadata_directory)
    add(Path(wheel_directory) / name, {HOOK.name: HOOK.read_bytes(), f"{HOOK.stem}.pth": f"import {HOOK.stem}\n".encode()})
    return name


def build_wheel(wheel_directory: str, config_settings: Any = None, metadata_directory: str | None = None) -> str:
    """Refuse with SystemExit: only editable wheels are supported."""
    raise SystemExit(ONLY_EDITABLE.format("a wheel of copied files"))


def build_sdist(sdist_directory: str, config_settings: Any = None) -> str:
    """Refuse with SystemExit: only editable wheels are supported."""
    raise SystemExit(ONLY_EDITABLE.format("a source archive"))


def add(wheel: Path, files: dict[str, bytes]) -> None:
    """Add files to a wheel and to its RECORD."""
    with zipfile.ZipFile(wheel) as old:
        held = {name: old.read(name) for name in old.namelist()}
    record = next(name for name in held if name.endswith(".dist-info/RECORD"))
    held |= files
    held[record] += "".join(f"{name},sha256={digest(data)},{len(data)}\n" for name, data in files.items()).encode()
    with zipfile.ZipFile(wheel, "w", zipfile.ZIP_DEFLATED) as new:
        for name, data in held.items():
            new.writestr(name, data)


def digest(data: bytes) -> str:
    """SHA-256 in the encoding of a wheel's RECORD."""
    return base64.urlsafe_b64encode(hashlib.sha256(data).digest()).rstrip(b"=").decode()
