"""Published checkpoints of SAM 2: the four sizes, and the way of every tensor by its published name and shape."""

from __future__ import annotations

from collections.abc import Iterator
from itertools import pairwise
from pathlib import Path

import pytest
import torch
from torch import Tensor
from transformers import Sam2VideoConfig, Sam2VideoModel

from afford.models.sam2 import (
    SIZES,
    fill_published,
    load_model,
    our_name,
    our_state_dict,
    published_config,
    published_size,
    read_published,
)
from tests.helpers.tiny_models import save_sam2_video

COUNTS = {"tiny": 38_962_498, "small": 46_060_354, "base_plus": 80_850_178, "large": 224_446_642}
PUBLISHED_M = {"tiny": 38.9, "small": 46.0, "base_plus": 80.8, "large": 224.4}
"""SAM 2.1, in millions, cut off after the first decimal rather than rounded: 38.96 is published as 38.9, 80.85 as 80.8"""
Shapes = dict[str, tuple[int, ...]]


@pytest.mark.parametrize("size", SIZES)
def test_the_published_sizes(size: str) -> None:
    """The number of parameters, counted without memory; the name map covers exactly these."""
    with torch.device("meta"):
        model = Sam2VideoModel(published_config(size))
    count = sum(parameter.numel() for parameter in model.parameters())
    assert count == COUNTS[size] and int(count / 1e5) / 10 == PUBLISHED_M[size]
    given = {name: torch.empty(shape, device="meta") for name, shape in published(model.config).items()}
    found = {name: tuple(tensor.shape) for name, tensor in our_state_dict(given).items()}
    assert found == {name: tuple(tensor.shape) for name, tensor in model.state_dict().items()}
    assert published_size(given, "x") == size


def linear(name: str, out: int, inner: int) -> Shapes:
    return {f"{name}.weight": (out, inner), f"{name}.bias": (out,)}


def norm(name: str, width: int) -> Shapes:
    return {f"{name}.weight": (width,), f"{name}.bias": (width,)}


def convolution(name: str, *shape: int) -> Shapes:
    return {f"{name}.weight": shape, f"{name}.bias": (shape[0],)}


def perceptron(name: str, *widths: int) -> Shapes:
    layers = pairwise(widths)
    return {key: shape for i, (a, b) in enumerate(layers) for key, shape in linear(f"{name}.layers.{i}", b, a).items()}


def attention(name: str, width: int, inner: int, memory: int = 0) -> Shapes:
    read_published = {"q_proj": width, "k_proj": memory or width, "v_proj": memory or width}
    found = {key: shape for part, wide in read_published.items() for key, shape in linear(f"{name}.{part}", inner, wide).items()}
    return found | linear(f"{name}.out_proj", width, inner)


def published(c: Sam2VideoConfig) -> Shapes:
    """Names and shapes of the published state dict ("model" in sam2.1_hiera_*.pt) for an architecture."""
    out: Shapes = {"maskmem_tpos_enc": (c.num_maskmem, 1, 1, 64), "no_obj_embed_spatial": (1, 64)}
    width = c.vision_config.fpn_hidden_size
    out |= {"no_mem_embed": (1, 1, width), "no_mem_pos_enc": (1, 1, width), "no_obj_ptr": (1, width)}
    out |= convolution("mask_downsample", 1, 1, 4, 4) | perceptron("obj_ptr_proj", width, width, width, width)
    out |= linear("obj_ptr_tpos_proj", 64, width)
    for part in (trunk(c), neck(c), prompts(c, width), decoder(c, width), memory(c, width)):
        out |= dict(part)
    return out


def trunk(c: Sam2VideoConfig) -> Iterator[tuple[str, tuple[int, ...]]]:
    """image_encoder.trunk: Hiera."""
    hiera, at, before = c.vision_config.backbone_config, 0, c.vision_config.backbone_config.hidden_size
    background, window = hiera.window_positional_embedding_background_size, hiera.window_size_per_stage[0]
    yield "image_encoder.trunk.pos_embed", (1, before, *background)
    yield "image_encoder.trunk.pos_embed_window", (1, before, window, window)
    yield from convolution("image_encoder.trunk.patch_embed.proj", before, 3, 7, 7).items()
    for blocks, wide in zip(hiera.blocks_per_stage, hiera.embed_dim_per_stage, strict=True):
        for _ in range(blocks):
            name = f"image_encoder.trunk.blocks.{at}"
            yield from norm(f"{name}.norm1", before).items()
            yield from linear(f"{name}.attn.qkv", 3 * wide, before).items()
            yield from linear(f"{name}.attn.proj", wide, wide).items()
            yield from norm(f"{name}.norm2", wide).items()
            yield from perceptron(f"{name}.mlp", wide, 4 * wide, wide).items()
            if before != wide:
                yield from linear(f"{name}.proj", wide, before).items()
            at, before = at + 1, wide


