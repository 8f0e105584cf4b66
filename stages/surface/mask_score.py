"""Score the fit between candidate masks and described parts.

Reads   ObjectMesh, ObjectViews, PartCandidates, PartDescriptions of one object; files of a scorer; of a model (clip)
Writes  PartScores: share of each candidate that shows the part, and their IoU
Method  `parts` uses the scorer of scorer_train, for which a part may fit no candidate at all; `clip` is the paper's recipe, with a
        local model
Fails   when the scorer's files cannot be read
Paper   AffordDex, negative affordance: CLIP selects the best mask, one in every view
"""

from __future__ import annotations

from dataclasses import dataclass

from afford.surface.score import Clip
from schemas.files import FileTree
from schemas.mesh import ObjectMesh, ObjectViews
from schemas.surface import PartCandidates, PartDescriptions, PartScores

LIBRARIES = ("numpy", "torch", "safetensors", "opencv-python-headless")
BACKEND_LIBRARIES = {"parts": ("embreex",), "clip": ("transformers", "tokenizers")}
THREADS = 1
MEMORY_GIB = 1.0
BACKEND_MEMORY_GIB = {"clip": 3.0}
BACKEND_GPUS = {"clip": "clip.device"}
GPU_SHARED = True
BACKEND_TIMEOUT_S = {"clip": 86400.0}  # reports no progress; hours on a CPU

BACKENDS = {"parts": "afford.surface.score.part_scorer:score", "clip": "afford.surface.score.clip:score"}


@dataclass(frozen=True)
class Params:
    """Parameters of `mask_score`."""

    backend: str = "parts"
    """parts or clip"""
    clip: Clip = Clip()
    """parameters of clip"""


def run(mesh: ObjectMesh, views: ObjectViews, candidates: PartCandidates, descriptions: PartDescriptions, scorer: FileTree,
        params: Params, weights: FileTree | None = None) -> PartScores:  # fmt: skip
    """Score every candidate for every described part."""
    from afford.common.registry import block, load
    from afford.models.weights import with_local_weights

    own = with_local_weights(block(params, params.backend), weights)
    found: PartScores = load(BACKENDS, params.backend)(mesh, views, candidates, descriptions, scorer, own)
    return found
