"""What SOR3D-AFF's paper reports on its own data, to stand beside ours."""

from __future__ import annotations

MODEL: dict[str, tuple[float, float, float]] = {"video": (0.72, 0.80, 0.81), "static": (0.54, 0.58, 0.59)}
"""IoU, F, weighted F of its model, of videos and of pictures"""
AFFORDANCENET = (0.56, 0.62, 0.62)
"""of pictures, by what was trained with boxes"""
ROWS: dict[str, tuple[float, float]] = {
    "rgb": (0.62, 0.73),
    "rgb_attention": (0.65, 0.77),
    "rgb_attention_flow2d": (0.66, 0.78),
    "rgbd": (0.64, 0.77),
    "rgbd_attention": (0.70, 0.79),
    "rgbd_attention_flow3d": (0.72, 0.80),
}
"""IoU, F of the rows of its ablation, of videos"""
STEPS: tuple[tuple[str, str, str], ...] = (
    ("attention", "rgb", "rgb_attention"),
    ("2-D flow", "rgb_attention", "rgb_attention_flow2d"),
    ("depth", "rgb", "rgbd"),
    ("attention, with depth", "rgbd", "rgbd_attention"),
    ("depth, with attention", "rgb_attention", "rgbd_attention"),
    ("3-D flow", "rgbd_attention", "rgbd_attention_flow3d"),
    ("learning actions before", "rgbd_attention_flow3d", "pretrained"),
)
"""what, the row without it, the row with it"""
