"""a spec -> an RGB-D sequence as files of the SOR3D-AFF layout, and, apart, what was true of it.

Reads   InteractionSpec: thing, affordance, instance, person, seeds.
Writes  RenderedInteraction: files (rgb, mask and hot spot as in SOR3D-AFF; depth and camera beside them) and truth (scene flow of
        every pixel in metres, optical flow, exact depth). Only the files may be learned from.
Method  a hand of the person comes, uses the thing as synthetic/tabletop/acts.py says, leaves it at rest and goes; a camera that
        stands still at the other side of the table sees it; a software renderer draws colours, points of surfaces are followed
        for the flow; depth gets a sensor's noise, steps and holes. The label is the part of the thing that the table
        in afford/dataset/affordance_rules.py names, where it is seen in the last frame. Deterministic.
Fails   when the thing is not used so, or no try shows enough of the label.
Paper   takes the place of SOR3D-AFF (section 6: RGB registered to depth, 300 x 300, 10 frames/s), which is not to be had.
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
    height_px: int = 112
    """height of the frames, and their width (the paper: 300)"""
    frames: int = 10
    """frames of a sequence, from the coming of the hand until it has left"""
    rate_hz: float = 10.0
    """frames a second"""
    clutter: int = 2
    """most other things on the table"""
    noise: float = 1.0
    """of the depth camera, times that of a Kinect; 0: nothing but whole millimetres"""
    supersample: int = 2
    """samples per pixel and axis of the colour pictures"""


def run(spec: InteractionSpec, params: Params, ctx: Context) -> RenderedInteraction:
    """Render one sequence into the scratch folder."""
    from afford.synthetic.tabletop.render_interaction import render_interaction

    if params.height_px < 32 or params.frames < 2 or params.rate_hz <= 0 or params.clutter < 0 or params.noise < 0:
        raise ValueError("interaction_render: expected height_px of 32 or more, 2 frames or more, a positive rate_hz, clutter and "
                         f"noise of 0 or more, got {params}")
    return render_interaction(spec, params.height_px, params.frames, params.rate_hz, params.clutter, params.noise,
                              params.supersample, ctx.scratch / "root")
