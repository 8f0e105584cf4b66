"""a depth picture and the regions of hands in it -> grasps with six degrees of freedom, best first.

Reads   GraspScene: depth, camera, region of each hand, which hands the task takes, what no hand may touch
Writes  GraspCandidates: for each hand poses of the grip, widths, fingertips, scores and what they are made of; pairs of both hands
Method  cloud, its normals and the plane that the thing lies on; poses over the region with the fingers across its narrow side; one
        score of positive and negative regions, shape, surroundings and arm. Nothing is drawn by chance
Fails   when a hand that is taken has no region with depth
Paper   2HandedAfforder, section on the robot: masks become grasps of one or two arms by the taxonomy
"""

from __future__ import annotations

from dataclasses import dataclass

from schemas.grasp import GraspCandidates, GraspScene

LIBRARIES = ("numpy", "scipy")
THREADS = 1
MEMORY_GIB = 0.5


@dataclass(frozen=True)
class Params:
    count: int = 10
    """grasps of each hand"""
    places: int = 64
    """places that are tried in each region"""
    cell_m: float = 0.004
    """distance of the points that the picture is thinned to"""
    around_m: float = 0.2
    """how far around the regions the picture is looked at"""
    span_m: float = 0.09
    """the widest that a hand spans"""
    lean_deg: float = 60.0
    """how far from upright a hand may come to a thing that lies on something"""
    shoulder_m: tuple[float, float, float] = (0.2, 0.25, 0.0)
    """where the right arm comes from, in the camera's frame; the left one mirrored in x"""

    def __post_init__(self) -> None:
        """Every number has a range."""
        low = [name for name in ("count", "places", "cell_m", "around_m", "span_m", "lean_deg") if not getattr(self, name) > 0]
        if low:
            raise ValueError(f"grasp_candidates.{low[0]}: expected above 0, got {getattr(self, low[0])}")


def run(scene: GraspScene, params: Params) -> GraspCandidates:
    """Find the grasps."""
    from dataclasses import asdict

    from afford.grasping.candidates.find import SearchParams, find_candidates

    return find_candidates(scene, SearchParams(**asdict(params)))
