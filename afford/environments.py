"""Names of the environments that gymnasium makes, each registered without an import of what it is made of.

    import gymnasium
    env = gymnasium.make("afford/AffordanceGrasp-v0")                              # the Shadow Hand and a hammer
    env = gymnasium.make("afford/AffordanceGrasp-v0", hand=hand, task=task, render_mode="rgb_array")

`make setup` has gymnasium call `register` when it is imported (install/backend.py). Where afford is not installed but only on the
path, importing an environment's module does: `gymnasium.make("afford.grasping.env.env:afford/AffordanceGrasp-v0")`.
"""

from __future__ import annotations

from typing import Any

ENVIRONMENTS = {
    "afford/AffordanceGrasp-v0": ("afford.grasping.env.env:AffordanceGrasp", "afford.grasping.env.env:AffordanceGraspVector"),
    "afford/HandImitation-v0": ("afford.grasping.imitation.imitate_env:HandImitation",
                                "afford.grasping.imitation.imitate_env:HandImitationVector"),
}
"""id -> one world, many worlds"""


def register(gymnasium: Any = None) -> None:
    """Add what is missing to the registry of `gymnasium`, or of the installed one. Again, and nothing happens."""
    if gymnasium is None:
        import gymnasium
    for name, (one, many) in ENVIRONMENTS.items():
        if name not in gymnasium.registry:
            gymnasium.register(id=name, entry_point=one, vector_entry_point=many)
