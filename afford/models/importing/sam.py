"""Segment Anything (Kirillov et al. 2023): `sam_vit_{b,l,h}*.pth` as published, or the layout of `transformers`.

Sizes are those of the tensors. Eight heads of the mask decoder and half-width attention in it are the same in all published sizes.
"""

from __future__ import annotations

import json
import re
from collections.abc import Mapping
from typing import Any

import torch
from torch import Tensor
from transformers import SamConfig, SamModel

from afford.models.importing import Imported, leading, need, parameter_count, shapes_of
from afford.models.importing.source import Source

WHAT = "a checkpoint of Segment Anything"
NAMES = {(768, 12): "ViT-B", (1024, 24): "ViT-L", (1280, 32): "ViT-H"}
"""width and depth of the published image encoders"""
STEM = (
    (r"^image_encoder\.patch_embed\.proj\.", "image_encoder.patch_embed.projection."),
    (r"^image_encoder\.blocks\.", "image_encoder.layers."),
    (r"^image_encoder\.neck\.0\.", "image_encoder.neck.conv1."), (r"^image_encoder\.neck\.1\.", "image_encoder.neck.layer_norm1."),
    (r"^image_encoder\.neck\.2\.", "image_encoder.neck.conv2."), (r"^image_encoder\.neck\.3\.", "image_encoder.neck.layer_norm2."),
    (r"^prompt_encoder\.pe_layer\.positional_encoding_gaussian_matrix$", "prompt_encoder.shared_embedding.positional_embedding"),
    (r"^prompt_encoder\.point_embeddings\.", "prompt_encoder.point_embed."),
    (r"^prompt_encoder\.mask_downscaling\.0\.", "prompt_encoder.mask_embed.conv1."),
    (r"^prompt_encoder\.mask_downscaling\.1\.", "prompt_encoder.mask_embed.layer_norm1."),
    (r"^prompt_encoder\.mask_downscaling\.3\.", "prompt_encoder.mask_embed.conv2."),
    (r"^prompt_encoder\.mask_downscaling\.4\.", "prompt_encoder.mask_embed.layer_norm2."),
    (r"^prompt_encoder\.mask_downscaling\.6\.", "prompt_encoder.mask_embed.conv3."),
    (r"(_mlps\.\d|_head)\.layers\.0\.(?=weight|bias)", r"\1.proj_in."),
    (r"(_mlps\.\d|_head)\.layers\.1\.(?=weight|bias)", r"\1.layers.0."),
    (r"(_mlps\.\d|_head)\.layers\.2\.(?=weight|bias)", r"\1.proj_out."),
    (r"\.norm(\d)\.", r".layer_norm\1."), (r"\.norm_final_attn\.", ".layer_norm_final_attn."),
    (r"\.output_upscaling\.0\.", ".upscale_conv1."), (r"\.output_upscaling\.1\.", ".upscale_layer_norm."),
    (r"\.output_upscaling\.3\.", ".upscale_conv2."),
)  # fmt: skip
"""(pattern, replacement), applied one after the other: published names -> those of `transformers`, without the encoder's own"""
COPIED = ("prompt_encoder.shared_embedding.positional_embedding", "shared_image_embedding.positional_embedding")
"""two names of one tensor in SamModel; files have either or both"""


def sam_name(name: str) -> str:
    """Name in SamModel of a published tensor, with `image_encoder.` for `vision_encoder.`."""
    for pattern, replacement in STEM:
        name = re.sub(pattern, replacement, name)
    return name


def import_sam(source: Source) -> Imported:
    """Read a checkpoint of Segment Anything (`Kind`)."""
    given = source.tensors
    if any(name.startswith("image_encoder.") for name in given):
        given = {re.sub(r"^image_encoder\.", "vision_encoder.", sam_name(name)): tensor for name, tensor in given.items()}
    for one, other in (COPIED, COPIED[::-1]):
        if one in given:
            given = {**given, other: given[one]}
    config = SamConfig(**sam_sizes(given, "vision_encoder.", "mask_decoder."))
    with torch.device("meta"):
        expected = shapes_of(SamModel(config))
    return Imported(f"Segment Anything {sam_title(config)}", "--set mask_propose.backend=sam --set mask_propose.sam.model=DIR; the "
                    "folder sam/ of the backbones of variant=clip and variant=vlm", {"config.json": config_text(config, SamModel)},
                    given, expected, counted=parameter_count(given, ("positional_embedding",)))  # fmt: skip


def sam_sizes(given: Mapping[str, Tensor], encoder: str, decoder: str, prompts: str = "prompt_encoder.") -> dict[str, Any]:
    """Fields of a SamConfig, from tensors with names of `transformers` below these prefixes. ValueError for another network."""
    place = need(given, f"{encoder}pos_embed", WHAT)
    width, side = int(place.shape[-1]), int(place.shape[1])
    depth = leading(given, f"{encoder}layers.*.")
    patch = int(need(given, f"{encoder}patch_embed.projection.weight", WHAT).shape[-1])
    relative = [need(given, f"{encoder}layers.{n}.attn.rel_pos_h", WHAT) for n in range(depth)]
    windows = [(len(one) + 1) // 2 for one in relative]
    everywhere = [n for n, window in enumerate(windows) if window == side]
    local = next((window for window in windows if window != side), 0)
    out = int(need(given, f"{encoder}neck.conv1.weight", WHAT).shape[0])
    inner = need(given, f"{encoder}layers.0.mlp.lin1.weight", WHAT)
    hidden = need(given, f"{decoder}transformer.layers.0.mlp.lin1.weight", WHAT)
    head = need(given, f"{decoder}iou_prediction_head.proj_in.weight", WHAT)
    masks = need(given, f"{prompts}mask_embed.conv3.weight", WHAT)
    return {
        "vision_config": {"hidden_size": width, "output_channels": out, "num_hidden_layers": depth, "patch_size": patch,
                          "num_attention_heads": width // int(relative[0].shape[-1]), "image_size": side * patch,
                          "global_attn_indexes": everywhere, "window_size": local, "mlp_ratio": inner.shape[0] / width,
                          "num_pos_feats": out // 2},
        "prompt_encoder_config": {"hidden_size": out, "image_size": side * patch, "patch_size": patch,
                                  "mask_input_channels": int(masks.shape[1])},
        "mask_decoder_config": {"hidden_size": out, "mlp_dim": int(hidden.shape[0]), "iou_head_hidden_dim": int(head.shape[0]),
                                "num_hidden_layers": leading(given, f"{decoder}transformer.layers.*."),
                                "iou_head_depth": leading(given, f"{decoder}iou_prediction_head.layers.*.") + 2},
    }  # fmt: skip


def sam_title(config: SamConfig) -> str:
    """Published name of a size, or its numbers."""
    size = config.vision_config.hidden_size, config.vision_config.num_hidden_layers
    return NAMES.get(size, f"({size[1]} layers of width {size[0]})")


def config_text(config: Any, kind: type) -> str:
    """Text of config.json as `save_pretrained` writes it."""
    fields = json.loads(config.to_json_string(use_diff=False)) | {"architectures": [kind.__name__]}
    return json.dumps(fields, indent=2, sort_keys=True) + "\n"


