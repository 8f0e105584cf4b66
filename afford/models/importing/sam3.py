"""SAM 3 (Carion et al. 2025), of which only the detector is kept: `sam3.pt` as published, or the layout of `transformers`.

The published file is that of the video model: names of its detector begin with `detector.`. Left out are rotary frequencies, which
`transformers` computes, and the position of the class token and point prompts, which it does not use.
"""

from __future__ import annotations

import re
from collections.abc import Mapping

import torch
from torch import Tensor
from transformers import Sam3Config, Sam3Model

from afford.models.importing import Imported, parameter_count, shapes_of
from afford.models.importing.sam import config_text
from afford.models.importing.source import Source
from afford.models.sam3 import LEFT_OUT

DETECTOR, TOP, AUTHORS = "detector_model.", "model.", "detector."
"""prefixes of the detector's tensors: in the files of `transformers`, and in sam3.pt, whose tensors may be below `model`"""
UNUSED = re.compile(r"\.freqs_cis$|^backbone\.vision_backbone\.sam2_convs\.|^geometry_encoder\.points_")
"""buffers, the neck of the tracker, and point prompts"""
VIT, NECK, TEXT = "vision_encoder.backbone", "vision_encoder.neck.fpn_layers", "text_encoder.text_model"
RENAMED = (
    (r"^backbone\.vision_backbone\.trunk\.", f"{VIT}."),
    (r"\.pos_embed$", ".embeddings.position_embeddings"), (r"\.patch_embed\.proj\.", ".embeddings.patch_embeddings.projection."),
    (r"\.ln_pre\.", ".layer_norm."), (r"\.blocks\.", ".layers."),
    (r"\.attn\.qkv\.(weight|bias)$", r".attention.in_proj_\1"), (r"\.attn\.proj\.", ".attention.o_proj."),
    (r"^backbone\.vision_backbone\.convs\.", f"{NECK}."), (r"\.dconv_2x2(_0)?\.", ".scale_layers.0."),
    (r"\.dconv_2x2_1\.", ".scale_layers.2."), (r"\.conv_1x1\.", ".proj1."), (r"\.conv_3x3\.", ".proj2."),
    (r"^backbone\.language_backbone\.resizer\.", "text_projection."),
    (r"^backbone\.language_backbone\.encoder\.text_projection$", "text_encoder.text_projection.weight"),
    (r"^backbone\.language_backbone\.encoder\.", f"{TEXT}."), (r"\.token_embedding\.", ".embeddings.token_embedding."),
    (r"\.positional_embedding$", ".embeddings.position_embedding.weight"),
    (r"\.transformer\.resblocks\.", ".encoder.layers."), (r"\.attn\.", ".self_attn."), (r"\.ln_(\d)\.", r".layer_norm\1."),
    (r"\.ln_final\.", ".final_layer_norm."), (r"\.c_fc\.", ".fc1."), (r"\.c_proj\.", ".fc2."),
    (r"\.img_pre_norm\.", ".vision_layer_norm."), (r"^geometry_encoder\.norm\.", "geometry_encoder.prompt_layer_norm."),
    (r"\.encode_norm\.", ".output_layer_norm."), (r"\.encode\.", ".layers."),
    (r"^transformer\.(en|de)coder\.", r"detr_\1coder."), (r"\.cross_attn_image\.", ".cross_attn."),
    (r"^(detr_decoder\.layers\.\d+)\.cross_attn\.", r"\1.vision_cross_attn."), (r"\.ca_text\.", ".text_cross_attn."),
    (r"^(detr_decoder\.layers\.\d+)\.norm1\.", r"\1.vision_cross_attn_layer_norm."),
    (r"\.catext_norm\.", ".text_cross_attn_layer_norm."),
    (r"^(detr_decoder\.layers\.\d+)\.norm2\.", r"\1.self_attn_layer_norm."),
    (r"^(detr_decoder\.layers\.\d+)\.norm3\.", r"\1.mlp_layer_norm."),
    (r"^detr_decoder\.norm\.", "detr_decoder.output_layer_norm."), (r"\.presence_token_head\.", ".presence_head."),
    (r"\.presence_token_out_norm\.", ".presence_layer_norm."), (r"\.bbox_embed\.", ".box_head."),
    (r"\.boxRPB_embed_", ".box_rpb_embed_"), (r"\.linear([12])\.", r".mlp.fc\1."), (r"\.norm([123])\.", r".layer_norm\1."),
    (r"^segmentation_head\.", "mask_decoder."), (r"\.mask_predictor\.mask_embed\.", ".mask_embedder."),
    (r"\.cross_attend_prompt\.", ".prompt_cross_attn."), (r"\.cross_attn_norm\.", ".prompt_cross_attn_norm."),
    (r"\.(semantic|instance)_seg_head\.", r".\1_projection."), (r"^dot_prod_scoring\.", "dot_product_scoring."),
    (r"\.prompt_mlp\.out_norm\.", ".text_mlp_out_norm."), (r"\.prompt_mlp\.", ".text_mlp."), (r"\.prompt_proj\.", ".text_proj."),
    (r"\.hs_proj\.", ".query_proj."),
)  # fmt: skip
"""(pattern, replacement) of published names, applied one after the other"""
NUMBERED = re.compile(r"^(detr_decoder\.\w+|dot_product_scoring\.text_mlp)\.layers\.(\d)\.")
"""perceptrons, whose layers are layer1, layer2, ... in `transformers`"""
TOGETHER = re.compile(r"in_proj_(weight|bias)$")
"""queries, keys and values in one tensor, rows in this order"""


