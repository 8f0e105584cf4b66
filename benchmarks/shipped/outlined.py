"""Score the shipped two-hand model on photographs whose regions were outlined by hand; writes docs/twohands/photographs.md.

    PYTHONPATH=. python benchmarks/hands/photographs.py --to ../photographs                                            # once
    PYTHONPATH=. python benchmarks/shipped/outlined.py --cases NEW_FOLDER [--photographs DIR] [--store DIR]

outlines.json has a row for each question: the photograph, the task, the box of the object, and every valid way to act, as polygons
of one hand (whichever it is) or of both; numbers are tenths of the width and height of the picture. `window` is the part of a
photograph that is the picture. They were drawn before the model was scored on them, and nothing is trained or chosen with them.
"""

from __future__ import annotations

import argparse
import json
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import cv2
import numpy as np

from afford.common.files import tree
from afford.common.image_files import encode_png, read_image
from afford.common.masks import BORDER, Box
from afford.models.shipped import TWO_HANDS, shipped_files
from benchmarks.hands.photographs import DEFAULT
from benchmarks.pages import ROOT, into
from benchmarks.shipped.score import METHODS, Figures, run, two_hands, with_interval
from commands.session import digester, open_runner

OUTLINES = Path(__file__).with_name("outlines.json")
PAGE = ROOT / "docs" / "twohands" / "photographs.md"
TAXONOMY = {"left": [1, 0, 0, 0], "right": [0, 1, 0, 0], "both": [0, 0, 1, 0]}
DRAWS = 5
"""draws of other tasks' words"""
SEEN = 0.9
"""share of a region that a crop holds, so that its way is one of the crop"""
Way = dict[str, np.ndarray]
"""hand -> (h, w) bool"""


def filled(polygons: list[list[list[float]]], height: int, width: int) -> np.ndarray:
    """(h, w) bool mask of polygons whose corners are in tenths of the picture."""
    out = np.zeros((height, width), np.uint8)
    for one in polygons:
        cv2.fillPoly(out, [np.round(np.array(one) * (width / 10, height / 10)).astype(np.int32)], 1)
    return out.astype(bool)


def ways_of(case: dict[str, Any], height: int, width: int) -> list[Way]:
    """Every way to act; what one hand does may be done by either."""
    out = list[Way]()
    for way in case["ways"]:
        masks = {hand: filled(polygons, height, width) for hand, polygons in way.items()}
        out += [{"right": masks["one"]}, {"left": masks["one"]}] if "one" in masks else [masks]
    return out


def pixels(tenths: list[float], height: int, width: int) -> Box:
    """Rows and columns of a box (left, top, right, bottom)."""
    x0, y0, x1, y1 = (round(value * side / 10) for value, side in zip(tenths, (width, height, width, height), strict=True))
    return slice(y0, y1), slice(x0, x1)


def cropped(box: Box, height: int, width: int) -> Box:
    """Box with the border that ActAffordance leaves around an object."""
    border = round(BORDER * max(height, width))
    rows, columns = box
    return (slice(max(rows.start - border, 0), min(rows.stop + border, height)),
            slice(max(columns.start - border, 0), min(columns.stop + border, width)))  # fmt: skip


def write_case(folder: Path, rgb: np.ndarray, task: str, ways: list[Way]) -> None:
    """Write a case in the layout of ActAffordance."""
    folder.mkdir(parents=True)
    (folder / "inpainting.png").write_bytes(encode_png(rgb).tobytes())
    modes = list[dict[str, Any]]()
    for number, way in enumerate(ways):
        names = {hand: f"aff_{hand}.png" if number == 0 else f"mode_{number}_{hand}.png" for hand in way}
        for hand, mask in way.items():
            (folder / names[hand]).write_bytes(encode_png(mask.astype(np.uint8) * 255).tobytes())
        modes.append({"left": names.get("left"), "right": names.get("right"),
                      "taxonomy": TAXONOMY["both" if len(way) == 2 else next(iter(way))]})  # fmt: skip
    (folder / "modes.json").write_text(json.dumps({"modes": modes}))
    annotation = {"narration": task, "taxonomy": modes[0]["taxonomy"], "scene": "photograph"}
    (folder / "annotation.json").write_text(json.dumps(annotation))


def write_cases(photographs: Path, root: Path) -> None:
    """Write every case whole and cropped to its object, by turning tenths into pixels."""
    for number, case in enumerate(json.loads(OUTLINES.read_text())):
        rgb = np.ascontiguousarray(read_image(photographs / "scene" / f"{case['photo']}.jpg")[..., :3])
        height, width = rgb.shape[:2]
        shown = pixels(case.get("window", [0, 0, 10, 10]), height, width)
        ways = ways_of(case, height, width)
        crop = cropped(pixels(case["object"], height, width), height, width)
        for kind, window in (("masks", shown), ("cropped", crop)):
            seen = [way for way in ways if all(mask[window].sum() >= SEEN * mask.sum() for mask in way.values())]
            inside = [{hand: mask[window] for hand, mask in way.items()} for way in seen]
            write_case(root / kind / case["photo"] / f"{number:02d}", np.ascontiguousarray(rgb[window]), case["task"], inside)


def table(draws: list[Figures]) -> Iterator[str]:
    """Yield the rows of all methods, crops before whole pictures; `draws` differ in the words of other tasks."""
    yield from ("", "| | | IoU | precision | taxonomy |", "|---|---|--:|--:|--:|")
    for prefix, group in (("all.", "crops"), ("masks.all.", "whole pictures")):
        for method, title in METHODS:
            cells = (cell(draws, f"{prefix}{method}.{name}") for name in ("iou", "precision", "taxonomy_accuracy"))
            yield f"| {group} ({draws[0][f'{prefix}{method}.cases']:.0f}) | {title} | {' | '.join(cells)} |"
    yield ""


def cell(draws: list[Figures], name: str) -> str:
    """Figure with its interval; where draws differ, their mean and range."""
    values = [found[name] for found in draws if name in found]
    if len(set(values)) < 2:
        return with_interval(draws[0], name)
    return f"{np.mean(values):.3f} ({min(values):.3f} to {max(values):.3f})"


def main() -> None:
    """Write the cases, score, and write the block."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--cases", type=Path, required=True, help="new folder, which gets the cases")
    parser.add_argument("--photographs", type=Path, default=DEFAULT)
    parser.add_argument("--store", type=Path)
    args = parser.parse_args()
    write_cases(args.photographs, args.cases)
    runner = open_runner(args.store)
    model = shipped_files(TWO_HANDS, digester(runner))
    if model is None:
        raise SystemExit(f"weights/{TWO_HANDS}: no shipped model there")
    cases = tree("photographs", args.cases)
    draws = [run(runner, "benchmark", lambda g, seed=seed: two_hands(g, model, cases, seed=seed)) for seed in range(DRAWS)]
    into(PAGE, "outlined", f"shipped/{Path(__file__).name}", "\n".join(table(draws)))


if __name__ == "__main__":
    main()
