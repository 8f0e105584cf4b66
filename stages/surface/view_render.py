"""Render views of an object from all sides, with the exact face of every pixel.

Reads   ObjectMesh
Writes  ObjectViews: six cardinal views, and more if needed; colours, faces, depth, cameras; visible area of each face, and the
        share of it that the first 1..n views see well
Method  rays in all directions find the visible surface; the next best view is added greedily until the wanted share is well seen;
        a z-buffer without splatting renders the views
Fails   when the mesh has no surface
Paper   AffordDex, negative affordance: six cardinal views; more than six are ours, for areas that those do not see
"""

from __future__ import annotations

from dataclasses import dataclass

from schemas.mesh import ObjectMesh, ObjectViews

LIBRARIES = ("numpy", "numba", "opencv-python-headless", "embreex")
THREADS = 1
MEMORY_GIB = 1.0


@dataclass(frozen=True)
class Params:
    """Parameters of `view_render`."""

    share: float = 0.99
    """share of the visible surface that must be well seen: views are added to the six until then; 0 for the six alone"""
    good_deg: float = 75.0
    """largest angle between line of sight and normal of a well seen point"""
    most: int = 32
    """largest number of views"""
    directions: int = 512
    """ray directions that decide which surface is visible from outside"""
    distance: float = 4.0
    """distance of the cameras from the centre, in radii of the object"""
    size_px: int = 384
    """width and height of the pictures"""
    supersample: int = 2
    """samples per pixel and axis"""


def run(mesh: ObjectMesh, params: Params) -> ObjectViews:
    """Render an object from all sides."""
    from afford.render.views.draw import render_views
    from afford.render.views.plan import ViewSettings

    settings = ViewSettings(params.distance, params.good_deg, params.share, params.most)
    return render_views(mesh, settings, params.directions, params.size_px, params.supersample)
