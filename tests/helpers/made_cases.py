"""A small benchmark in ActAffordance's layout, with what is odd in the real one: grey edges, one hand, sizes, classes."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import cv2
import numpy as np

from afford.common.files import tree
from afford.dataset import act_affordance
from schemas.files import FileTree

SIZE = 60, 80
CLASSES = ("left", "right", "both_same", "both_different")


def box(x0: int, y0: int, x1: int, y1: int, size: tuple[int, int] = SIZE) -> np.ndarray:
    """(h, w) bool, x1 and y1 exclusive."""
    out = np.zeros(size, bool)
    out[y0:y1, x0:x1] = True
    return out


def write_mask(path: Path, mask: np.ndarray, edge: int = 1) -> None:
    """255 inside, but for one pixel of grey value `edge` (anti-aliasing) where the mask begins."""
    grey = np.where(mask, np.uint8(255), np.uint8(0))
    y, x = np.argwhere(mask)[0] if mask.any() else (0, 0)
    grey[y, x] = edge if mask.any() else 0
    path.parent.mkdir(parents=True, exist_ok=True)
    cv2.imwrite(str(path), grey)


def write_case(root: Path, name: str, task: str, taxonomy: str, masks: dict[str, np.ndarray], size: tuple[int, int] = SIZE,
               modes: list[dict[str, Any]] | None = None, **more: Any) -> Path:  # fmt: skip
    """One case: `masks` by file stem (aff_left, obj_right, mode1_left); the image is a gradient of its own size."""
    folder = root / name
    folder.mkdir(parents=True)
    shade = np.linspace(40, 200, size[1], dtype=np.uint8)
    cv2.imwrite(str(folder / "inpainting.png"), np.repeat(np.tile(shade, (size[0], 1))[..., None], 3, axis=2))
    one_hot = [int(word == taxonomy) for word in CLASSES]
    (folder / "annotation.json").write_text(json.dumps({"narration": task, "taxonomy": one_hot} | more))
    for stem, mask in masks.items():
        write_mask(folder / f"{stem}.png", mask)
    if modes is not None:
        listed = [mode | {"taxonomy": [int(word == mode["taxonomy"]) for word in CLASSES]} for mode in modes]
        (folder / "modes.json").write_text(json.dumps({"modes": listed}))
    return folder


def write_benchmark(root: Path) -> Path:
    """Six cropped cases and two whole ones; kitchens, a shift scene, Ego4D, several modes."""
    left, right = box(10, 10, 30, 30), box(50, 20, 70, 40)
    objects = {"obj_left": box(5, 5, 40, 40), "obj_right": box(40, 10, 78, 50)}
    both = {"aff_left": left, "aff_right": right}
    epic = {"verb": "open", "noun": "jar"}
    write_case(root, "cropped/P01_01/0000140", "open jar", "both_same", both | objects, **epic)
    write_case(root, "cropped/P01_01/0000150", "take mug", "right", {"aff_right": right, **objects}, verb="take", noun="mug")
    write_case(root, "cropped/P02_03/0000007", "take mug", "left", {"aff_left": left, **objects}, verb="take", noun="mug")
    write_case(root, "cropped/11286c45-7869/00000335", "#C C puts lid", "both_different", {"aff_right": right})
    several = {"aff_right": right, "mode0_right": right, "mode1_left": left, "mode2_left": left, "mode2_right": right, **objects}
    modes = [{"left": None, "right": "mode0_right.png", "taxonomy": "right"},
             {"left": "mode1_left.png", "right": None, "taxonomy": "left"},
             {"left": "mode2_left.png", "right": "mode2_right.png", "taxonomy": "both_same"}]
    write_case(root, "cropped/P95_01/0000001", "take pan", "right", several, modes=modes, **{"groups": ["unseen_kind"]})
    one = [{"left": "aff_left.png", "right": "aff_right.png", "taxonomy": "both_same"}]
    write_case(root, "cropped/W95_01/0000002", "open box", "both_same", both | objects, modes=one)
    write_case(root, "masks/P01_01/0000140", "open jar", "both_same", both | objects, size=(32, 32), **epic)
    write_case(root, "masks/P01_01/0000150", "take mug", "right", {"aff_right": right, **objects}, size=(32, 32))
    return root


def as_tree(root: Path) -> FileTree:
    """The folder as a stage gets it."""
    return tree(root.name, root)


def read_all(root: Path) -> dict[str, Any]:
    """Case id -> case."""
    from afford.twohands.benchmark.cases import read

    return {files.where: read(files) for files in act_affordance.cases(as_tree(root))}
