"""Photographs of stages: the folder becomes content of the graph, and its place does not."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import pytest

from commands.errors import UsageError
from commands.weights import resolve_weights
from maps.settings import Settings


def settings(folder: Path) -> Settings:
    return Settings.of(hands_train=replace(Settings.extraction.hands_train, photographs=str(folder)))


def test_photographs_are_files_of_the_training(tmp_path: Path) -> None:
    """Pictures in folders below count, other files do not, and the settings keep the name of the folder only."""
    for name in ("b.JPG", "kitchen/a.png", "notes.txt"):
        (tmp_path / "rooms" / name).parent.mkdir(parents=True, exist_ok=True)
        (tmp_path / "rooms" / name).write_bytes(b"0")
    found = resolve_weights(settings(tmp_path / "rooms"), lambda path: path.name)
    assert [file.name for file in dict(found.weights)["hands_train"].files] == ["b.JPG", "kitchen/a.png"]
    assert found.extraction.hands_train.photographs == "rooms"


def test_surfaces_are_files_of_the_stills(tmp_path: Path) -> None:
    """Photographs of surfaces become an input of still_render, by the name of their folder."""
    (tmp_path / "surfaces").mkdir()
    (tmp_path / "surfaces" / "wood.png").write_bytes(b"0")
    chosen = Settings.of(still_render=replace(Settings.synthetic.still_render, photographs=str(tmp_path / "surfaces")))
    found = resolve_weights(chosen, lambda path: path.name)
    assert [file.name for file in dict(found.weights)["still_render"].files] == ["wood.png"]
    assert found.synthetic.still_render.photographs == "surfaces"


def test_a_folder_without_photographs_is_refused(tmp_path: Path) -> None:
    """The error names the parameter."""
    with pytest.raises(UsageError, match=r"hands_train\.photographs: .*expected a folder of photographs"):
        resolve_weights(settings(tmp_path), lambda path: path.name)
