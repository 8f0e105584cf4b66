"""Score hand detection from video alone; writes benchmarks/hand_detect.md and docs/pictures/hand_detect.jpg.

    PYTHONPATH=. python benchmarks/hands/photographs.py     # once: backgrounds, by package name
    PYTHONPATH=. python benchmarks/hands/score.py [--kinds real,rendered,composite,heldout] [--modes finder,landmarks,fused]
        [--data ../shared/data] [--clips ../hand-clips] [--photographs DIR] [--store DIR] [--finder DIR,...] [--seed N]
        [--count N] [--rendered N] [--page FILE] [--dry]

Real clips are a last look: nothing is chosen on them. Rendered clips, composites and held-out hands have fresh seeds. Masks are
those of mask_densify on annotated frames; a hand ends at the sleeve.
"""

from __future__ import annotations

import argparse
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import torch

from afford.common.image_files import encode_jpeg
from afford.common.palette import HANDS
from afford.extraction.landmarks.files import landmark_files
from afford.extraction.prompted.files import segment_files
from afford.models.weights import weight_files
from benchmarks.hands import photographs
from benchmarks.hands.detection import MODES, Detected, Models, run
from benchmarks.hands.scoring import Score, score_clip
from benchmarks.hands.sources import KINDS, Digest, Scene, make_pasted, pasted, real, rendered
from commands.session import digester, open_runner
from maps.settings import Origin, Settings
from pipeline import build
from runner import Runner
from schemas.files import FileTree

ROOT = Path(__file__).resolve().parents[2]
PAGE, PICTURE = ROOT / "benchmarks" / "hand_detect.md", ROOT / "docs" / "pictures" / "hand_detect.jpg"
TILE_PX, TILES, STRIPS, JPEG_QUALITY = 300, 5, 8, 82
HEAD = ("clips", "mode", "hands", "recall", "precision", "right side", "touch right", "object found", "keypoint error",
        "depth error", "CPU ms a frame")  # fmt: skip
WITH_FINDER = ("finder", "fused")
"""modes that need a trained hand finder"""
Costs = dict[tuple[str, str], tuple[Score, float, int]]
"""(kind, mode) -> score, CPU seconds, video frames"""


def trained(runner: Runner) -> FileTree:
    """Train the hand finder, as data sets use it."""
    report = runner.run(build("hands", Origin("hands"), Settings()), "hands")
    ((_, digest),) = report.outputs["hands_train.files"]
    found: FileTree = runner.store.load(digest)
    return found


def finders(args: argparse.Namespace, runner: Runner, digest: Digest) -> list[FileTree]:
    """Files of the hand finders that are asked for; of one that is trained first without `--finder`."""
    return [weight_files(folder, digest) for folder in args.finder] if args.finder else [trained(runner)]


def scenes(args: argparse.Namespace, runner: Runner, digest: Digest) -> Iterator[Scene]:
    """Yield the clips of the chosen kinds."""
    if {"composite", "heldout"} & set(args.kinds):
        make_pasted(args.clips, args.photographs, args.photographs.parent, args.seed, args.count)
    for kind in args.kinds:
        if kind == "real":
            yield from real(args.data, digest)
        elif kind == "rendered":
            yield from rendered(args.seed, args.rendered, runner)
        else:
            yield from pasted(kind, args.clips, digest)


