"""an object -> pictures from all sides, with the exact face behind every pixel.

Reads   ObjectMesh
Writes  ObjectViews: six cardinal views and, where they are wanted, more; colours, faces, depth, cameras; which area can be seen
        from outside, and the share of it that the first 1..n views saw well
Method  what can be seen is found by rays in all directions; views are added greedily, the best next, until the wanted share is
        seen; a z-buffer without splatting draws them
Fails   when the mesh has no surface
Paper   AffordDex, negative affordance: six cardinal views; more than six are ours, for what those do not see
"""

from __future__ import annotations

from dataclasses import dataclass

from schemas.mesh import ObjectMesh, ObjectViews

LIBRARIES = ("numpy", "numba", "opencv-python-headless", "embreex")
THREADS = 1
MEMORY_GIB = 1.0


@dataclass(frozen=True)
class Params:
    share: float = 0.99
    """of what can be seen from outside, to be seen well: views are added to the six until then; 0 for the six alone"""
    good_deg: float = 75.0
    """largest angle between line of sight and normal at which a place is seen well"""
    most: int = 32
    """views at most"""
    directions: int = 512
    """tried all around to find out what can be seen from outside"""
    distance: float = 4.0
    """of the cameras from the middle, in radii of the object"""
    size_px: int = 384
    """width and height of the pictures"""
    supersample: int = 2
    """samples per pixel and axis"""


def run(mesh: ObjectMesh, params: Params) -> ObjectViews:
    """Look at an object from all sides."""
    from afford.render.views.draw import render_views
    from afford.render.views.plan import ViewSettings

    wish = ViewSettings(params.distance, params.good_deg, params.share, params.most)
    return render_views(mesh, wish, params.directions, params.size_px, params.supersample)
