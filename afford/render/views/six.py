"""The paper's six cardinal views, without those that were added to them."""

from __future__ import annotations

from dataclasses import replace

from schemas.mesh import ObjectViews

SIX = 6


def six(views: ObjectViews) -> ObjectViews:
    """The first six views of an object, arrays shared with the given ones."""
    return replace(views, views=views.views[:SIX], rgb=views.rgb[:SIX], face=views.face[:SIX], depth_m=views.depth_m[:SIX],
                   K=views.K[:SIX], T_obj_cam=views.T_obj_cam[:SIX], seen_area=views.seen_area[:SIX])  # fmt: skip
