"""LLaVA-13B with SAM ViT-H, built without memory: as many parameters as the public models have."""

from __future__ import annotations

import json
from pathlib import Path

import pytest
import torch
from torch import nn

from afford.models.importing.source import Source
from afford.models.importing.write import check_fit
from afford.twohands.model.interface import ModelConfig, build
from afford.twohands.model.published import import_2haff
from tests.helpers.large_models import LANGUAGE, VOCABULARY, write_backbones
from tests.helpers.tiny_models import bytes_tokenizer
from tests.twohands.test_published_weights import released

SAM_H = (637_026_048, 6_220 + 256, 2 * 4_058_340)
"""image encoder, prompt encoder, two mask decoders: with one decoder the 641,090,608 of sam_vit_h_4b8939, and its 256 random
frequencies of positions, a buffer there and a parameter in transformers"""
TOWER = 303_179_776
"""CLIP ViT-L/14 at 224 x 224, its image half"""


@pytest.mark.parametrize("size", ["7b", "13b"])
def test_a_released_checkpoint_of_published_size_fits(tmp_path: Path, size: str) -> None:
    """Every tensor by its released name and full shape, without memory; CLIP's tower is given beside it."""
    folder = write_backbones(tmp_path, size)
    tokens = bytes_tokenizer()
    tokens.add_special_tokens(["[SEG]"])
    (folder / "tokenizer.json").write_text(tokens.to_str())
    with torch.device("meta"):
        model = build(ModelConfig(variant="vlm", size_px=(1024, 1024), hypotheses=1, backbones=str(folder)), 0, pretrained=False)
        given = released(model)
        tower = {name.replace("vlm.model.vision_tower.", "vision_model."): tensor for name, tensor in model.state_dict().items()
                 if "vision_tower" in name}  # fmt: skip
    made = import_2haff(Source((), given | tower, (folder,)))
    check_fit(made, size)
    text = json.loads(made.texts["vlm/config.json"])["text_config"]
    width, inner, layers, heads = LANGUAGE[size]
    assert [text[name] for name in ("hidden_size", "intermediate_size", "num_hidden_layers", "num_attention_heads")] == [
        width, inner, layers, heads]  # fmt: skip
    assert json.loads(made.texts["config.json"])["size_px"] == [1024, 1024]
    assert made.counted == sum(tensor.numel() for name, tensor in (given | tower).items() if "inv_freq" not in name)


def count(module: nn.Module, *, trained: bool = False) -> int:
    return sum(parameter.numel() for parameter in module.parameters() if parameter.requires_grad or not trained)


@pytest.mark.parametrize("size", ["7b", "13b"])
def test_the_large_models_have_the_public_sizes(tmp_path: Path, size: str) -> None:
    """Part by part, and what is trained: low-rank updates of rank 8, both vocabularies, projection, decoders, taxonomy."""
    config = ModelConfig(variant="vlm", size_px=(1024, 1024), hypotheses=1, backbones=str(write_backbones(tmp_path, size)))
    with torch.device("meta"):
        model = build(config, 0, pretrained=False)
    assert all(parameter.is_meta for parameter in model.parameters())
    width, inner, layers, _ = LANGUAGE[size]
    lora = layers * 2 * (8 * width + width * 8)
    llama = 2 * VOCABULARY * width + layers * (4 * width**2 + 3 * width * inner + 2 * width) + width
    assert llama == {"7b": 6_738_415_616, "13b": 13_015_864_320}[size] + 3 * 2 * width  # the sizes that Llama is known by
    connector = 1024 * width + width + width * width + width
    projection = width * width + width + width * 256 + 256
    taxonomy = 2 * (1024 * 1024 + 1024) + 1024 * 4 + 4
    regions = model.get_submodule("regions")
    parts = (regions.image_encoder, regions.prompt_encoder, regions.decoders)
    assert tuple(map(count, parts)) == SAM_H
    assert count(model.get_submodule("vlm.model.vision_tower")) == TOWER
    assert count(model.get_submodule("vlm")) == llama + lora + TOWER + connector
    assert count(model, trained=True) == lora + 2 * VOCABULARY * width + projection + SAM_H[2] + taxonomy
    assert count(model) == llama + lora + TOWER + connector + projection + sum(SAM_H) + taxonomy
