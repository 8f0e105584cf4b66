"""Register the grasping environments with gymnasium, without importing their modules.

    import gymnasium
    env = gymnasium.make("afford/AffordanceGrasp-v0")                              # the Shadow Hand and a hammer
    env = gymnasium.make("afford/AffordanceGrasp-v0", hand=hand, task=task, render_mode="rgb_array")

After `make setup` gymnasium registers them when it is imported (install/backend.py). If afford is on the path but not installed, an
import of the environment's module registers it: `gymnasium.make("afford.grasping.env.env:afford/AffordanceGrasp-v0")`.
"""

from __future__ import annotations

from typing import Any

ENVIRONMENTS = {
    "afford/AffordanceGrasp-v0": ("afford.grasping.env.env:AffordanceGrasp", "afford.grasping.env.env:AffordanceGraspVector"),
    "afford/HandImitation-v0": ("afford.grasping.imitation.imitate_env:HandImitation",
                                "afford.grasping.imitation.imitate_env:HandImitationVector"),
}
"""id -> entry points of one world and of many worlds"""


def register(gymnasium: Any = None) -> None:
    """Add missing environments to the registry of `gymnasium` (default: the installed package). A second call does nothing."""
    if gymnasium is None:
        import gymnasium
    for name, (one, many) in ENVIRONMENTS.items():
        if name not in gymnasium.registry:
            gymnasium.register(id=name, entry_point=one, vector_entry_point=many)
