"""Project of a few modules that a test may edit, move and run, each time in its own process."""

from __future__ import annotations

import os
import re
import subprocess
import sys
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]


@dataclass
class EditableProject:
    """Code in a folder. `main.py` runs a graph and prints tasks that ran, the text that came out, and reasons, | between them."""

    root: Path

    @classmethod
    def build(cls, root: Path, files: Mapping[str, str]) -> EditableProject:
        for name, text in files.items():
            (root / name).parent.mkdir(exist_ok=True)
            (root / name).write_text(text)
        return cls(root)

    def play(self) -> tuple[int, str, list[str]]:
        """Run the project: tasks that ran, text of the output, reasons of the planned tasks."""
        environment = {**os.environ, "PYTHONPATH": str(ROOT), "PYTHONDONTWRITEBYTECODE": "1"}
        done = subprocess.run([sys.executable, "main.py"], cwd=self.root, capture_output=True, text=True, env=environment)
        assert done.returncode == 0, done.stderr
        ran, text, *plans = done.stdout.strip().split("|")
        return int(ran), text, plans

    def move(self, old: str, new: str) -> None:
        """Move a file or a folder, and adapt every import and string that names it."""
        (self.root / new).parent.mkdir(parents=True, exist_ok=True)
        (self.root / old).rename(self.root / new)
        before, after = (name.removesuffix(".py").replace("/", ".") for name in (old, new))
        for path in self.root.rglob("*.py"):
            path.write_text(re.sub(rf"\b{re.escape(before)}\b", after, path.read_text()))

    def edit(self, file: str, old: str, new: str) -> None:
        text = (self.root / file).read_text()
        assert old in text
        (self.root / file).write_text(text.replace(old, new))
