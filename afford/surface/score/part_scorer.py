"""Part scorer: a dual encoder of mask crops (CNN) and part phrases (hashed subwords), its files, and its use.

A scorer is saved as config.json, model.safetensors and a card with its training data, figures and limits.
"""

from __future__ import annotations

import shutil
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import torch
from torch import Tensor, nn

from afford.common.files import empty_folder
from afford.models.loading import CONFIG, WEIGHTS, fill_from_file, read_config, write_model
from afford.models.word_vectors import WordVectors
from afford.surface.score.samples import CHANNELS, scorer_inputs
from afford.surface.score.shape_features import SHAPE_FEATURES
from schemas.files import FileTree
from schemas.mesh import ObjectMesh, ObjectViews
from schemas.surface import PartCandidates, PartDescriptions, PartScores

TRAITS = 4 + len(SHAPE_FEATURES)
"""number of scalar features of a candidate (shape_features.py)"""


@dataclass(frozen=True)
class PartScorerConfig:
    """Sizes of the network."""

    widths: tuple[int, ...] = (24, 48, 96, 128)
    """channels after each halving of the resolution"""
    width: int = 128
    """width of the shared embedding"""
    text_buckets: int = 2048
    """rows of the table of hashed subwords"""
    text_words: int = 16
    """words of a phrase that are read"""


class PartScorer(nn.Module):
    """Dual encoder: two logits for each pair of candidate and phrase.

    The first logit is the share of the mask that shows the part, the second the IoU of mask and part.
    """

    def __init__(self, config: PartScorerConfig) -> None:
        super().__init__()
        self.config = config
        self.close, self.whole = _trunk(config.widths), _trunk(config.widths)
        self.image = nn.Sequential(nn.Linear(2 * config.widths[-1] + TRAITS, 2 * config.width), nn.ReLU(), nn.Dropout(0.2),
                                   nn.Linear(2 * config.width, 2 * config.width))  # fmt: skip
        self.words = WordVectors(config.text_buckets, config.text_words, config.width)
        self.text = nn.Sequential(nn.LayerNorm(config.width), nn.Linear(config.width, config.width), nn.ReLU(),
                                  nn.Linear(config.width, 2 * config.width))  # fmt: skip
        self.scale, self.bias = nn.Parameter(torch.full((2,), 2.0)), nn.Parameter(torch.full((2,), -1.0))

    def forward(self, crops: Tensor, traits: Tensor, phrases: tuple[str, ...]) -> Tensor:
        """Score (b, 2, 6, s, s) crops 0..1 with (b, TRAITS) features against k phrases: (b, k, 2) logits."""
        return self.logits(self.encode_masks(crops, traits), self.encode_phrases(phrases))

    def encode_masks(self, crops: Tensor, traits: Tensor) -> Tensor:
        """Embed candidates: (b, 2, width)."""
        found = [trunk(crops[:, k] - 0.5).mean((2, 3)) for k, trunk in enumerate((self.close, self.whole))]
        return _unit(self.image(torch.cat([*found, traits], -1)))

    def encode_phrases(self, phrases: tuple[str, ...]) -> Tensor:
        """Embed phrases by the mean over their words: (k, 2, width)."""
        vectors, real = self.words(phrases)
        mean = (vectors * real[..., None]).sum(1) / real.sum(1, keepdim=True)
        return _unit(self.text(mean))

    def logits(self, masks: Tensor, phrases: Tensor) -> Tensor:
        """Compute (b, k, 2) logits of every pair as scaled cosines (sigmoid loss, Zhai et al. 2023)."""
        return torch.einsum("bhw,khw->bkh", masks, phrases) * self.scale.exp() + self.bias


def _unit(both: Tensor) -> Tensor:
    return nn.functional.normalize(both.unflatten(-1, (2, -1)), dim=-1)


def _trunk(widths: tuple[int, ...]) -> nn.Sequential:
    layers: list[nn.Module] = []
    for before, after in zip((len(CHANNELS), *widths), widths, strict=False):
        layers += [nn.Conv2d(before, after, 3, stride=2, padding=1), nn.BatchNorm2d(after), nn.ReLU()]
        layers += [nn.Conv2d(after, after, 3, padding=1, groups=after), nn.Conv2d(after, after, 1)]
        layers += [nn.BatchNorm2d(after), nn.ReLU()]
    return nn.Sequential(*layers)


CARD, FORMAT = "card.md", "afford-parts-2"


def save_scorer(scratch: Path, model: PartScorer, card: str) -> Path:
    """Write the files of a scorer, with the TensorBoard files of its training; return the folder."""
    root = empty_folder(scratch / "out")
    write_model(root, model, model.config, FORMAT)
    (root / CARD).write_text(card, encoding="utf-8")
    if (scratch / "tensorboard").exists():
        shutil.copytree(scratch / "tensorboard", root / "tensorboard")
    return root


def load_scorer(files: FileTree) -> PartScorer:
    """Load a scorer that `save_scorer` wrote; ValueError for a file that does not match."""
    config, weights = (_file(files, name) for name in (CONFIG, WEIGHTS))
    where = f"{CONFIG} of {files.name}"
    sizes = read_config(config, PartScorerConfig, FORMAT, where, "train a scorer with scorer_train")
    with torch.device("meta"):
        model = PartScorer(sizes)
    return fill_from_file(model, weights, f"{WEIGHTS} of {files.name}")


def _file(files: FileTree, name: str) -> Path:
    found = files.find(name)
    if found is None:
        there = ", ".join(file.name for file in files.files) or "no file"
        raise ValueError(f"{files.name}: expected {name} of a trained scorer, got {there}")
    return found.path


AT_ONCE = 256
"""candidates in one pass"""


def score(mesh: ObjectMesh, views: ObjectViews, candidates: PartCandidates, descriptions: PartDescriptions, scorer: FileTree,
          params: None) -> PartScores:  # fmt: skip
    """Score candidates with the trained scorer (`Score`).

    Each part is scored twice, by name and looks, and by its looks alone; the logits are averaged.
    """
    phrases = tuple(note.phrase for note in descriptions.notes)
    looks = tuple(phrase.partition(", ")[2] or phrase for phrase in phrases)
    found = np.zeros((len(candidates.view), len(phrases), 2), np.float32)
    if found.size:
        model = load_scorer(scorer).eval()
        crops, traits = scorer_inputs(mesh, views, candidates)
        with torch.inference_mode():
            for at in range(0, len(crops), AT_ONCE):
                some = slice(at, at + AT_ONCE)
                shown = model.encode_masks(torch.from_numpy(crops[some]).float() / 255, torch.from_numpy(traits[some]))
                logits = [model.logits(shown, model.encode_phrases(words)) for words in (phrases, looks)]
                found[some] = torch.stack(logits).mean(0).sigmoid().numpy()
    return PartScores(mesh.name, np.ascontiguousarray(found[..., 0]), np.ascontiguousarray(found[..., 1]))
