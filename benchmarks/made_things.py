"""Write meshes unlike the tools of the shipped teacher, to try `run grasp-adapt` on: a tin and a dish.

    python benchmarks/made_things.py things
    python pipeline.py run grasp-adapt --source things --set body_evaluate.episodes=10

The method of the adaptation was chosen on things like these.
"""

from __future__ import annotations

import sys
from pathlib import Path

import trimesh

THINGS = {
    "tin": trimesh.creation.cylinder(0.03, 0.1, sections=32),
    "dish": trimesh.util.concatenate([trimesh.creation.annulus(0.068, 0.074, 0.05, sections=32),
                                      trimesh.creation.cylinder(0.07, 0.006, sections=32).apply_translation((0, 0, -0.022))]),
}  # fmt: skip
"""name -> mesh, m; no category of the lexicon"""


def main() -> None:
    """Write the meshes into a new folder."""
    folder = Path(sys.argv[1])
    folder.mkdir(parents=True)
    for name, mesh in THINGS.items():
        mesh.subdivide().subdivide().export(folder / f"{name}.stl")


if __name__ == "__main__":
    main()
