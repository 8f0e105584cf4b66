"""Draw how hand detection fails, on composite clips and one real clip; writes docs/pictures/own_video_failures.jpg.

    PYTHONPATH=. python benchmarks/hands/photographs.py     # once: backgrounds, by package name
    PYTHONPATH=. python benchmarks/hands/failures.py [--data ../shared/data] [--clips ../failure-clips] [--photographs DIR]

Found hands are filled, touched objects yellow, keypoints dotted; true hands are outlined in white. The clips have the seed of
development, on which thresholds were chosen; the figures of benchmarks/hand_detect.md come from others.
"""

from __future__ import annotations

import argparse
from dataclasses import dataclass, replace
from pathlib import Path

import cv2
import numpy as np
import torch

from afford.common.image_files import encode_jpeg
from afford.extraction.landmarks.files import landmark_files
from afford.extraction.prompted.files import segment_files
from benchmarks.hands import photographs, score
from benchmarks.hands.clip_truth import VIDEO, ClipTruth
from benchmarks.hands.detection import Models, run
from benchmarks.hands.pasted import composite
from benchmarks.hands.sets import composites
from benchmarks.hands.sources import Digest, Scene, real
from commands.session import digester, open_runner
from schemas.files import FileRef, FileTree

ROOT = Path(__file__).resolve().parents[2]
PICTURE = ROOT / "docs" / "pictures" / "own_video_failures.jpg"
SEED, PREFIX = 101, "c"
COLUMNS, LINE_PX, JPEG_QUALITY = 3, 34, 80


@dataclass(frozen=True)
class Failure:
    """A frame of a clip that shows a failure."""

    clip: str
    """name of a composite, or of a real video"""
    share: float
    """place of the frame in the clip, 0 to 1"""
    caption: str


FAILURES = (
    Failure("c12", 0.5, "1 seen from behind, fingers closed: not found"),
    Failure("c01", 0.45, "2 the hand at the handle has no landmarks"),
    Failure("c18", 0.5, "3 gloves of unusual colours: not found"),
    Failure("c14", 0.5, "4 white glove, white table: one hand lost"),
    Failure("c26", 0.6, "5 the table counts as touched; sleeve part of the hand"),
    Failure("c11", 0.5, "6 blur: the box is a hand, the sleeve an object"),
    Failure("c08", 0.55, "7 one hand counts as two"),
    Failure("c06", 0.7, "8 only a part of each object is outlined"),
    Failure("P90_02", 0.55, "9 the hand hides its block: none outlined"),
)


def scene(failure: Failure, args: argparse.Namespace, digest: Digest) -> Scene | None:
    """Make or find the clip of a failure; None for a real one that is not here."""
    if failure.clip.startswith("P"):
        return next((one for one in real(args.data, digest) if one.truth.name == failure.clip), None)
    folder = args.clips / failure.clip
    if not (folder / VIDEO).exists():
        (spec,) = (spec for spec in composites(SEED, PREFIX) if spec.name == failure.clip)
        composite(spec, args.photographs, folder)
    path = folder / VIDEO
    return Scene("composite", FileTree(folder.name, (FileRef(VIDEO, digest(path), path.stat().st_size, path),)),
                 replace(ClipTruth.load(folder), name=failure.clip))  # fmt: skip


def captioned(picture: np.ndarray, caption: str) -> np.ndarray:
    """Add a line of text below a picture."""
    line = np.full((LINE_PX, picture.shape[1], 3), 255, np.uint8)
    cv2.putText(line, caption, (6, LINE_PX - 12), cv2.FONT_HERSHEY_SIMPLEX, 0.42, (20, 20, 20), 1, cv2.LINE_AA)
    return np.concatenate([picture, line])


def main() -> None:
    """Detect, draw and write the sheet."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--data", type=Path, default=ROOT.parent / "shared" / "data")
    parser.add_argument("--clips", type=Path, default=ROOT.parent / "failure-clips")
    parser.add_argument("--photographs", type=Path, default=photographs.DEFAULT)
    parser.add_argument("--store", type=Path)
    args = parser.parse_args()
    torch.set_num_threads(1)
    cv2.setNumThreads(1)
    score.TILE_PX = 400
    digest = digester(open_runner(args.store, jobs=1))
    models, tiles = Models(landmark_files(digest), None, segment=segment_files(digest)), []
    for failure in FAILURES:
        one = scene(failure, args, digest)
        if one is not None:
            detected = run(one.files, one.truth.viewpoint, "landmarks", models)
            t = round(failure.share * (len(one.truth.frame) - 1))
            tiles.append(captioned(score.tile(one, detected, t), failure.caption))
    tiles += [np.full_like(tiles[0], 255)] * (-len(tiles) % COLUMNS)
    rows = [np.concatenate(tiles[n : n + COLUMNS], axis=1) for n in range(0, len(tiles), COLUMNS)]
    PICTURE.write_bytes(encode_jpeg(np.concatenate(rows), JPEG_QUALITY).tobytes())


if __name__ == "__main__":
    main()
