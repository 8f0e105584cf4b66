"""The graph as a picture: arrows touch the boxes that they join."""

from __future__ import annotations

from itertools import pairwise

import numpy as np
from matplotlib.patches import FancyArrowPatch

from afford.extraction.stage_graph import graph_figure

STAGES = ["scene_render", "source_read", "mask_densify", "narration_labelling", "record_affordance_intersect", "clip_record"]
EDGES = [*pairwise(STAGES), ("scene_render", "clip_record"), ("source_read", "narration_labelling")]
TOUCH_PX = 4.0


def test_arrows_connect_the_edges_of_boxes() -> None:
    """Arrows end within a few pixels of boxes for names of any length; no box is under an arrow."""
    figure, boxes = graph_figure(STAGES, EDGES)
    figure.draw_without_rendering()
    (axes,) = figure.axes
    arrows = [patch for patch in axes.patches if isinstance(patch, FancyArrowPatch)]
    assert len(arrows) == len(EDGES) and all(arrow.zorder < box.zorder for arrow in arrows for box in boxes.values())
    for (source, target), arrow in zip(EDGES, arrows, strict=True):
        path = axes.transData.transform(arrow.get_path().vertices)
        start, end = (boxes[stage].get_bbox_patch().get_window_extent() for stage in (source, target))
        assert near(path[0], (start.x1, (start.y0 + start.y1) / 2)), (source, target)
        assert min(np.hypot(*(path - (end.x0, (end.y0 + end.y1) / 2)).T)) < TOUCH_PX, (source, target)


def near(point: np.ndarray, other: tuple[float, float]) -> bool:
    return bool(np.hypot(*(point - other)) < TOUCH_PX)
