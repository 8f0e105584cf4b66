"""a depth image and the regions of hands in it -> 6-DoF grasp candidates, best first.

Reads   GraspScene: depth, camera, region of each hand, hands that the task uses, negative region
Writes  GraspCandidates: for each hand grip poses, widths, fingertips, scores and their terms; pairs of both hands
Method  point cloud, normals and support plane; poses over the region with the fingers across its narrow side; one score of positive
        and negative regions, shape, surroundings and arm. Deterministic
Fails   when a hand of the task has no region with depth
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
    """Parameters of grasp_candidates."""

    count: int = 10
    """grasp candidates per hand"""
    places: int = 64
    """places tried in each region"""
    cell_m: float = 0.004
    """voxel size to which the point cloud is downsampled"""
    around_m: float = 0.2
    """margin around the regions within which points are used"""
    span_m: float = 0.09
    """largest opening of a hand"""
    lean_deg: float = 60.0
    """largest tilt from the vertical of an approach to an object on a support plane"""
    shoulder_m: tuple[float, float, float] = (0.2, 0.25, 0.0)
    """shoulder of the right arm, in the camera's frame; the left one is mirrored in x"""

    def __post_init__(self) -> None:
        """Check the ranges."""
        low = [name for name in ("count", "places", "cell_m", "around_m", "span_m", "lean_deg") if not getattr(self, name) > 0]
        if low:
            raise ValueError(f"grasp_candidates.{low[0]}: expected above 0, got {getattr(self, low[0])}")


def run(scene: GraspScene, params: Params) -> GraspCandidates:
    """Find grasp candidates in one scene."""
    from dataclasses import asdict

    from afford.grasping.candidates.find import SearchParams, find_candidates

    return find_candidates(scene, SearchParams(**asdict(params)))
