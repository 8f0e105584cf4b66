"""Interaction spec -> an RGB-D sequence as files in the SOR3D-AFF layout, and its ground truth.

Reads   InteractionSpec: object, affordance, instance, person, seeds.
Writes  RenderedInteraction: files (rgb, mask and hot spot as in SOR3D-AFF, plus depth and camera) and truth (scene flow of every
        pixel in metres, optical flow, exact depth). Training may use the files only.
Method  a hand approaches, manipulates the object (afford/synthetic/tabletop/manipulations.py), leaves it at rest and withdraws,
        before a fixed camera across the table. A software renderer draws colours; surface points are tracked for the flow;
        depth gets sensor noise, quantization and holes. The label is the visible part of the object in the last frame that
        afford/dataset/affordance_rules.py names. Deterministic.
Fails   when the object does not have the affordance, or no attempt shows enough of the label.
Paper   stands in for SOR3D-AFF (section 6: RGB registered to depth, 300 x 300, 10 frames/s), which is not available.
"""

from __future__ import annotations

from dataclasses import dataclass

from schemas.interaction import InteractionSpec, RenderedInteraction
from schemas.spec import Context

LIBRARIES = ("numpy", "numba", "scipy", "scikit-image", "opencv-python-headless", "blake3")
THREADS = 1
MEMORY_GIB = 1.0


@dataclass(frozen=True)
class Params:
    """Parameters of the stage."""

    height_px: int = 112
    """height of the frames, and their width (the paper: 300)"""
    frames: int = 10
    """frames of a sequence, from the approach of the hand to its withdrawal"""
    rate_hz: float = 10.0
    """frames per second"""
    clutter: int = 2
    """maximum number of other objects on the table"""
    noise: float = 1.0
    """scale of the depth noise relative to a Kinect; 0 leaves the quantization only"""
    supersample: int = 2
    """samples per pixel and axis of the colour images"""


def run(spec: InteractionSpec, params: Params, ctx: Context) -> RenderedInteraction:
    """Render one sequence into the scratch folder."""
    from afford.synthetic.tabletop.render_interaction import render_interaction

    if params.height_px < 32 or params.frames < 2 or params.rate_hz <= 0 or params.clutter < 0 or params.noise < 0:
        raise ValueError("interaction_render: expected height_px of 32 or more, 2 frames or more, a positive rate_hz, clutter and "
                         f"noise of 0 or more, got {params}")
    return render_interaction(spec, params.height_px, params.frames, params.rate_hz, params.clutter, params.noise,
                              params.supersample, ctx.scratch / "root")
