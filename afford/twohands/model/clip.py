"""2HAff-CLIP: CLIP's features of the image and of the task prompt the two mask decoders, without a language model between."""

from __future__ import annotations

from typing import Any

import torch
from torch import Tensor, nn
from transformers import CLIPConfig, CLIPModel, SamModel

from afford.models.normalise import for_tower, normalised
from afford.models.tokens import Tokens, tokenize_batch
from afford.twohands.model.backbones import TINY_VOCABULARY, Regions, backbone, check_size, freeze, tiny_sam, tokens_of
from afford.twohands.model.interface import Batch, ModelConfig, Output, TwoHands

MET = "tiny random weights, 2026-11: trained whole, with CLIPModel and SamModel of transformers"

class Clip(TwoHands):
    """CLIP, two projections and the two-hand decoders of SAM."""

    def __init__(self, config: ModelConfig, clip: Any, tokens: Tokens, regions: Regions, sam_config: Any) -> None:
        super().__init__()
        self.config, self.tokens, self.sam_config = config, tokens, sam_config
        self.clip, self.regions = clip, regions
        self.frozen = config.frozen
        width, out = clip.config.projection_dim, sam_config.prompt_encoder_config.hidden_size
        self.project = nn.ModuleList(nn.Sequential(nn.Linear(width, width), nn.ReLU(), nn.Linear(width, out)) for _ in range(2))
        if self.frozen:
            for part in (clip, regions.image_encoder):
                freeze(part)
        clip.logit_scale.requires_grad_(False)  # used by contrastive training only
        freeze(regions.prompt_encoder)

    def forward(self, batch: Batch) -> Output:
        """Predict the regions of a batch; see `TwoHands`."""
        with torch.set_grad_enabled(torch.is_grad_enabled() and not self.frozen):
            features = self._see(batch.image), self._read(batch.task, batch.image.device)
        prompt = torch.stack([project(feature) for project, feature in zip(self.project, features, strict=True)], dim=1)
        logits, score, taxonomy = self.regions(normalised(batch.image), prompt)
        return Output(logits, score, taxonomy)

    def extra_files(self) -> dict[str, str]:
        """Return the configs of the backbones and the tokenizer."""
        return {"clip/config.json": self.clip.config.to_json_string(), "clip/tokenizer.json": self.tokens.to_json(),
                "sam/config.json": self.sam_config.to_json_string()}  # fmt: skip

    def _see(self, image: Tensor) -> Tensor:
        """Embedding (b, projection_dim) of each image."""
        found = self.clip.vision_model(for_tower(image, self.clip.config.vision_config.image_size))
        return self.clip.visual_projection(found.pooler_output)

    def _read(self, tasks: tuple[str, ...], device: torch.device) -> Tensor:
        """Embedding (b, projection_dim) of each task, cut to the longest text of CLIP."""
        ids, keep = tokenize_batch(self.tokens, self.clip.config.text_config, [task if self.config.text else "" for task in tasks])
        return self.clip.text_projection(self.clip.text_model(ids.to(device), attention_mask=keep.to(device)).pooler_output)


def tiny_clip(size_px: int, width: int, depth: int, heads: int) -> CLIPConfig:
    """Config of a CLIP that trains on a CPU, with hashed words as its vocabulary."""
    tower = {"hidden_size": width, "intermediate_size": 2 * width, "num_hidden_layers": depth, "num_attention_heads": heads}
    return CLIPConfig(
        text_config={**tower, "vocab_size": TINY_VOCABULARY, "max_position_embeddings": 32, "pad_token_id": 0, "bos_token_id": 1,
                     "eos_token_id": 2, "hidden_act": "gelu"},
        vision_config={**tower, "image_size": size_px, "patch_size": 16, "hidden_act": "gelu"}, projection_dim=width,
    )  # fmt: skip


def assemble(config: ModelConfig, pretrained: bool) -> Clip:
    """Build a `Clip` over config.backbones, or a tiny random one."""
    size, width = config.size_px[0], config.widths[2]
    clip = backbone(CLIPModel, config.backbones, "clip", lambda: tiny_clip(size, width, 2, config.heads), pretrained=pretrained)
    sam = backbone(SamModel, config.backbones, "sam", lambda: tiny_sam(size, width, config.heads), pretrained=pretrained)
    check_size(config.size_px, sam.config)
    regions = Regions(sam, config.decoders, config.hypotheses)
    return Clip(config, clip, tokens_of(config.backbones, "clip"), regions, sam.config)
