"""Ask two-hand models about photographs that packages ship; writes docs/pictures/twohands_photographs.jpg.

    PYTHONPATH=. python benchmarks/hands/photographs.py --to ../photographs        # once
    PYTHONPATH=. python benchmarks/shipped/photographs.py --before MODEL [--after MODEL] [--photographs DIR] [--out FILE]

--before: folder of an earlier model, such as that of `make train`; --after: the shipped one by default. No training saw these
pictures, but words that stand in were added after a look at the coffee. Left: before; right: after. Orange: left hand, blue:
right hand. Photographs are those of `opencv-doc` (Apache-2.0) and `scikit-image` (coffee, by Rachel Michetti, CC0).
"""

from __future__ import annotations

import argparse
from pathlib import Path

import cv2
import numpy as np

from afford.common.image_files import encode_jpeg, read_image
from afford.common.palette import HANDS
from afford.models.shipped import TWO_HANDS, find_shipped
from afford.twohands.model.predictor import Predictor
from benchmarks.hands.photographs import DEFAULT
from benchmarks.pages import ROOT

ASKED = {
    "scikit-image": (("coffee", "lift cup"), ("coffee", "take spoon"), ("coffee", "carry saucer")),
    "opencv-doc": (("apple", "take apple"), ("HDRtoneMapping_candleSample", "take glass"),
                   ("HDRtoneMapping_candleSample", "take candle"), ("astra_color", "take pumpkin"), ("astra_color", "carry pot"),
                   ("choriginal", "take paper"), ("ela_original", "open book"), ("fruits", "take lemon"), ("left", "take book"),
                   ("right", "take book"), ("plant", "carry pot"), ("realsense", "take camera"),
                   ("singlemarkersoriginal", "take box"), ("smarties", "take sweet"), ("stuff", "take pencil"),
                   ("stuff", "take lighter"), ("newspaper", "read newspaper"))}  # fmt: skip
"""package -> its photographs, each with a task"""
WIDTH_PX, HEIGHT_PX, HEAD_PX, COLUMNS, JPEG_QUALITY = 210, 160, 20, 4, 80
FILL = 0.6
"""opacity of a region"""


def fitted(rgb: np.ndarray) -> np.ndarray:
    """Picture of the size of a tile, on black."""
    scale = min(WIDTH_PX / rgb.shape[1], HEIGHT_PX / rgb.shape[0])
    small = cv2.resize(rgb, None, fx=scale, fy=scale, interpolation=cv2.INTER_AREA)[:HEIGHT_PX, :WIDTH_PX]
    out = np.zeros((HEIGHT_PX, WIDTH_PX, 3), np.uint8)
    out[: small.shape[0], : small.shape[1]] = small
    return out


def answered(predictor: Predictor, rgb: np.ndarray, task: str) -> np.ndarray:
    """Tile with the regions that a model predicts."""
    found, out = predictor.predict(rgb, task), rgb.astype(np.float32)
    for side in ("left", "right"):
        mask = found.mask(side)
        out[mask] = (1 - FILL) * out[mask] + FILL * np.array(HANDS[side], np.float32)
    return fitted(out.astype(np.uint8))


def tile(rgb: np.ndarray, task: str, models: list[Predictor]) -> np.ndarray:
    """Answers of all models to one question, with the task above."""
    head = np.zeros((HEAD_PX, WIDTH_PX * len(models), 3), np.uint8)
    cv2.putText(head, task, (4, HEAD_PX - 6), cv2.FONT_HERSHEY_SIMPLEX, 0.45, (255, 255, 255), 1, cv2.LINE_AA)
    return np.concatenate([head, np.concatenate([answered(model, rgb, task) for model in models], axis=1)])


def main() -> None:
    """Ask, and draw."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--before", type=Path, required=True)
    parser.add_argument("--after", type=Path)
    parser.add_argument("--photographs", type=Path, default=DEFAULT)
    parser.add_argument("--out", type=Path, default=ROOT / "docs" / "pictures" / "twohands_photographs.jpg")
    args = parser.parse_args()
    after = args.after or find_shipped(TWO_HANDS)
    if after is None:
        raise SystemExit("weights/twohands: no shipped model there; give --after DIR")
    models = [Predictor(args.before), Predictor(after)]
    tiles = [tile(np.ascontiguousarray(read_image(args.photographs / "scene" / f"{package}-{name}.jpg")[..., :3]), task, models)
             for package, asked in ASKED.items() for name, task in asked]  # fmt: skip
    rows = [np.concatenate(tiles[k : k + COLUMNS], axis=1) for k in range(0, len(tiles), COLUMNS)]
    args.out.write_bytes(encode_jpeg(np.concatenate(rows), JPEG_QUALITY).tobytes())


if __name__ == "__main__":
    main()
