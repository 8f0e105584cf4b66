"""Scene spec -> one EPIC/VISOR clip on disk, and the ground truth of every frame.

Reads   SceneSpec: script, setting, seed, length, distance of key frames.
Writes  RenderedClip: files (video H.264 456 x 256 at 30 fps, sparse annotations, narrations, classes, video info as in an
        EPIC root) and truth/<video_id>/ (ClipTruth; docs/synthetic/truth-format.md).
Method  objects, hands and camera follow a seeded script; a software renderer draws each frame with hands, without hands, and
        without hands but with their shadows, from one pixel-exact id map; noise and compression apply to the video only.
        Hand = skin, sleeve and worn items, so that removing it removes the arm. Deterministic.
Fails   when the script, setting or split is unknown, or an object has no grip that the script needs.
Paper   stands in for EPIC-KITCHENS-100 and VISOR where they are absent; no paper.
"""

from __future__ import annotations

from dataclasses import dataclass

from schemas.scene import RenderedClip, SceneSpec
from schemas.spec import Context

LIBRARIES = ("numpy", "numba", "scipy", "scikit-image", "trimesh", "opencv-python-headless", "av", "blake3", "safetensors",
             "pycocotools", "zstandard", "pybullet", "gymnasium")
THREADS = 1
MEMORY_GIB = 1.5
SCRATCH_GIB = 0.5


@dataclass(frozen=True)
class Params:
    """Parameters of the stage."""

    seed: int = 1
    """seed of the clips that `make dataset` renders; each clip draws its own from it"""
    supersample: int = 2
    """samples per pixel and axis of the colour images"""
    crf: int = 23
    """H.264 quality of the video; lower is better"""


def run(spec: SceneSpec, params: Params, ctx: Context) -> RenderedClip:
    """Render the clip into the scratch folder."""
    from afford.synthetic.kitchens.render_clip import render_frames, write_clip
    from afford.synthetic.kitchens.world import build_world

    world = build_world(spec)
    recording = render_frames(spec, world, params.supersample, ctx.progress)
    return write_clip(ctx.scratch / "root", spec, world.animation, recording, params.crf)
