"""Published checkpoints of SAM 2 and 2.1 (`sam2*_hiera_*.pt`): their four sizes, and the names of their tensors in `transformers`.

Read are tensors only. Every tensor must find its place: what is missing, left over or misshapen is named, one by one.
"""

from __future__ import annotations

import re
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import torch
from torch import Tensor
from transformers import Sam2HieraDetConfig, Sam2VideoConfig, Sam2VideoModel, Sam2VisionConfig

from afford.models import archive
from afford.models.fitting import fit

SIZES: dict[str, dict[str, Any]] = {
    "tiny": {"hidden_size": 96, "blocks_per_stage": [1, 2, 7, 2], "global_attention_blocks": [5, 7, 9],
             "num_attention_heads_per_stage": [1, 2, 4, 8]},
    "small": {"hidden_size": 96, "blocks_per_stage": [1, 2, 11, 2], "global_attention_blocks": [7, 10, 13],
              "num_attention_heads_per_stage": [1, 2, 4, 8]},
    "base_plus": {"hidden_size": 112, "blocks_per_stage": [2, 3, 16, 3], "global_attention_blocks": [12, 16, 20],
                  "num_attention_heads_per_stage": [2, 4, 8, 16], "window_positional_embedding_background_size": [14, 14]},
    "large": {"hidden_size": 144, "blocks_per_stage": [2, 6, 36, 4], "global_attention_blocks": [23, 33, 43],
              "num_attention_heads_per_stage": [2, 4, 8, 16], "window_size_per_stage": [8, 4, 16, 8]},
}
"""Hiera of each size (Ravi et al. 2024, appendix): width of the first stage, which doubles with every stage, and blocks"""
TOP = "model."
"""what the names of a published file begin with"""
POINTS = 4
"""kinds of points that can prompt; one tensor there, rows of one here"""
FREQUENCIES = "prompt_encoder.shared_embedding.positional_embedding"
COPY = "shared_image_embedding.positional_embedding"

THREE = r"((?:iou_prediction_head|pred_obj_score_head|output_hypernetworks_mlps\.\d+|object_pointer_proj))\.layers\."
RENAMED = (
    (r"^image_encoder\.trunk\.", "vision_encoder.backbone."),
    (r"^image_encoder\.neck\.convs\.(\d+)\.conv\.", r"vision_encoder.neck.convs.\1."),
    (r"\.patch_embed\.proj\.", ".patch_embed.projection."),
    (r"^sam_prompt_encoder\.", "prompt_encoder."),
    (r"\.pe_layer\.positional_encoding_gaussian_matrix$", ".shared_embedding.positional_embedding"),
    (r"\.mask_downscaling\.0\.", ".mask_embed.conv1."),
    (r"\.mask_downscaling\.1\.", ".mask_embed.layer_norm1."),
    (r"\.mask_downscaling\.3\.", ".mask_embed.conv2."),
    (r"\.mask_downscaling\.4\.", ".mask_embed.layer_norm2."),
    (r"\.mask_downscaling\.6\.", ".mask_embed.conv3."),
    (r"^sam_mask_decoder\.", "mask_decoder."),
    (r"\.output_upscaling\.0\.", ".upscale_conv1."),
    (r"\.output_upscaling\.1\.", ".upscale_layer_norm."),
    (r"\.output_upscaling\.3\.", ".upscale_conv2."),
    (r"^memory_encoder\.mask_downsampler\.encoder\.12\.", "memory_encoder.mask_downsampler.final_conv."),
    (r"^memory_encoder\.pix_feat_proj\.", "memory_encoder.feature_projection."),
    (r"^memory_encoder\.out_proj\.", "memory_encoder.projection."),
    (r"^memory_encoder\.fuser\.", "memory_encoder.memory_fuser."),
    (r"\.dwconv\.", ".depthwise_conv."),
    (r"\.pwconv(\d)\.", r".pointwise_conv\1."),
    (r"\.gamma$", ".scale"),
    (r"\.out_proj\.", ".o_proj."),
    (r"\.norm(\d?)\.", r".layer_norm\1."),
    (r"\.norm_final_attn\.", ".layer_norm_final_attn."),
    (r"\.mlp\.layers\.0\.", ".mlp.proj_in."),
    (r"\.mlp\.layers\.1\.", ".mlp.proj_out."),
    (r"^obj_ptr_proj\.", "object_pointer_proj."),
    (THREE + r"0\.", r"\1.proj_in."),
    (THREE + r"1\.", r"\1.layers.0."),
    (THREE + r"2\.", r"\1.proj_out."),
    (r"^obj_ptr_tpos_proj\.", "temporal_positional_encoding_projection_layer."),
    (r"^maskmem_tpos_enc$", "memory_temporal_positional_encoding"),
    (r"^no_mem_embed$", "no_memory_embedding"),
    (r"^no_mem_pos_enc$", "no_memory_positional_encoding"),
    (r"^no_obj_ptr$", "no_object_pointer"),
    (r"^no_obj_embed_spatial$", "occlusion_spatial_embedding_parameter"),
)
"""(pattern, replacement), applied one after the other"""
DOWNSAMPLER = re.compile(r"^(memory_encoder\.mask_downsampler)\.encoder\.(\d+)\.(weight|bias)$")


