"""Backbones of the clip and vlm models: `transformers` models from a local folder, their architecture alone, or tiny ones.

A folder of backbones holds `sam/` and `clip/` or `vlm/`, each as `save_pretrained` writes it, with a tokenizer.json in the
latter. A saved two-hand model has the same layout without their weights, which are in its own model.safetensors. SAM gets one image
encoder, a mask decoder for each hand, and a taxonomy head on the mask tokens of the left hand (2HandedAfforder section 4).
"""

from __future__ import annotations

import copy
from collections.abc import Callable
from pathlib import Path
from typing import Any

import torch
from torch import Tensor, nn
from transformers import SamConfig
from transformers.models.sam.modeling_sam import SamFeedForward, SamMaskDecoder

from afford.models.tensor_files import map_safetensors
from afford.models.tokens import HashedTokens, Tokens, read_tokens

TOKENS = 4
"""mask tokens of SAM's decoder: one for a single mask, three for several"""
TINY_DEPTHS = 3, 2
"""layers of the encoder and of the decoders of the tiny SAM"""


class HandDecoder(SamMaskDecoder):  # type: ignore[misc]  # transformers ships no types here
    """Mask decoder of SAM that also returns its mask tokens."""

    def forward(self, image: Tensor, place: Tensor, prompt: Tensor, k: int) -> tuple[Tensor, Tensor, Tensor]:
        """Decode image (b, c, h, w) with the dense prompt added, at positions place (b, c, h, w), for prompt (b, n, c).

        Returns masks (b, k, 4 h, 4 w), scores (b, k), tokens (b, TOKENS, c). k = 1 takes the single-mask token.
        """
        own = torch.cat([self.iou_token.weight, self.mask_tokens.weight])
        tokens = torch.cat([own.expand(len(prompt), -1, -1), prompt], dim=1)[:, None]
        tokens, seen = self.transformer(tokens, image, place, None)
        masks = tokens[:, 0, 1 : 1 + TOKENS]
        chosen = slice(0, 1) if k == 1 else slice(1, 1 + k)
        weight = torch.stack([self.output_hypernetworks_mlps[i](masks[:, i]) for i in range(TOKENS)[chosen]], dim=1)
        fine = self._upscaled(seen.transpose(2, 3).reshape(image.shape))
        score = self.iou_prediction_head(tokens[:, 0, 0])[:, chosen]
        return torch.einsum("bkc,bchw->bkhw", weight, fine), score, masks

    def _upscaled(self, image: Tensor) -> Tensor:
        x = self.activation(self.upscale_layer_norm(self.upscale_conv1(image)))
        return self.activation(self.upscale_conv2(x))


class Regions(nn.Module):
    """SAM with a mask decoder for each hand: image and prompt -> a region for each hand."""

    def __init__(self, sam: Any, decoders: int, hypotheses: int) -> None:
        """Copy the parts of a SamModel; all decoders start from its decoder. ValueError unless it has SAM's four mask tokens."""
        super().__init__()
        config = sam.config.mask_decoder_config
        if config.num_multimask_outputs != TOKENS - 1 or not 1 <= hypotheses < TOKENS:
            raise ValueError(f"hypotheses: a SAM decoder gives 1 to {TOKENS - 1}, got {hypotheses}")
        self.hypotheses = hypotheses
        self.image_encoder, self.prompt_encoder = sam.vision_encoder, sam.prompt_encoder
        first = HandDecoder(config)
        first.load_state_dict(sam.mask_decoder.state_dict())
        self.decoders = nn.ModuleList([first] + [copy.deepcopy(first) for _ in range(decoders - 1)])
        width = TOKENS * config.hidden_size
        self.taxonomy = SamFeedForward(width, width, 4, 3)

    def forward(self, image: Tensor, prompt: Tensor) -> tuple[Tensor, Tensor, Tensor]:
        """Predict regions from a normalised image (b, 3, s, s) and a sparse prompt (b, n, c).

        Returns logits (b, 2, k, s / 4, s / 4), score logits (b, 2, k) and taxonomy logits (b, 4).
        """
        with torch.set_grad_enabled(torch.is_grad_enabled() and self._encoder_is_trained()):
            seen = self.image_encoder(image).last_hidden_state
        seen = seen + self.prompt_encoder.no_mask_embed.weight.view(1, -1, 1, 1)
        place = self._place(seen)
        found = [decoder(seen, place, prompt, self.hypotheses) for decoder in self.decoders]
        masks, score = (torch.stack([one[i] for one in found], dim=1) for i in (0, 1))
        return masks.expand(-1, 2, -1, -1, -1), score.expand(-1, 2, -1), self.taxonomy(found[0][2].flatten(1))

    def _encoder_is_trained(self) -> bool:
        return any(parameter.requires_grad for parameter in self.image_encoder.parameters())

    def _place(self, seen: Tensor) -> Tensor:
        """Positions (b, c, h, w) of the image embedding, as SAM encodes them."""
        size = seen.shape[-1]
        centre = (torch.arange(size, device=seen.device) + 0.5) / size
        y, x = torch.meshgrid(centre, centre, indexing="ij")
        place = self.prompt_encoder.shared_embedding(torch.stack([x, y], dim=-1).to(seen.dtype))
        return place.permute(2, 0, 1).expand(len(seen), -1, -1, -1)


