"""Stages of the project: name -> module."""

from __future__ import annotations

from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]
MODULES = {path.stem: f"stages.{path.parent.name}.{path.stem}"
           for path in sorted((ROOT / "stages").glob("*/[!_]*.py"), key=lambda path: path.stem)}  # fmt: skip
"""stage -> its module"""