def our_name(name: str) -> str:
    """What a published tensor is called in `transformers`."""
    for pattern, replacement in RENAMED:
        name = re.sub(pattern, replacement, name)
    found = DOWNSAMPLER.match(name)
    if found:  # a convolution, its norm and an activation without weights, again and again
        layer, part = divmod(int(found[2]), 3)
        name = f"{found[1]}.layers.{layer}.{('conv', 'layer_norm', 'activation')[part]}.{found[3]}"
    return name


def renamed(published: Mapping[str, Tensor]) -> dict[str, Tensor]:
    """A published state dict under our names: rows of points together, frequencies of positions twice."""
    out = {our_name(name): tensor for name, tensor in published.items()}
    rows = [out.pop(f"prompt_encoder.point_embeddings.{i}.weight", None) for i in range(POINTS)]
    there = [row for row in rows if row is not None]
    if there:
        out["prompt_encoder.point_embed.weight"] = torch.cat(there)
    if FREQUENCIES in out:
        out[COPY] = out[FREQUENCIES]
    return out


def config(size: str, *, version: str = "2.1") -> Sam2VideoConfig:
    """The architecture of a published size; 2.0 has no places in time for pointers and no sign of what is hidden."""
    hiera = SIZES[size]
    widths = [hiera["hidden_size"] * 2**stage for stage in range(4)]
    vision = Sam2VisionConfig(backbone_config=Sam2HieraDetConfig(embed_dim_per_stage=widths, **hiera),
                              backbone_channel_list=widths[::-1])  # fmt: skip
    later = version != "2.0"
    return Sam2VideoConfig(vision_config=vision, enable_temporal_pos_encoding_for_object_pointers=later,
                           enable_occlusion_spatial_embedding=later)  # fmt: skip


def size_of(published: Mapping[str, Tensor], where: str) -> str:
    """Which size a state dict is of, by the width and number of its blocks. ValueError when it is none."""
    first = published.get("image_encoder.trunk.patch_embed.proj.weight")
    numbers = {int(found[1]) for name in published if (found := re.match(r"image_encoder\.trunk\.blocks\.(\d+)\.", name))}
    got = (0 if first is None else len(first), len(numbers))
    known = {(hiera["hidden_size"], sum(hiera["blocks_per_stage"])): size for size, hiera in SIZES.items()}
    if got not in known:
        raise ValueError(f"{where}: expected a checkpoint of SAM 2 (hiera {', '.join(SIZES)}), got {got[1]} blocks of width "
                         f"{got[0]}; give sam2.1_hiera_*.pt as it is published, or a folder of a Sam2VideoModel")
    return known[got]


def read(path: Path) -> Sam2VideoModel:
    """The model of a published checkpoint. ValueError names every tensor that is missing, left over or misshapen."""
    published = read_tensors(path)
    version = "2.1" if "no_obj_embed_spatial" in published else "2.0"
    return filled(Sam2VideoModel(config(size_of(published, str(path)), version=version)), published, str(path))


def filled(model: Sam2VideoModel, published: Mapping[str, Tensor], where: str) -> Sam2VideoModel:
    """A model with published weights in it; ValueError when one does not fit."""
    fit(model, renamed(published), where, "give a published SAM 2 or 2.1")
    return model


def read_tensors(path: Path) -> dict[str, Tensor]:
    """Name -> tensor of a published file, {"model": {name: tensor}}; nothing but tensors is read. ValueError when it is none."""
    found = archive.read_tensors(path)
    if foreign := [name for name in found if not name.startswith(TOP)]:
        raise ValueError(f'{path}: expected {{"model": {{name: tensor}}}} as SAM 2 is published, got {", ".join(foreign[:4])}')
    return {name.removeprefix(TOP): tensor for name, tensor in found.items()}
