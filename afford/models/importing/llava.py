"""LLaVA-1.5 (Liu et al. 2023), 7B and 13B: the authors' files with CLIP's beside them, or either layout of `transformers`."""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping
from typing import Any

import torch
from torch import Tensor
from transformers import LlavaConfig, LlavaForConditionalGeneration

from afford.models.importing import Imported, leading, need, shapes_of
from afford.models.importing.clip import tower_sizes
from afford.models.importing.sam import config_text
from afford.models.importing.source import Source
from afford.models.tokens import IMAGE, FileTokens

WHAT = "a checkpoint of LLaVA"
IGNORED = re.compile(r"rotary_emb\.(original_)?inv_freq$|position_ids$")
"""computed buffers that older versions saved"""
HEAD = 128
"""width of an attention head of Llama in all published sizes"""
PLACES = (
    (r"^language_model\.model\.", "model.language_model."), (r"^language_model\.lm_head\.", "lm_head."),
    (r"^multi_modal_projector\.", "model.multi_modal_projector."), (r"^vision_tower\.", "model.vision_tower."),
    (r"^model\.vision_tower\.vision_tower\.", "model.vision_tower."),
    (r"^model\.vision_tower\.vision_model\.", "model.vision_tower."),
    (r"^model\.mm_projector\.0\.", "model.multi_modal_projector.linear_1."),
    (r"^model\.mm_projector\.2\.", "model.multi_modal_projector.linear_2."),
    (r"^model\.(?=(layers|embed_tokens|norm)\.)", "model.language_model."),
    (r"^vision_model\.", "model.vision_tower."),
)  # fmt: skip
"""(pattern, replacement), applied one after the other: the authors' names, older ones of `transformers`, and those of CLIP"""
CLIP_ONLY = re.compile(r"^(text_model\.|text_projection\.|visual_projection\.|logit_scale$)")
"""tensors of a whole CLIP that its image tower does not have"""
NO_TOWER = ("expected the image tower, which the authors' files do not contain; give the folder of CLIP too (openai/"
            "clip-vit-large-patch14-336 for LLaVA-1.5, openai/clip-vit-large-patch14 for 2HandedAfforder and LISA)")  # fmt: skip


def import_llava(source: Source) -> Imported:
    """Read a checkpoint of LLaVA (`Kind`); tokenizer.json must be in a folder of the files."""
    given = dict(llava_names(source.tensors))
    words = source.tokenizer()
    if not words:
        raise ValueError("expected a tokenizer.json beside the checkpoint of LLaVA, found none; put the one of "
                         "llava-hf/llava-1.5-7b-hf into its folder")
    config = LlavaConfig(**llava_sizes(given, "model.", language_fields(source)), image_token_index=FileTokens(words).id(IMAGE))
    with torch.device("meta"):
        expected = shapes_of(LlavaForConditionalGeneration(config))
    count = sum(tensor.numel() for name, tensor in given.items() if "vision_tower" not in name)
    return Imported(f"LLaVA {count / 1e9:.1f}B", "the folder vlm/ of the backbones of variant=vlm; part_describe and grasp_judge "
                    "with backend=vlm, where the folder gets the files of its processor too",
                    {"config.json": config_text(config, LlavaForConditionalGeneration), "tokenizer.json": words}, given, expected)


def llava_names(given: Mapping[str, Tensor]) -> Iterator[tuple[str, Tensor]]:
    """Yield tensors under their names in `transformers`, without computed buffers and CLIP's text tower."""
    for name, tensor in given.items():
        if IGNORED.search(name) or CLIP_ONLY.match(name):
            continue
        yield llava_name(name), tensor


def llava_name(name: str) -> str:
    """Name in `transformers` of a published tensor."""
    for pattern, replacement in PLACES:
        name = re.sub(pattern, replacement, name)
    return name


def language_fields(source: Source) -> dict[str, Any]:
    """Fields of a language model in a config.json beside the checkpoint, which tensors do not show; empty without one."""
    own = source.config("llava") or source.config("llama") or source.config()
    own = own.get("text_config", own)
    kept = ("num_attention_heads", "num_key_value_heads", "rms_norm_eps", "rope_theta", "rope_parameters",
            "max_position_embeddings", "pad_token_id", "bos_token_id", "eos_token_id")  # fmt: skip
    return {name: own[name] for name in kept if own.get(name) is not None}


def llava_sizes(given: Mapping[str, Tensor], prefix: str, own: Mapping[str, Any]) -> dict[str, Any]:
    """Fields of a LlavaConfig from tensors below `prefix`; `own`: fields of a config.json. ValueError for another model."""
    if f"{prefix}vision_tower.embeddings.patch_embedding.weight" not in given:
        raise ValueError(NO_TOWER)
    rows, width = need(given, f"{prefix}language_model.embed_tokens.weight", WHAT).shape
    inner = need(given, f"{prefix}language_model.layers.0.mlp.gate_proj.weight", WHAT)
    keys = need(given, f"{prefix}language_model.layers.0.self_attn.k_proj.weight", WHAT)
    heads = own.get("num_attention_heads", max(int(width) // HEAD, 1))
    text = {"model_type": "llama", "vocab_size": int(rows), "hidden_size": int(width), "intermediate_size": int(inner.shape[0]),
            "num_hidden_layers": leading(given, f"{prefix}language_model.layers.*."), "num_attention_heads": heads,
            "num_key_value_heads": int(keys.shape[0]) * heads // int(width), "rms_norm_eps": 1e-5,
            "max_position_embeddings": 4096, "pad_token_id": 0, "bos_token_id": 1, "eos_token_id": 2} | dict(own)  # fmt: skip
    tower = {"model_type": "clip_vision_model", **tower_sizes(given, f"{prefix}vision_tower."), "projection_dim": 768}
    return {"text_config": text, "vision_config": tower}
