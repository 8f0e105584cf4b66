"""Categories of household bodies for grasping: tools, vessels and packages, five of them held out of every training."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from afford.synthetic.objects import cutting, household, library, open_vessels, packages, tableware, vessels, workshop
from afford.synthetic.objects.solid_shapes import Solid
from afford.synthetic.objects.texture import texture_surface
from schemas.mesh import MeshParts, ObjectMesh, ObjectSpec, PartedMesh

BUILDERS: dict[str, Callable[[np.random.Generator], tuple[Solid, ...]]] = {
    **cutting.BUILDERS, **workshop.BUILDERS, **vessels.BUILDERS, **household.BUILDERS, **tableware.BUILDERS,
    **open_vessels.BUILDERS, **packages.BUILDERS}  # fmt: skip
STANDING = ("bottle", "bowl", "box", "bucket", "can", "carton", "cup", "jar", "jug", "kettle", "mug", "pan", "pitcher", "pot",
            "soap_dispenser", "spray_bottle", "teapot", "tube", "wine_glass")  # fmt: skip
"""categories that are built upright; the others are built as they lie"""
LYING = ("brush", "chisel", "flashlight", "hammer", "knife", "ladle", "pizza_cutter", "rolling_pin", "screwdriver", "spatula")
CATEGORIES = (*STANDING, *LYING)
HELD_OUT = ("bowl", "carton", "jar", "jug", "tube")
"""categories that serve evaluations only: no policy, prior or scorer may be trained or chosen on them"""


def build_body(spec: ObjectSpec, edge_m: float, max_faces: int) -> PartedMesh:
    """Build the mesh of a spec, of one colour. ValueError, with the known categories, for another one."""
    if spec.category not in CATEGORIES:
        raise ValueError(f"ObjectSpec.category: expected one of {', '.join(sorted(CATEGORIES))}, got {spec.category!r}")
    made = library.unite_parts(BUILDERS[spec.category](np.random.default_rng([spec.seed, 0])), edge_m, max_faces)
    look = texture_surface(made.vertices, made.faces, spec.look, 64, np.random.default_rng([spec.seed, 1]))
    mesh = ObjectMesh(spec.name, spec.category, look.vertices.astype(np.float32), look.faces, look.uv, look.texture)
    return PartedMesh(mesh, MeshParts(spec.name, made.names, made.part[look.source]))
