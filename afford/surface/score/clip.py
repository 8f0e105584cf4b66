"""CLIP scorer with AffordDex's settings: sharp mask, blurred surround, square input, 'a photo of a {part}'.

The published model is ViT-L/14 at 336 px. Parts of one task compete: shares are a softmax over them at the model's own temperature.
`overlap` is the cosine, by which the paper selects its mask. A candidate whose best cosine is below `least_cosine` fits no part.
"""

from __future__ import annotations

from pathlib import Path

import cv2
import numpy as np
import torch
from torch import Tensor
from transformers import CLIPModel

from afford.models.loading import load_pretrained, local_path
from afford.models.normalise import for_tower
from afford.models.tokens import read_tokens, tokenize_batch
from afford.surface.score import Clip
from schemas.files import FileTree
from schemas.mesh import ObjectMesh, ObjectViews
from schemas.surface import PartCandidates, PartDescriptions, PartScores

WEIGHTS = "a CLIPModel with its tokenizer.json: folder of save_pretrained, or hub id as openai/clip-vit-large-patch14-336"
MET = "authors' package, random weights, 2026-11: names and shapes of four sizes in openai-clip 1.0.1; scores with tiny ones"
BLUR = 100 / 336
"""radius of the blur, as a share of the image's side"""


def score(mesh: ObjectMesh, views: ObjectViews, candidates: PartCandidates, descriptions: PartDescriptions, scorer: FileTree,
          params: Clip) -> PartScores:  # fmt: skip
    """Score candidates with CLIP (`Score`)."""
    count = len(candidates.view), len(descriptions.notes)
    if not all(count):
        return PartScores(mesh.name, np.zeros(count, np.float32), np.zeros(count, np.float32))
    folder = _folder(params.model)
    model = load_pretrained(CLIPModel, str(folder), "clip", params.device, params.dtype)
    tokens = read_tokens(folder / "tokenizer.json")
    with torch.inference_mode():
        texts = [f"a photo of a {note.phrase.partition(',')[0].removeprefix('the ')}" for note in descriptions.notes]
        ids, keep = (one.to(model.device) for one in tokenize_batch(tokens, model.config.text_config, texts))
        phrases = _unit(model.text_projection(model.text_model(ids, attention_mask=keep).pooler_output))
        batches = [slice(at, at + params.batch) for at in range(0, count[0], params.batch)]
        cosine = torch.cat([_unit(_seen(model, views, candidates, some)) @ phrases.T for some in batches])
        fits = cosine.max(1, keepdim=True).values >= params.least_cosine
        share = (_competing(cosine * model.logit_scale.exp().float(), descriptions) * fits).cpu()
    return PartScores(mesh.name, share.numpy().astype(np.float32), ((cosine + 1) / 2).cpu().numpy().astype(np.float32))


def highlighted(rgb: np.ndarray, mask: np.ndarray) -> np.ndarray:
    """Blur the image outside the mask: (h, w, 3) uint8."""
    sigma = BLUR * rgb.shape[1] / 2
    return np.where(mask[..., None], rgb, cv2.GaussianBlur(rgb, (0, 0), sigma))


def _folder(name: str) -> Path:
    """Find the folder of config.json: the named one, or `clip/` in it."""
    where = local_path(name, "clip", "CLIPModel with its tokenizer.json")
    return where / "clip" if (where / "clip").is_dir() else where


def _seen(model: CLIPModel, views: ObjectViews, candidates: PartCandidates, some: slice) -> Tensor:
    """Embed some candidates: (b, width)."""
    pairs = zip(candidates.view[some], candidates.masks[some], strict=True)
    pictures = np.stack([highlighted(views.rgb[view], mask) for view, mask in pairs])
    image = torch.from_numpy(pictures).permute(0, 3, 1, 2).float() / 255
    tower = for_tower(image, model.config.vision_config.image_size).to(model.device, model.dtype)
    return model.visual_projection(model.vision_model(tower).pooler_output)


def _competing(logits: Tensor, descriptions: PartDescriptions) -> Tensor:
    """Apply a softmax over the parts of each task."""
    sizes = [len(one.notes) for one in descriptions.descriptions]
    return torch.cat([part.softmax(-1) for part in logits.split(sizes, dim=1)], dim=1)


def _unit(vectors: Tensor) -> Tensor:
    return torch.nn.functional.normalize(vectors.float(), dim=-1)
