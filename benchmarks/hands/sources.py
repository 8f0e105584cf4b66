"""Evaluation clips with their truth: real clips without their masks, rendered rooms, composites and held-out hands."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from afford.extraction.sources.discover import discover
from afford.extraction.sources.outlines import rasterise
from afford.synthetic.splits import standard_specs
from benchmarks.hands.clip_truth import VIDEO, ClipTruth, clips
from benchmarks.hands.held_out import held_out_hands
from benchmarks.hands.pasted import composite
from benchmarks.hands.rendered import truth_of
from benchmarks.hands.sets import composites
from maps.settings import Origin, Settings
from pipeline import build
from runner import Runner
from schemas.files import FileRef, FileTree
from schemas.video import NOT_IN_CONTACT, SIDES, KeyFrame
from stages.extraction import source_read

Digest = Callable[[Path], str]
REAL = (("tabletop", "facing"), ("epic_P03_101", "ego"))
WORK_PX = (456, 256)
KINDS = ("real", "rendered", "composite", "heldout")


@dataclass(frozen=True, eq=False)
class Scene:
    """One video without masks, and its truth."""

    kind: str
    """name of the row in the table: the video of a real clip, else rendered, composite or heldout"""
    files: FileTree
    truth: ClipTruth


def real(data: Path, digest: Digest) -> Iterator[Scene]:
    """Yield the real clips; a touch counts where it was annotated."""
    for name, viewpoint in REAL:
        for tree in discover(data / name, digest).videos if (data / name).is_dir() else ():
            keys = [key for clip in source_read.run(tree, source_read.Params()) for key in clip.key_frames]
            yield Scene(tree.name, bare(tree), annotated(tree.name, viewpoint, keys))


def bare(tree: FileTree) -> FileTree:
    """Return a video's files without its masks."""
    return replace(tree, files=tuple(file for file in tree.files if not file.name.endswith(".json")))


def annotated(name: str, viewpoint: str, keys: list[KeyFrame]) -> ClipTruth:
    """Convert annotated key frames, each frame once, to truth at the working size; keypoints are not known."""
    width, height = WORK_PX
    once = {key.frame: key for key in keys}
    shape = (2, len(once), height, width)
    hands, touched = np.zeros(shape, bool), np.zeros(shape, bool)
    contact, known = np.zeros(shape[:2], bool), np.zeros(shape[:2], bool)
    for t, key in enumerate(once[frame] for frame in sorted(once)):
        masks = {a.annotation_id: rasterise(a, key.width_px, key.height_px, width, height) for a in key.annotations}
        for a in key.annotations:
            if a.side not in SIDES or not masks[a.annotation_id].any():
                continue
            n = SIDES.index(a.side)
            hands[n, t] = masks[a.annotation_id]
            contact[n, t], known[n, t] = a.contact in masks, a.contact in masks or a.contact in NOT_IN_CONTACT
            touched[n, t] = masks.get(a.contact, False)
    nothing = np.zeros((*shape[:2], 21, 3), np.float32)
    return ClipTruth(name, viewpoint, np.array(sorted(once)), hands, touched, contact, nothing[..., :2], nothing,
                     np.zeros(shape[:2], bool), np.zeros(shape, bool), known)  # fmt: skip


def rendered(seed: int, count: int, runner: Runner) -> Iterator[Scene]:
    """Yield rendered head-camera clips."""
    specs = standard_specs(seed, count)
    report = runner.run(build("scenes", Origin("hands", specs=specs), Settings()), "scenes")
    made = {clip.files.name: clip for clip in (runner.store.load(digest) for _, digest in report.outputs["scene_render"])}
    for spec in specs:
        yield Scene("rendered", bare(made[spec.video_id].files), truth_of(spec))


def pasted(kind: str, root: Path, digest: Digest) -> Iterator[Scene]:
    """Yield the composite clips of a kind that lie below `root`."""
    for folder in clips(root / kind):
        path = folder / VIDEO
        tree = FileTree(folder.name, (FileRef(VIDEO, digest(path), path.stat().st_size, path),))
        yield Scene(kind, tree, ClipTruth.load(folder))


def make_pasted(root: Path, photographs: Path, packages: Path, seed: int, count: int) -> None:
    """Render the first `count` composite clips of both kinds below `root`, where they are missing."""
    for kind in ("composite", "heldout"):
        for spec in composites(seed + (kind == "heldout"), kind[0])[:count]:
            folder = root / kind / spec.name
            if not (folder / VIDEO).exists() or not clips(folder):
                hands = {"hands": held_out_hands(spec.seed, packages)} if kind == "heldout" else {}
                composite(spec, photographs, folder, **hands)
