"""CLIP (Radford et al. 2021): OpenAI's files (`ViT-L-14.pt`, TorchScript or tensors), or the layout of `transformers`."""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping
from typing import Any

import torch
from torch import Tensor
from transformers import CLIPConfig, CLIPModel

from afford.models.importing import Imported, leading, need, shapes_of
from afford.models.importing.sam import config_text
from afford.models.importing.source import Source

WHAT = "a checkpoint of CLIP with a vision transformer"
IGNORED = re.compile(r"position_ids$|^(input_resolution|context_length|vocab_size)$")
"""constants and computed buffers"""
SIZES = {768: "B", 1024: "L", 1280: "H"}
"""width of the image tower -> published size"""
HEAD_WIDTH = 64
"""width of an attention head in all published sizes"""
BLOCK = (("ln_1", "layer_norm1"), ("ln_2", "layer_norm2"), ("mlp.c_fc", "mlp.fc1"), ("mlp.c_proj", "mlp.fc2"),
         ("attn.out_proj", "self_attn.out_proj"))  # fmt: skip
PLACES = {
    "visual.class_embedding": "vision_model.embeddings.class_embedding",
    "visual.positional_embedding": "vision_model.embeddings.position_embedding.weight",
    "visual.conv1.weight": "vision_model.embeddings.patch_embedding.weight",
    "positional_embedding": "text_model.embeddings.position_embedding.weight",
    "token_embedding.weight": "text_model.embeddings.token_embedding.weight", "logit_scale": "logit_scale",
    **{f"{theirs}.{part}": f"{ours}.{part}" for part in ("weight", "bias") for theirs, ours in (
        ("visual.ln_pre", "vision_model.pre_layrnorm"), ("visual.ln_post", "vision_model.post_layernorm"),
        ("ln_final", "text_model.final_layer_norm"))},
}  # fmt: skip
"""OpenAI's names of the tensors outside the blocks, and those of `transformers`"""
TURNED = {"visual.proj": "visual_projection.weight", "text_projection": "text_projection.weight"}
"""projections, which OpenAI's code multiplies from the right"""


def import_clip(source: Source) -> Imported:
    """Read a checkpoint of CLIP (`Kind`); its tokenizer.json must be in a folder of the files."""
    given = {name: tensor for name, tensor in source.tensors.items() if not IGNORED.search(name)}
    if "visual.conv1.weight" in given:
        given = dict(from_openai(given))
    words = source.tokenizer()
    if not words:
        raise ValueError("expected a tokenizer.json beside the checkpoint of CLIP, found none; put the one of "
                         "openai/clip-vit-large-patch14 (any size has the same) into its folder")
    own = source.config("clip")
    config = CLIPConfig.from_dict(own) if own else CLIPConfig(**clip_sizes(given))
    with torch.device("meta"):
        expected = shapes_of(CLIPModel(config))
    vision = config.vision_config
    title = f"CLIP ViT-{SIZES.get(vision.hidden_size, vision.hidden_size)}/{vision.patch_size} at {vision.image_size} px"
    return Imported(title, "--set mask_score.backend=clip --set mask_score.clip.model=DIR; the folder clip/ of the backbones of "
                    "variant=clip; the image tower of `weights import llava|lisa|2haff`",
                    {"config.json": config_text(config, CLIPModel), "tokenizer.json": words}, given, expected)


def from_openai(given: Mapping[str, Tensor]) -> Iterator[tuple[str, Tensor]]:
    """Yield tensors under their names in `transformers`; unknown names as they are."""
    for name, tensor in given.items():
        found = re.match(r"(visual\.)?transformer\.resblocks\.(\d+)\.(.+)", name)
        if name in TURNED:
            yield TURNED[name], tensor.T
        elif found is None:
            yield PLACES.get(name, name), tensor
        else:
            tower = "vision_model" if found[1] else "text_model"
            yield from _of_block(f"{tower}.encoder.layers.{found[2]}.", found[3], tensor)


def _of_block(block: str, rest: str, tensor: Tensor) -> Iterator[tuple[str, Tensor]]:
    if rest in ("attn.in_proj_weight", "attn.in_proj_bias"):
        part = rest.rpartition("_")[2]
        yield from ((f"{block}self_attn.{one}_proj.{part}", third) for one, third in zip("qkv", tensor.chunk(3), strict=True))
        return
    for theirs, ours in BLOCK:
        if rest.startswith(f"{theirs}."):
            rest = ours + rest.removeprefix(theirs)
    yield block + rest, tensor


def tower_sizes(given: Mapping[str, Tensor], prefix: str) -> dict[str, Any]:
    """Fields of the config of an image tower, from tensors below `prefix`."""
    patches = need(given, f"{prefix}embeddings.patch_embedding.weight", WHAT)
    places = need(given, f"{prefix}embeddings.position_embedding.weight", WHAT)
    width, patch = int(patches.shape[0]), int(patches.shape[-1])
    inner = need(given, f"{prefix}encoder.layers.0.mlp.fc1.weight", WHAT)
    return {"hidden_size": width, "patch_size": patch, "image_size": patch * round((len(places) - 1) ** 0.5),
            "intermediate_size": int(inner.shape[0]), "num_hidden_layers": leading(given, f"{prefix}encoder.layers.*."),
            "num_attention_heads": max(width // HEAD_WIDTH, 1)}  # fmt: skip


def clip_sizes(given: Mapping[str, Tensor]) -> dict[str, Any]:
    """Fields of a CLIPConfig, from tensors with names of `transformers`."""
    words = need(given, "text_model.embeddings.token_embedding.weight", WHAT)
    places = need(given, "text_model.embeddings.position_embedding.weight", WHAT)
    inner = need(given, "text_model.encoder.layers.0.mlp.fc1.weight", WHAT)
    out, width = need(given, "text_projection.weight", WHAT).shape
    text = {"vocab_size": len(words), "hidden_size": int(width), "intermediate_size": int(inner.shape[0]),
            "max_position_embeddings": len(places), "num_hidden_layers": leading(given, "text_model.encoder.layers.*."),
            "num_attention_heads": max(int(width) // HEAD_WIDTH, 1), "bos_token_id": len(words) - 2, "eos_token_id": len(words) - 1,
            "projection_dim": int(out)}  # fmt: skip
    return {"text_config": text, "vision_config": tower_sizes(given, "vision_model.") | {"projection_dim": int(out)},
            "projection_dim": int(out)}  # fmt: skip
