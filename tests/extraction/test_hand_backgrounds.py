"""Backgrounds of the hand finder's lessons: surfaces, held-out materials, photographs, refused folders."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import pytest

from afford.common.photographs import photograph_files, read_photographs
from afford.extraction.hands.augment import Augmentation
from afford.extraction.hands.backgrounds import Backgrounds
from afford.extraction.hands.surfaces import TEXTURE_PX, surface_picture, textures

ROOM = np.full((40, 60, 3), 9, np.uint8), np.zeros((40, 60), np.uint8)
PHOTOGRAPH = np.full((90, 200, 3), (10, 200, 30), np.uint8)


def test_surfaces_depend_on_the_seed_only() -> None:
    """Size, type, and a different picture with each draw."""
    bank = textures(6, np.random.default_rng(0))
    assert len(bank) == 6 and all(one.shape == (TEXTURE_PX, TEXTURE_PX, 3) and one.dtype == np.uint8 for one in bank)
    one, same, other = (surface_picture(bank, (48, 80), np.random.default_rng(seed)) for seed in (1, 1, 2))
    assert one.shape == (48, 80, 3) and one.dtype == np.uint8
    assert np.array_equal(one, same) and not np.array_equal(one, other)


def test_held_out_materials_differ_from_those_of_training() -> None:
    """The same random numbers give other textures."""
    training, held_out = (textures(12, np.random.default_rng(3), one) for one in (False, True))
    assert any(not np.array_equal(a, b) for a, b in zip(training, held_out, strict=True))


def test_every_source_of_backgrounds_is_drawn() -> None:
    """A room, a surface or a photograph, each where its probability is one."""
    drawn = Backgrounds((ROOM,), textures(2, np.random.default_rng(0)), (PHOTOGRAPH,))
    rooms, photographs = Augmentation(surfaces=0.0), Augmentation(surfaces=1.0, photographed=1.0)
    for d, colour in ((rooms, (9, 9, 9)), (photographs, (10, 200, 30))):
        assert (drawn((24, 32), np.random.default_rng(0), d) == colour).all()
    surface = drawn((24, 32), np.random.default_rng(0), replace(photographs, photographed=0.0))
    assert surface.shape == (24, 32, 3) and not (surface == (10, 200, 30)).all()


def test_photographs_are_read_and_reduced(tmp_path: Path) -> None:
    """Colours are RGB, wide pictures are reduced, and other files are left out."""
    cv2.imwrite(str(tmp_path / "a.png"), np.full((50, 1440, 3), (250, 20, 5), np.uint8))
    (tmp_path / "b.txt").write_text("no picture")
    (found,) = read_photographs(photograph_files(tmp_path, lambda path: path.name))
    assert found.shape == (25, 720, 3) and (found == (5, 20, 250)).all()


def test_a_folder_without_photographs_is_refused(tmp_path: Path) -> None:
    """The error names the folder, or the damaged photograph."""
    with pytest.raises(ValueError, match="expected a folder of photographs without hands"):
        read_photographs(photograph_files(tmp_path, lambda path: path.name))
    (tmp_path / "torn.jpg").write_bytes(b"no picture")
    with pytest.raises(ValueError, match=r"torn\.jpg: this photograph is not readable"):
        read_photographs(photograph_files(tmp_path, lambda path: path.name))
