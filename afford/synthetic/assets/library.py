"""Library of scene objects by kind. The same generator state gives the same object."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from afford.synthetic.assets import containers, crockery, desk_items, kitchenware, workshop_tools
from afford.synthetic.assets.object_model import ObjectModel

BUILDERS: dict[str, Callable[[np.random.Generator], ObjectModel]] = {
    **crockery.BUILDERS,
    **containers.BUILDERS,
    **kitchenware.BUILDERS,
    **workshop_tools.BUILDERS,
    **desk_items.BUILDERS,
}


def build(kind: str, rng: np.random.Generator) -> ObjectModel:
    """Build an object of a kind with random shape, colours and print. Raises KeyError with the known kinds."""
    if kind not in BUILDERS:
        raise KeyError(f"unknown object kind {kind!r}; choose one of {', '.join(sorted(BUILDERS))}")
    return BUILDERS[kind](rng)
