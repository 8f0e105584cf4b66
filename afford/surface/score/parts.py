"""The embedded scorer, as scorer_train made it."""

from __future__ import annotations

import numpy as np
import torch

from afford.surface.parts import files
from afford.surface.parts.lessons import scorer_inputs
from schemas.files import FileTree
from schemas.mesh import ObjectMesh, ObjectViews
from schemas.surface import PartCandidates, PartDescriptions, PartScores

AT_ONCE = 256
"""candidates in one pass"""


def score(mesh: ObjectMesh, views: ObjectViews, candidates: PartCandidates, descriptions: PartDescriptions, scorer: FileTree,
          params: None) -> PartScores:  # fmt: skip
    """A part is asked for twice, by name and looks, and by its looks alone."""
    phrases = tuple(note.phrase for note in descriptions.notes)
    looks = tuple(phrase.partition(", ")[2] or phrase for phrase in phrases)
    found = np.zeros((len(candidates.view), len(phrases), 2), np.float32)
    if found.size:
        model = files.load_scorer(scorer).eval()
        crops, traits = scorer_inputs(mesh, views, candidates)
        with torch.inference_mode():
            for at in range(0, len(crops), AT_ONCE):
                some = slice(at, at + AT_ONCE)
                shown = model.seen(torch.from_numpy(crops[some]).float() / 255, torch.from_numpy(traits[some]))
                logits = [model.fit(shown, model.said(words)) for words in (phrases, looks)]
                found[some] = torch.stack(logits).mean(0).sigmoid().numpy()
    return PartScores(mesh.name, np.ascontiguousarray(found[..., 0]), np.ascontiguousarray(found[..., 1]))
