"""stills with all their modes -> samples that show one way each, as people do.

Reads   Stills of one room
Writes  Samples: up to `draws` per still; the same picture and text may come with different ways
Method  ways are drawn without replacement, each as likely as people are to take it; every draw has a seed of its own
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
    seed: int = 1
    """seed of the draws"""
    draws: int = 2
    """most samples of one still"""


def run(stills: Stills, params: Params) -> Samples:
    """Draw the samples of one room."""
    from afford.dataset.still_samples import sample_stills

    return sample_stills(stills, params.draws, params.seed)
