"""Evaluate hand finders alone on clips with ground truth and photographs without hands; writes benchmarks/hand_finder.md.

    PYTHONPATH=. python benchmarks/hands/finder.py FINDER ... --clips DIR [--photographs DIR] [--fit]

FINDER are folders that hands_train wrote, for example of three seeds; a table row is the mean over them with the range. Clips
are made by benchmarks/hands/sets.py, photographs are fetched by benchmarks/hands/photographs.py; no training shows them. `--fit`
prints the weights of afford/extraction/hands/evidence.py fitted on the even clips and photographs; the table is of the odd ones.
"""

from __future__ import annotations

import argparse
import time
from collections.abc import Iterator, Sequence
from dataclasses import astuple, dataclass, field
from pathlib import Path

import cv2
import numpy as np
import torch

from afford.common.masks import iou
from afford.extraction.hands.calibrate import fit_logistic
from afford.extraction.hands.evidence import NAMES, Evidence, HandRegion, regions
from afford.extraction.hands.network import segment
from benchmarks.hands.clip_truth import VIDEO, ClipTruth, clips

ROOT = Path(__file__).resolve().parents[2]
PAGE = ROOT / "benchmarks" / "hand_finder.md"
WIDTH_PX = 640
GOOD_IOU, LIKELY = 0.5, 0.5
LEAST_SHARE, SMALL_SHARE = 200 / (1280 * 720), 0.006
"""annotated hands below the first share of the picture are left out; those below the second are small"""
FRAMES = 6
"""frames of a clip, evenly spaced"""
BINS = 10


@dataclass
class Counts:
    """Counts over pictures of one kind."""

    pictures: int = 0
    hands: int = 0
    found: int = 0
    small: int = 0
    small_found: int = 0
    sided: int = 0
    claims: int = 0
    true_claims: int = 0
    false_px: float = 0.0
    """sum over pictures of the share of pixels that are taken for a hand and are none"""
    cpu_s: float = 0.0
    evidence: list[Evidence] = field(default_factory=list)
    probability: list[float] = field(default_factory=list)
    is_hand: list[bool] = field(default_factory=list)


Picture = tuple[str, np.ndarray, dict[str, np.ndarray], bool]
"""kind, (h, w, 3) uint8, mask of each hand by side, whether the person is seen from the front"""


def clip_pictures(root: Path, odd: bool | None) -> Iterator[Picture]:
    """Yield pictures of the clips below a folder: of all, or of those with an even or an odd number at the end of their name."""
    for folder in clips(root):
        if odd is None or int(folder.name[-1]) % 2 == odd:
            truth = ClipTruth.load(folder)
            picked = np.unique(np.linspace(0, len(truth.frame) - 1, FRAMES).round().astype(int))
            frames = _frames(folder / VIDEO, truth.frame[picked])
            for t, rgb in zip(picked, frames, strict=True):
                hands = {side: _resized(truth.hands[k, t], rgb) for k, side in enumerate(("left", "right"))}
                shown = {side: mask for side, mask in hands.items() if mask.mean() >= LEAST_SHARE}
                yield f"{folder.parent.name}", rgb, shown, truth.viewpoint == "facing"


def _frames(video: Path, numbers: np.ndarray) -> list[np.ndarray]:
    wanted, found, reader = set(numbers.tolist()), list[np.ndarray](), cv2.VideoCapture(str(video))
    for number in range(1, max(wanted) + 1):
        _, bgr = reader.read()
        if number in wanted:
            found.append(_reduced(bgr[..., ::-1]))
    return found


def photograph_pictures(root: Path, odd: bool | None) -> Iterator[Picture]:
    """Yield the photographs of surfaces, scenes and faces, which show no hands."""
    for kind in ("surface", "face"):
        for n, path in enumerate(sorted((root / kind).glob("*.jpg"))):
            if odd is None or n % 2 == odd:
                yield f"no hand: {kind}", _reduced(cv2.imread(str(path))[..., ::-1]), {}, False


def _reduced(rgb: np.ndarray) -> np.ndarray:
    scale = WIDTH_PX / rgb.shape[1]
    return cv2.resize(np.ascontiguousarray(rgb), None, fx=scale, fy=scale, interpolation=cv2.INTER_AREA)


def _resized(mask: np.ndarray, rgb: np.ndarray) -> np.ndarray:
    return cv2.resize(mask.astype(np.uint8), rgb.shape[1::-1], interpolation=cv2.INTER_NEAREST) > 0


def measure(finder: Path, pictures: Iterator[Picture]) -> dict[str, Counts]:
    """Count hands found by one finder in single pictures, by kind."""
    counts: dict[str, Counts] = {}
    for kind, rgb, hands, facing in pictures:
        c, turn = counts.setdefault(kind, Counts()), slice(None, None, -1 if facing else 1)
        started = time.process_time()
        probability = segment(np.ascontiguousarray(rgb[None, turn, turn]), finder)[0, turn, turn]
        found = regions(probability, rgb)
        c.cpu_s += time.process_time() - started
        left = probability[..., 0] > probability[..., 1]
        matched = set[int]()
        for side, truth in hands.items():
            options = [(iou(part, truth), n) for n, one in enumerate(found) if one.probability >= LIKELY
                       for part in (one.mask, one.mask & left, one.mask & ~left)]  # fmt: skip
            best, n = max(options, default=(0.0, -1))
            hit, small = best >= GOOD_IOU, truth.mean() < SMALL_SHARE
            c.hands, c.found, c.small, c.small_found = c.hands + 1, c.found + hit, c.small + small, c.small_found + (hit and small)
            if hit:
                matched.add(n)
                c.sided += bool((left[truth & found[n].mask].mean() > 0.5) == (side == "left"))
        _add_regions(c, found, hands, left, matched)
        c.pictures += 1
    return counts