def import_sam3(source: Source) -> Imported:
    """Read a checkpoint of SAM 3 (`Kind`) with its tokenizer.json; the tracker of the video model is left out."""
    own, words = source.config("sam3"), source.tokenizer()
    tensors = {name.removeprefix(TOP): tensor for name, tensor in source.tensors.items()}
    published = {name.removeprefix(AUTHORS): tensor for name, tensor in tensors.items() if name.startswith(AUTHORS)}
    if not words or not (own or published):
        raise ValueError("expected sam3.pt, or the tensors of the folder facebook/sam3 with its config.json, and in a folder of "
                         "the files the tokenizer.json of SAM 3 or CLIP")
    given = our_state_dict(published) if published else {
        name.removeprefix(DETECTOR): tensor for name, tensor in tensors.items() if not name.startswith(LEFT_OUT)}
    config = Sam3Config.from_dict(own.get("detector_config", own)) if own else Sam3Config()
    with torch.device("meta"):
        expected = shapes_of(Sam3Model(config))
    return Imported("SAM 3, its detector", "--set hand_detect.backend=sam3 --set hand_detect.sam3.model=DIR",
                    {"config.json": config_text(config, Sam3Model), "tokenizer.json": words}, given, expected,
                    counted=parameter_count(given, ("position_ids",)))  # fmt: skip


def our_state_dict(published: Mapping[str, Tensor]) -> dict[str, Tensor]:
    """Names and layout of `transformers` for the tensors of the authors' detector, without the prefix `detector.`.

    The first of the positions, that of the class token, is left out. The projection of texts is transposed. Queries, keys and
    values become tensors of their own.
    """
    out: dict[str, Tensor] = {}
    for name, tensor in published.items():
        ours = our_name(name)
        if UNUSED.search(name):
            continue
        if found := TOGETHER.search(ours):
            names = (f"{ours[: found.start()]}{part}_proj.{found[1]}" for part in "qkv")
            out |= dict(zip(names, tensor.chunk(3), strict=True))
        elif name.endswith(".pos_embed"):
            out[ours] = tensor[:, 1:]
        else:
            out[ours] = tensor.T if name.endswith(".text_projection") else tensor
    return out


def our_name(name: str) -> str:
    """Name in `transformers` of a published tensor; `in_proj_weight` and `in_proj_bias` of three projections are kept."""
    for pattern, replacement in RENAMED:
        name = re.sub(pattern, replacement, name)
    if not name.startswith(TEXT):
        name = name.replace(".out_proj.", ".o_proj.")
    return NUMBERED.sub(lambda found: f"{found[1]}.layer{int(found[2]) + 1}.", name)
