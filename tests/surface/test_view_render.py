"""Stage view_render: views agree with their plan."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from stages.surface import view_render
from tests.helpers.made_meshes import as_object, cup, shell

SMALL = view_render.Params(size_px=64, directions=128, most=12)


def test_views_report_their_coverage() -> None:
    """Check six names first, visible faces in the face maps, and the reached share."""
    thing = as_object(cup())
    views = view_render.run(thing, replace(SMALL, size_px=160))
    assert views.views[:6] == ("front", "back", "left", "right", "top", "bottom") and views.views[6] == "added_1"
    assert len(views.views) == len(views.rgb) == len(views.seen_area) and views.seen_area[-1] >= 0.98
    shown = np.isin(np.arange(len(thing.faces)), views.face)
    assert views.visible_area[shown].sum() / views.visible_area.sum() > 0.98


def test_inner_faces_have_no_visible_area() -> None:
    """Check an inner ball, which is in no view."""
    made = shell()
    views = view_render.run(as_object(made), SMALL)
    inner = np.linalg.norm(made.triangles_center, axis=1) < 0.07
    assert not views.visible_area[inner].any() and (views.visible_area[~inner] > 0).all()
    assert not np.isin(views.face, np.flatnonzero(inner)).any()


def test_share_zero_gives_six_views() -> None:
    """Check the paper's setting."""
    assert len(view_render.run(as_object(cup()), replace(SMALL, share=0.0)).views) == 6


def test_mesh_without_surface_is_refused() -> None:
    """Check that the error names it."""
    thing = as_object(cup(), "flat_thing")
    with pytest.raises(ValueError, match="flat_thing"):
        view_render.run(replace(thing, vertices=np.zeros_like(thing.vertices)), SMALL)