def check_size(size_px: tuple[int, int], config: Any) -> None:
    """Raise ValueError unless the letter-box has the input size of SAM's encoder."""
    size = config.vision_config.image_size
    if size_px != (size, size):
        raise ValueError(f"ModelConfig.size_px: this SAM takes ({size}, {size}), got {size_px}")


def tiny_sam(size_px: int, width: int, heads: int) -> SamConfig:
    """Config of a SAM that trains on a CPU: global attention in all layers, patches of 16 px."""
    depth, decoder_depth = TINY_DEPTHS
    return SamConfig(
        vision_config={"hidden_size": width, "output_channels": width, "num_hidden_layers": depth, "num_attention_heads": heads,
                       "image_size": size_px, "global_attn_indexes": list(range(depth)), "window_size": 0, "mlp_ratio": 2.0,
                       "num_pos_feats": width // 2, "initializer_range": 0.02},
        prompt_encoder_config={"hidden_size": width, "image_size": size_px},
        mask_decoder_config={"hidden_size": width, "mlp_dim": 2 * width, "num_hidden_layers": decoder_depth,
                             "num_attention_heads": heads, "iou_head_hidden_dim": width},
    )  # fmt: skip


TINY_VOCABULARY = 2048


def backbone(kind: Any, folder: str, name: str, tiny: Callable[[], Any], *, pretrained: bool, as_stored: bool = False) -> Any:
    """Build a model of a `transformers` class `kind`, in float32, or with `as_stored` in the type of its files, if it is one.

    With `pretrained` the weights come from folder/name; otherwise only the architecture does, and weights are random. The config of
    `tiny()` is used when `folder` is ''. ValueError names what cannot be read.
    """
    if not folder:
        return kind(tiny())
    place = Path(folder) / name
    if not (place / "config.json").is_file():
        raise ValueError(f"{place}: expected config.json of a {kind.__name__}; set `backbones` to a folder that holds {name}/")
    if not pretrained:
        return kind(kind.config_class.from_pretrained(place)).float()
    try:
        model, report = kind.from_pretrained(
            place, output_loading_info=True, local_files_only=True, use_safetensors=True,
            dtype=stored_dtype(place) if as_stored else torch.float32)  # fmt: skip
    except OSError as error:
        raise ValueError(f"{place}: expected the weights of a {kind.__name__}; {str(error).splitlines()[0]}") from error
    wrong = sorted(report["missing_keys"]) + sorted(str(key) for key in report["mismatched_keys"])
    if wrong:
        raise ValueError(f"{place}: the weights of {kind.__name__} lack or misshape {', '.join(wrong[:20])}")
    return model


def stored_dtype(place: Path) -> torch.dtype:
    """Type of the weights in the files of a folder; float32 where there are several."""
    found = {tensor.dtype for file in place.glob("*.safetensors") for tensor in map_safetensors(file).values()
             if tensor.is_floating_point()}  # fmt: skip
    return found.pop() if len(found) == 1 else torch.float32


def tokens_of(folder: str, name: str) -> Tokens:
    """Read folder/name/tokenizer.json; hashed words when `folder` is ''."""
    return read_tokens(Path(folder) / name / "tokenizer.json") if folder else HashedTokens(TINY_VOCABULARY)


def freeze(module: nn.Module) -> None:
    """Exclude all parameters of a module from training."""
    for parameter in module.parameters():
        parameter.requires_grad_(False)
