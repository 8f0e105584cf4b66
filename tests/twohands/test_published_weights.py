"""The names of released checkpoints, on a tiny random one that the test writes with those names."""

from __future__ import annotations

import json
import os
import pickle
import re
from pathlib import Path

import pytest
import torch
from safetensors.torch import save_file
from torch import Tensor

from afford.models.importing.source import open_source
from afford.twohands.model.interface import ModelConfig, TwoHands, build
from afford.twohands.model.published import our_names

TINY = ModelConfig(variant="vlm", size_px=(64, 64), widths=(16, 16, 32), depth=1, decoder_depth=1, heads=2)
BACK = (  # ours -> released, written down from the other side
    ("vlm.lm_head", "lm_head"), ("vlm.model.language_model.", "model."), (".base_layer.", "."),
    ("vlm.model.multi_modal_projector.linear_1", "model.mm_projector.0"),
    ("vlm.model.multi_modal_projector.linear_2", "model.mm_projector.2"),
    ("project.", "model.text_hidden_fcs.0."), ("regions.image_encoder.layers", "regions.image_encoder.blocks"),
    ("patch_embed.projection", "patch_embed.proj"), ("neck.conv1", "neck.0"), ("neck.layer_norm1", "neck.1"),
    ("neck.conv2", "neck.2"), ("neck.layer_norm2", "neck.3"), ("encoder.point_embed.", "encoder.point_embeddings."),
    ("shared_embedding.positional_embedding", "pe_layer.positional_encoding_gaussian_matrix"),
    ("mask_embed.conv1", "mask_downscaling.0"), ("mask_embed.layer_norm1", "mask_downscaling.1"),
    ("mask_embed.conv2", "mask_downscaling.3"), ("mask_embed.layer_norm2", "mask_downscaling.4"),
    ("mask_embed.conv3", "mask_downscaling.6"),
    ("upscale_conv1", "output_upscaling.0"), ("upscale_layer_norm", "output_upscaling.1"),
    ("upscale_conv2", "output_upscaling.3"), ("layer_norm_final_attn", "norm_final_attn"),
    ("regions.taxonomy.", "model.visual_model.mask_decoder_left.taxonomy_head."),
    ("regions.decoders.0.", "model.visual_model.mask_decoder_left."),
    ("regions.decoders.1.", "model.visual_model.mask_decoder_right."), ("regions.", "model.visual_model."),
)  # fmt: skip


def released_name(name: str) -> str:
    """Name in the released format of a tensor of the model."""
    if re.search(r"(taxonomy|_mlps\.\d|_head)\.(layers|proj)", name):
        name = name.replace(".layers.0.", ".layers.1.").replace(".proj_in.", ".layers.0.").replace(".proj_out.", ".layers.2.")
    for ours, theirs in BACK:
        name = name if "vision_tower" in name else name.replace(ours, theirs)
    return re.sub(r"(?<!input_)(?<!attention_)layer_norm(\d)", r"norm\1", name)


def released(model: TwoHands) -> dict[str, Tensor]:
    """A merged checkpoint: no low-rank updates, no image tower, and a buffer that older versions saved."""
    own = {n: t.clone() for n, t in model.state_dict().items() if ".lora_" not in n and "vision_tower" not in n}
    return {released_name(n): t for n, t in own.items()} | {"model.layers.0.self_attn.rotary_emb.inv_freq": torch.ones(8)}


@pytest.fixture
def given() -> dict[str, Tensor]:
    return released(build(TINY, 1))


def test_names_that_are_known_from_the_releases() -> None:
    """Names of each kind, written by hand."""
    lora = "base_model.model.model.layers.3.self_attn.v_proj.lora_B.default.weight"
    sam = "model.visual_model."
    assert our_names("model.layers.3.self_attn.q_proj.weight") == [
        "vlm.model.language_model.layers.3.self_attn.q_proj.base_layer.weight"]  # fmt: skip
    assert our_names(lora) == ["vlm.model.language_model.layers.3.self_attn.v_proj.lora_B.default.weight"]
    assert our_names("model.text_hidden_fcs.0.2.bias") == ["project.2.bias"]
    assert our_names(sam + "image_encoder.blocks.31.norm2.weight") == ["regions.image_encoder.layers.31.layer_norm2.weight"]
    assert our_names(sam + "mask_decoder_right.output_hypernetworks_mlps.2.layers.2.bias") == [
        "regions.decoders.1.output_hypernetworks_mlps.2.proj_out.bias"]  # fmt: skip
    assert our_names(sam + "mask_decoder.transformer.layers.1.cross_attn_image_to_token.q_proj.weight") == [
        f"regions.decoders.{i}.transformer.layers.1.cross_attn_image_to_token.q_proj.weight" for i in (0, 1)]
    assert our_names("model.layers.0.self_attn.rotary_emb.inv_freq") == []


@pytest.mark.parametrize("form", ["safetensors", "bin", "shards", "bin shards"])
def test_file_forms_have_equal_tensors(given: dict[str, Tensor], tmp_path: Path, form: str) -> None:
    """One file or shards with an index, safetensors or PyTorch."""
    write(given, tmp_path, form)
    found = open_source([tmp_path]).tensors
    assert found.keys() == given.keys() and all(torch.equal(tensor, given[name]) for name, tensor in found.items())


def test_code_in_a_checkpoint_does_not_run(tmp_path: Path) -> None:
    """A pickle that would make a folder is refused, and the folder is not made."""
    marker = tmp_path / "ran"

    class Cheat:
        def __reduce__(self) -> tuple[object, tuple[str]]:
            return os.mkdir, (str(marker),)

    (tmp_path / "pytorch_model.bin").write_bytes(pickle.dumps({"model.norm.weight": Cheat()}, protocol=2))
    with pytest.raises(ValueError, match="expected a file of tensors"):
        open_source([tmp_path])
    assert not marker.exists()


def test_folders_without_a_checkpoint_are_refused(tmp_path: Path) -> None:
    """An empty folder, and an index with paths outside."""
    with pytest.raises(ValueError, match="expected files of tensors"):
        open_source([tmp_path])
    (tmp_path / "model.safetensors.index.json").write_text('{"weight_map": {"a": "../a.safetensors"}}')
    with pytest.raises(ValueError, match=r"files beside it, got \.\./a"):
        open_source([tmp_path])


def write(given: dict[str, Tensor], folder: Path, form: str) -> None:
    """One of the forms that checkpoints come in."""
    kind = "pytorch_model.bin" if form.startswith("bin") else "model.safetensors"
    parts = {kind: given}
    if form.endswith("shards"):
        names = sorted(given)
        parts = {f"{i}-{kind}": {n: given[n] for n in names[i::2]} for i in (0, 1)}
        index = {"weight_map": {n: part for part, own in parts.items() for n in own}}
        (folder / f"{kind}.index.json").write_text(json.dumps(index))
    for name, own in parts.items():
        (torch.save if form.startswith("bin") else save_file)({n: t.contiguous() for n, t in own.items()}, folder / name)