def tile(scene: Scene, detected: Detected, t: int) -> np.ndarray:
    """Draw a frame: detected masks filled, touched objects in yellow, keypoints, annotated hands outlined in white."""
    frame = int(scene.truth.frame[t])
    rgb = next(f.rgb[int(np.searchsorted(f.frame, frame))] for f in detected.frames if f.frame[0] <= frame <= f.frame[-1])
    out, size = rgb.copy(), rgb.shape[1::-1]
    for one in detected.found.get(frame, []):
        for mask, colour in ((one.thing, (240, 220, 60)), (one.mask, HANDS[one.side])):
            if mask is not None:
                out[mask] = (0.5 * out[mask] + 0.5 * np.array(colour)).astype(np.uint8)
        for x, y in one.keypoints_px if one.keypoints_px is not None else ():
            cv2.circle(out, (round(float(x)), round(float(y))), 1, (255, 255, 255), -1)
    for n in (0, 1):
        truth = cv2.resize(scene.truth.hands[n, t].astype(np.uint8), size, interpolation=cv2.INTER_NEAREST)
        lines, _ = cv2.findContours(truth, cv2.RETR_EXTERNAL, cv2.CHAIN_APPROX_NONE)
        cv2.drawContours(out, lines, -1, (255, 255, 255), 1)
    return cv2.resize(out, (TILE_PX, TILE_PX * 9 // 16), interpolation=cv2.INTER_AREA)


def page(costs: Costs, args: argparse.Namespace) -> str:
    """Build the Markdown table."""
    rows = [HEAD, ("---", "---", *["--:"] * (len(HEAD) - 2))]
    for (kind, mode), (s, cpu_s, frames) in costs.items():
        shares = ((s.found, s.annotated), (s.true_claims, s.claimed), (s.sided, s.side_claims), (s.contacts_right, s.contacts),
                  (s.things_found, s.things))  # fmt: skip
        cells = [f"{a / b:.2f}" if b else "" for a, b in shares]
        errors = [f"{np.mean(s.keypoint_error):.3f}" if s.keypoint_error else "",
                  f"{np.median(s.depth_error):.3f}" if s.depth_error else ""]  # fmt: skip
        rows.append((kind, mode, str(s.annotated), *cells, *errors, f"{1000 * cpu_s / max(frames, 1):.0f}"))
    text = (
        "Hands of annotated frames, found from the video alone at IoU 0.5. Precision counts every mask of a hand in an annotated "
        "frame. Of the hands found: the share on the right side, with the correct contact state, and the share of touched objects "
        "found at IoU 0.5. Keypoint error: mean distance as a share of the distance from the wrist to the tip of the middle "
        "finger. Depth error: median relative error of the palm's depth at the true focal length. A hand ends at the sleeve.\n\n"
        "`finder`: the hand finder trained on rendered rooms. `landmarks`: MediaPipe's landmarks. `fused`: both. "
        "`composite`: rendered hands before photographs of packages. `heldout`: the same with hands of MakeHuman and WebXR. "
        f"`rendered`: rendered rooms. These have the seed {args.seed}, on which nothing was chosen. `P90` (seen from "
        "the front) and `P03_101` are real. That key frames are 0.2 s apart was decided on them, and on them the network of held "
        "objects was found wanting, and the constant for touches was chosen with them in view: they are no held-out test. "
        "One core. Written by `benchmarks/hands/score.py "
        f"--kinds {','.join(args.kinds)} --modes {','.join(args.modes)} --count {args.count} --rendered {args.rendered}`."
        + (f" Scores of {len(args.finder)} finders, trained with different seeds, are pooled." if args.finder else "")
    )
    return "\n".join(["# Hands where there are no masks", "", text, "", *("| " + " | ".join(row) + " |" for row in rows)]) + "\n"


def measure(scene: Scene, mode: str, models: Models, costs: Costs, strips: dict[str, np.ndarray]) -> None:
    """Score one clip in one mode, and print the score."""
    detected = run(scene.files, scene.truth.viewpoint, mode, models)
    score = score_clip(scene.truth, detected.found)
    print(f"{scene.kind} {scene.truth.name} {scene.truth.viewpoint} {mode}: {score.line()}", flush=True)
    total, cpu_s, frames = costs.get((scene.kind, mode), (Score(), 0.0, 0))
    costs[scene.kind, mode] = total + score, cpu_s + detected.cpu_s, frames + detected.count
    shown = np.linspace(0, len(scene.truth.frame) - 1, TILES + 2).round().astype(int)[1:-1]
    strips[scene.truth.name] = np.concatenate([tile(scene, detected, int(t)) for t in shown], axis=1)


def main() -> None:
    """Score the chosen clips in the chosen modes, then write the page and the picture."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--data", type=Path, default=ROOT.parent / "shared" / "data")
    parser.add_argument("--clips", type=Path, default=ROOT.parent / "hand-clips")
    parser.add_argument("--photographs", type=Path, default=photographs.DEFAULT)
    parser.add_argument("--store", type=Path)
    parser.add_argument("--finder", type=lambda text: text.split(","),
                        help="folders of trained hand finders, whose scores are pooled; one is trained first by default")
    parser.add_argument("--page", type=Path, default=PAGE)
    parser.add_argument("--kinds", type=lambda text: text.split(","), default=list(KINDS))
    parser.add_argument("--modes", type=lambda text: text.split(","), default=list(MODES))
    parser.add_argument("--seed", type=int, default=30417)
    parser.add_argument("--count", type=int, default=32, help="composite clips of each kind")
    parser.add_argument("--rendered", type=int, default=6, help="rendered clips")
    parser.add_argument("--held", type=Path, help="folder of a trained network of held objects; none by default")
    parser.add_argument("--dry", action="store_true", help="write neither page nor picture; save strips as DIR/NAME.jpg of --clips")
    args = parser.parse_args()
    torch.set_num_threads(1)
    cv2.setNumThreads(1)
    runner = open_runner(args.store, jobs=1)
    digest = digester(runner)
    held = weight_files(str(args.held), digest) if args.held else None
    base = Models(landmark_files(digest), None, held, segment_files(digest))
    with_finder = [replace(base, finder=one) for one in finders(args, runner, digest)] if set(WITH_FINDER) & set(args.modes) else []
    models = {mode: with_finder if mode in WITH_FINDER else [base] for mode in args.modes}
    costs: Costs = {}
    strips: dict[str, np.ndarray] = {}
    for scene in scenes(args, runner, digest):
        for mode, ready in models.items():
            for one in ready:
                if mode in one.modes():
                    measure(scene, mode, one, costs, strips)
    print(page(costs, args))
    if args.dry:
        for name, strip in strips.items():
            (args.clips / f"{name}.jpg").write_bytes(encode_jpeg(strip, JPEG_QUALITY).tobytes())
        return
    chosen = [strips[name] for name in list(strips)[:: max(1, len(strips) // STRIPS)][:STRIPS]]
    if args.page == PAGE:
        PICTURE.write_bytes(encode_jpeg(np.concatenate(chosen), JPEG_QUALITY).tobytes())
    args.page.write_text(page(costs, args))


if __name__ == "__main__":
    main()
