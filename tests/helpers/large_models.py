"""Architectures of published size, without weights: LLaVA-1.5 of 7B and 13B, CLIP ViT-L/14, SAM ViT-H."""

from __future__ import annotations

from pathlib import Path

from transformers import CLIPVisionConfig, LlamaConfig, LlavaConfig, SamConfig

from afford.models.tokens import HashedTokens

VOCABULARY = 32003
"""Llama's 32000, and [SEG] and the two marks around the image"""
LANGUAGE = {"7b": (4096, 11008, 32, 32), "13b": (5120, 13824, 40, 40)}
"""width, width of the perceptron, layers, heads: Touvron et al. 2023, table 2, and the configs of Vicuna 7B and 13B"""


def write_backbones(folder: Path, size: str) -> Path:
    """The public configurations: LLaVA-1.5 with CLIP ViT-L/14 at 224 px as 2HandedAfforder has it, and SAM ViT-H."""
    width, inner, layers, heads = LANGUAGE[size]
    text = LlamaConfig(hidden_size=width, intermediate_size=inner, num_hidden_layers=layers, num_attention_heads=heads,
                       num_key_value_heads=heads, vocab_size=VOCABULARY)  # fmt: skip
    vision = CLIPVisionConfig(hidden_size=1024, intermediate_size=4096, num_hidden_layers=24, num_attention_heads=16,
                              image_size=224, patch_size=14, projection_dim=768)  # fmt: skip
    LlavaConfig(text_config=text, vision_config=vision, image_token_index=3).save_pretrained(folder / "vlm")
    encoder = {"hidden_size": 1280, "num_hidden_layers": 32, "num_attention_heads": 16, "global_attn_indexes": [7, 15, 23, 31]}
    SamConfig(vision_config=encoder).save_pretrained(folder / "sam")
    (folder / "vlm" / "tokenizer.json").write_text(HashedTokens(VOCABULARY).to_json())
    return folder