def neck(c: Sam2VideoConfig) -> Iterator[tuple[str, tuple[int, ...]]]:
    for i, wide in enumerate(c.vision_config.backbone_channel_list):
        yield from convolution(f"image_encoder.neck.convs.{i}.conv", c.vision_config.fpn_hidden_size, wide, 1, 1).items()


def prompts(c: Sam2VideoConfig, width: int) -> Iterator[tuple[str, tuple[int, ...]]]:
    """sam_prompt_encoder: points one by one, masks by three convolutions."""
    name = "sam_prompt_encoder"
    yield f"{name}.pe_layer.positional_encoding_gaussian_matrix", (2, width // 2)
    for i in range(4):
        yield f"{name}.point_embeddings.{i}.weight", (1, width)
    for word in ("not_a_point_embed", "no_mask_embed"):
        yield f"{name}.{word}.weight", (1, width)
    for i, shape in ((0, (4, 1, 2, 2)), (3, (16, 4, 2, 2)), (6, (width, 16, 1, 1))):
        yield from convolution(f"{name}.mask_downscaling.{i}", *shape).items()
    for i, wide in ((1, 4), (4, 16)):
        yield from norm(f"{name}.mask_downscaling.{i}", wide).items()


def decoder(c: Sam2VideoConfig, width: int) -> Iterator[tuple[str, tuple[int, ...]]]:
    """sam_mask_decoder: a transformer that looks both ways, and its heads."""
    name, d = "sam_mask_decoder", c.mask_decoder_config
    for i in range(d.num_hidden_layers):
        layer = f"{name}.transformer.layers.{i}"
        yield from attention(f"{layer}.self_attn", width, width).items()
        for word in ("cross_attn_token_to_image", "cross_attn_image_to_token"):
            yield from attention(f"{layer}.{word}", width, width // 2).items()
        yield from perceptron(f"{layer}.mlp", width, d.mlp_dim, width).items()
        for n in range(1, 5):
            yield from norm(f"{layer}.norm{n}", width).items()
    yield from attention(f"{name}.transformer.final_attn_token_to_image", width, width // 2).items()
    yield from norm(f"{name}.transformer.norm_final_attn", width).items()
    for word, rows in (("iou_token", 1), ("mask_tokens", 4), ("obj_score_token", 1)):
        yield f"{name}.{word}.weight", (rows, width)
    yield f"{name}.output_upscaling.0.weight", (width, width // 4, 2, 2)
    yield f"{name}.output_upscaling.0.bias", (width // 4,)
    yield from norm(f"{name}.output_upscaling.1", width // 4).items()
    yield f"{name}.output_upscaling.3.weight", (width // 4, width // 8, 2, 2)
    yield f"{name}.output_upscaling.3.bias", (width // 8,)
    yield from convolution(f"{name}.conv_s0", width // 8, width, 1, 1).items()
    yield from convolution(f"{name}.conv_s1", width // 4, width, 1, 1).items()
    for i in range(4):
        yield from perceptron(f"{name}.output_hypernetworks_mlps.{i}", width, width, width, width // 8).items()
    yield from perceptron(f"{name}.iou_prediction_head", width, d.iou_head_hidden_dim, d.iou_head_hidden_dim, 4).items()
    yield from perceptron(f"{name}.pred_obj_score_head", width, width, width, 1).items()


def memory(c: Sam2VideoConfig, width: int) -> Iterator[tuple[str, tuple[int, ...]]]:
    """memory_attention and memory_encoder."""
    for i in range(c.memory_attention_num_layers):
        layer, wide = f"memory_attention.layers.{i}", c.memory_attention_feed_forward_hidden_size
        yield from attention(f"{layer}.self_attn", width, width).items()
        yield from attention(f"{layer}.cross_attn_image", width, width, 64).items()
        yield from {**linear(f"{layer}.linear1", wide, width), **linear(f"{layer}.linear2", width, wide)}.items()
        for n in range(1, 4):
            yield from norm(f"{layer}.norm{n}", width).items()
    yield from norm("memory_attention.norm", width).items()
    encoder, channels = "memory_encoder.mask_downsampler.encoder", [1, 4, 16, 64, 256]
    for i in range(4):
        yield from convolution(f"{encoder}.{3 * i}", channels[i + 1], channels[i], 3, 3).items()
        yield from norm(f"{encoder}.{3 * i + 1}", channels[i + 1]).items()
    yield from convolution(f"{encoder}.12", c.mask_downsampler_embed_dim, 256, 1, 1).items()
    yield from convolution("memory_encoder.pix_feat_proj", width, width, 1, 1).items()
    for i in range(c.memory_fuser_num_layers):
        layer, wide, inner = f"memory_encoder.fuser.layers.{i}", c.memory_fuser_embed_dim, c.memory_fuser_intermediate_dim
        yield f"{layer}.gamma", (wide,)
        yield from convolution(f"{layer}.dwconv", wide, 1, 7, 7).items()
        yield from norm(f"{layer}.norm", wide).items()
        yield from {**linear(f"{layer}.pwconv1", inner, wide), **linear(f"{layer}.pwconv2", wide, inner)}.items()
    yield from convolution("memory_encoder.out_proj", 64, width, 1, 1).items()


def drawn(model: Sam2VideoModel, seed: int = 0) -> dict[str, Tensor]:
    """A published state dict of random values for the architecture of a model."""
    chance = torch.Generator().manual_seed(seed)
    return {name: torch.randn(shape, generator=chance) * 0.02 for name, shape in published(model.config).items()}


@pytest.fixture(scope="module")
def tiny(tmp_path_factory: pytest.TempPathFactory) -> Sam2VideoModel:
    """A small architecture, whose memory has the published widths."""
    return load_model(str(save_sam2_video(tmp_path_factory.mktemp("sam2"))))


def test_values_arrive_where_they_belong(tiny: Sam2VideoModel) -> None:
    """Each tensor by its own name; rows of points together; the frequencies of positions twice."""
    given = drawn(tiny)
    state = fill_published(tiny, given, "x").state_dict()
    for name, tensor in given.items():
        if "point_embeddings" not in name:
            assert torch.equal(state[our_name(name)], tensor), name
    rows = [given[f"sam_prompt_encoder.point_embeddings.{i}.weight"] for i in range(4)]
    assert torch.equal(state["prompt_encoder.point_embed.weight"], torch.cat(rows))
    frequencies = given["sam_prompt_encoder.pe_layer.positional_encoding_gaussian_matrix"]
    assert torch.equal(state["shared_image_embedding.positional_embedding"], frequencies)


def test_tensors_that_do_not_fit_are_named(tiny: Sam2VideoModel) -> None:
    """Missing, left over and misshapen, by our names."""
    given = drawn(tiny)
    del given["obj_ptr_tpos_proj.bias"]
    given["image_encoder.trunk.extra"] = torch.zeros(2)
    given["memory_encoder.fuser.layers.0.gamma"] = torch.zeros(3)
    with pytest.raises(ValueError, match=r"3 of \d+ tensors do not fit") as caught:
        fill_published(tiny, given, "x.pt")
    for said in ("missing temporal_positional_encoding_projection_layer.bias", "extra vision_encoder.backbone.extra",
                 "misshaped memory_encoder.memory_fuser.layers.0.scale: expected (128,), got (3,)"):  # fmt: skip
        assert said in str(caught.value)


@pytest.mark.slow
def test_a_published_file_is_read_whole(tmp_path: Path) -> None:
    """sam2.1_hiera_tiny.pt with random values: the size follows from the tensors."""
    with torch.device("meta"):
        model = Sam2VideoModel(published_config("tiny"))
    given = drawn(model)
    torch.save({"model": given}, tmp_path / "sam2.1_hiera_tiny.pt")
    found = load_model(str(tmp_path / "sam2.1_hiera_tiny.pt"))
    assert torch.equal(found.state_dict()["no_object_pointer"], given["no_obj_ptr"])
    fresh = dict(Sam2VideoModel(published_config("tiny")).named_buffers())  # what is computed, and in no file
    assert all(torch.equal(buffer, fresh[name]) for name, buffer in found.named_buffers() if name not in found.state_dict())


def test_other_files_are_refused_in_a_sentence(tmp_path: Path) -> None:
    """A flat state dict, blocks of another network, code instead of tensors."""
    file = tmp_path / "x.pt"
    torch.save({"a": torch.zeros(1)}, file)
    with pytest.raises(ValueError, match=r'expected \{"model": .* got a'):
        read_published(file)
    torch.save({"model": {"image_encoder.trunk.blocks.0.norm1.weight": torch.zeros(7)}}, file)
    with pytest.raises(ValueError, match=r"expected a checkpoint of SAM 2 .* got 1 blocks of width 0"):
        read_published(file)
    torch.save({"model": Path("x")}, file)
    with pytest.raises(ValueError, match="expected tensors by name, got none"):
        read_published(file)
