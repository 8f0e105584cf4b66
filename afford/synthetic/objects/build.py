"""The library of procedural objects: every category, and an object with its parts and its look out of a spec."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from afford.synthetic.objects import cutting, handtools, household, sundries, tableware, vessels, workshop
from afford.synthetic.objects.look import dressed
from afford.synthetic.objects.solids import Solid
from afford.synthetic.objects.union import Labelled, join
from schemas.mesh import MeshParts, ObjectMesh, ObjectSpec, PartedMesh

BUILDERS: dict[str, Callable[[np.random.Generator], tuple[Solid, ...]]] = {
    **cutting.BUILDERS,
    **workshop.BUILDERS,
    **vessels.BUILDERS,
    **household.BUILDERS,
    **handtools.BUILDERS,
    **tableware.BUILDERS,
    **sundries.BUILDERS,
}


def shape(category: str, seed: int, edge_m: float = 0.006, max_faces: int = 16_000) -> Labelled:
    """A new object of this category, with the part of every face; ValueError lists the categories."""
    if category not in BUILDERS:
        raise ValueError(f"ObjectSpec.category: expected one of {', '.join(sorted(BUILDERS))}, got {category!r}")
    return join(BUILDERS[category](np.random.default_rng([seed, 0])), edge_m, max_faces)


def build(spec: ObjectSpec, edge_m: float, max_faces: int, atlas_px: int) -> PartedMesh:
    """The object of a spec. Its look comes out of a random stream of its own and never sees the parts."""
    made = shape(spec.category, spec.seed, edge_m, max_faces)
    look = dressed(made.vertices, made.faces, spec.look, atlas_px, np.random.default_rng([spec.seed, 1]))
    mesh = ObjectMesh(spec.name, spec.category, look.vertices.astype(np.float32), look.faces, look.uv, look.texture)
    return PartedMesh(mesh, MeshParts(spec.name, made.names, made.part[look.source]))
