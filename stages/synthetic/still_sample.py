"""Stills with all their modes -> samples with one mode each.

Reads   Stills of one room
Writes  Samples: up to `draws` per still; the same image and text may occur with different modes
Method  modes are drawn without replacement by their probability; every draw has its own seed
Fails   when `draws` is less than 1
Paper   2HandedAfforder: a sample shows what one person did once, although a task allows several grasps
"""

from __future__ import annotations

from dataclasses import dataclass

from schemas.affordance import Samples
from schemas.scene import Stills

LIBRARIES = ("numpy",)
THREADS = 1
MEMORY_GIB = 0.5


@dataclass(frozen=True)
class Params:
    """Parameters of the stage."""

    seed: int = 1
    """seed of the draws"""
    draws: int = 2
    """maximum number of samples of one still"""


def run(stills: Stills, params: Params) -> Samples:
    """Draw the samples of one room."""
    from afford.dataset.still_samples import sample_stills

    return sample_stills(stills, params.draws, params.seed)