def _add_regions(c: Counts, found: Sequence[HandRegion], hands: dict[str, np.ndarray], left: np.ndarray, matched: set[int]) -> None:
    true = np.any([np.zeros(left.shape, bool), *hands.values()], axis=0)
    for n, one in enumerate(found):
        parts = (one.mask, one.mask & left, one.mask & ~left)
        c.is_hand.append(any(iou(part, mask) >= GOOD_IOU for part in parts for mask in (*hands.values(), true) if mask.any()))
        c.evidence.append(one.evidence)
        c.probability.append(one.probability)
        if one.probability >= LIKELY:
            c.claims += 1
            c.true_claims += n in matched
            c.false_px += float((one.mask & ~true).mean())


def calibration_error(probability: Sequence[float], is_hand: Sequence[bool]) -> float:
    """Expected calibration error of region probabilities, in BINS bins."""
    p, y = np.array(probability), np.array(is_hand, float)
    bins = np.minimum((p * BINS).astype(int), BINS - 1)
    return float(sum(abs(p[bins == b].mean() - y[bins == b].mean()) * (bins == b).mean() for b in np.unique(bins)))


COLUMNS = ("pictures", "hands", "recall", "small hands", "right side", "precision", "claims / picture", "false pixels",
           "calibration error", "CPU ms / picture")  # fmt: skip


def row(counts: Counts) -> list[float]:
    """Figures of one finder, in the order of COLUMNS; NaN where there is nothing to count."""
    def share(a: float, b: float) -> float:
        return a / b if b else float("nan")

    c, none = counts, float("nan")
    return [c.pictures, c.hands, share(c.found, c.hands), share(c.small_found, c.small), share(c.sided, c.found),
            share(c.true_claims, c.claims) if c.hands else none, share(c.claims, c.pictures), share(c.false_px, c.pictures),
            calibration_error(c.probability, c.is_hand) if c.is_hand else none, 1000 * share(c.cpu_s, c.pictures)]  # fmt: skip


def table(every: Sequence[dict[str, Counts]]) -> str:
    """Write the Markdown table: the mean over finders, with the range in brackets."""
    lines = ["| kind | " + " | ".join(COLUMNS) + " |", "| --- |" + " --: |" * len(COLUMNS)]
    for kind in every[0]:
        figures = np.array([row(one[kind]) for one in every])
        lines.append(f"| {kind} | " + " | ".join(_cell(column, n) for n, column in enumerate(figures.T)) + " |")
    return "\n".join(lines)


def _cell(values: np.ndarray, column: int) -> str:
    if np.isnan(values).all():
        return ""
    form = "{:.0f}" if column in (0, 1, 9) else "{:.4f}" if column == 7 else "{:.2f}"
    low, high, mean = values.min(), values.max(), values.mean()
    return form.format(mean) + (f" ({form.format(low)}-{form.format(high)})" if high > low and column != 9 else "")


def main() -> None:
    """Measure every finder, then write the page."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("finder", type=Path, nargs="+")
    parser.add_argument("--clips", type=Path, required=True)
    parser.add_argument("--photographs", type=Path)
    parser.add_argument("--fit", action="store_true")
    args = parser.parse_args()
    torch.set_num_threads(1)

    def pictures(odd: bool | None) -> Iterator[Picture]:
        yield from clip_pictures(args.clips, odd)
        if args.photographs:
            yield from photograph_pictures(args.photographs, odd)

    if args.fit:
        counted = [c for finder in args.finder for c in measure(finder, pictures(False)).values()]
        evidence, truth = ([one for c in counted for one in getattr(c, name)] for name in ("evidence", "is_hand"))
        weights, bias = fit_logistic(np.array([astuple(one) for one in evidence]), np.array(truth))
        print(f"{len(truth)} regions, {sum(truth)} hands; {', '.join(NAMES)}\nWEIGHTS = {tuple(round(w, 2) for w in weights)}\n"
              f"BIAS = {bias:.2f}")
    text = table([measure(finder, pictures(True if args.fit else None)) for finder in args.finder])
    about = (f"The hand finder alone on single pictures, without tracks, colours of the clip or landmarks: regions of probability "
            f"{LIKELY} or more against annotated hands at IoU {GOOD_IOU}; mean over {len(args.finder)} trainings of different "
            "seeds (range). Small hands cover less than 0.6 % of the picture. Claims of pictures without hands are all false. "
            "Weights of the evidence were fitted on other clips of the same kinds. Written by `benchmarks/hands/finder.py`.")
    PAGE.write_text(f"# Hand finder\n\n{about}\n\n{text}\n")
    print(text)


if __name__ == "__main__":
    main()
