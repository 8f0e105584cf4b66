"""Published checkpoints of SAM 3: the way of every tensor of the detector by its published name, shape and layout."""

from __future__ import annotations

from collections.abc import Iterator
from itertools import pairwise
from pathlib import Path

import pytest
import torch
from safetensors.torch import load_file
from torch import Tensor
from transformers import Sam3Config, Sam3Model

from afford.models.importing.sam3 import our_state_dict
from commands.weights_import import bring
from tests.helpers.tiny_models import save_sam3

Shapes = Iterator[tuple[str, tuple[int, ...]]]
DEPTHS = {4.0: (2, 4), 2.0: (2,), 1.0: (), 0.5: ()}
"""scale of a level -> widths of its transposed convolutions, as shares of the width of the encoder"""


def layer(name: str, *shape: int) -> Shapes:
    yield from ((f"{name}.weight", shape), (f"{name}.bias", shape[:1]))


def up(name: str, inner: int, out: int) -> Shapes:
    yield from ((f"{name}.weight", (inner, out, 2, 2)), (f"{name}.bias", (out,)))


def together(name: str, width: int) -> Shapes:
    yield from ((f"{name}.in_proj_weight", (3 * width, width)), (f"{name}.in_proj_bias", (3 * width,)))
    yield from layer(f"{name}.out_proj", width, width)


def perceptron(name: str, *widths: int) -> Shapes:
    for i, (a, b) in enumerate(pairwise(widths)):
        yield from layer(f"{name}.layers.{i}", b, a)


def block(name: str, attentions: tuple[str, ...], norms: tuple[str, ...], width: int, inner: int) -> Shapes:
    for part in attentions:
        yield from together(f"{name}.{part}", width)
    for part in norms:
        yield from layer(f"{name}.{part}", width)
    yield from layer(f"{name}.linear1", inner, width)
    yield from layer(f"{name}.linear2", width, inner)


def vision(c: Sam3Config) -> Shapes:
    trunk, v, width = "backbone.vision_backbone.trunk", c.vision_config.backbone_config, c.vision_config.backbone_config.hidden_size
    yield f"{trunk}.pos_embed", (1, (v.pretrain_image_size // v.patch_size) ** 2 + 1, width)
    yield f"{trunk}.patch_embed.proj.weight", (width, 3, v.patch_size, v.patch_size)
    yield from layer(f"{trunk}.ln_pre", width)
    for i in range(v.num_hidden_layers):
        yield f"{trunk}.blocks.{i}.attn.freqs_cis", (4, 4)
        for name, shape in {"norm1": (width,), "norm2": (width,), "attn.qkv": (3 * width, width), "attn.proj": (width, width),
                            "mlp.fc1": (v.intermediate_size, width), "mlp.fc2": (width, v.intermediate_size)}.items():
            yield from layer(f"{trunk}.blocks.{i}.{name}", *shape)
    out = c.vision_config.fpn_hidden_size
    for neck in ("convs", "sam2_convs"):
        for k, shares in enumerate(DEPTHS[scale] for scale in c.vision_config.scale_factors):
            name, widths = f"backbone.vision_backbone.{neck}.{k}", (width, *(width // share for share in shares))
            for j, (a, b) in enumerate(pairwise(widths)):
                yield from up(f"{name}.dconv_2x2{f'_{j}' if len(shares) > 1 else ''}", a, b)
            yield from layer(f"{name}.conv_1x1", out, widths[-1], 1, 1)
            yield from layer(f"{name}.conv_3x3", out, out, 3, 3)


def words(c: Sam3Config) -> Shapes:
    at, t, width = "backbone.language_backbone.encoder", c.text_config, c.text_config.hidden_size
    yield from ((f"{at}.positional_embedding", (t.max_position_embeddings, width)),
                (f"{at}.text_projection", (width, t.projection_dim)), (f"{at}.token_embedding.weight", (t.vocab_size, width)))
    for i in range(t.num_hidden_layers):
        block = f"{at}.transformer.resblocks.{i}"
        yield from together(f"{block}.attn", width)
        for name, shape in {"ln_1": (width,), "ln_2": (width,), "mlp.c_fc": (t.intermediate_size, width),
                            "mlp.c_proj": (width, t.intermediate_size)}.items():
            yield from layer(f"{block}.{name}", *shape)
    yield from layer(f"{at}.ln_final", width)
    yield from layer("backbone.language_backbone.resizer", c.detr_encoder_config.hidden_size, width)


def prompts(c: Sam3Config) -> Shapes:
    at, g, w = "geometry_encoder", c.geometry_encoder_config, c.geometry_encoder_config.hidden_size
    yield from ((f"{at}.label_embed.weight", (2, w)), (f"{at}.cls_embed.weight", (1, w)))
    for name, shape in {"points_direct_project": (w, 2), "points_pool_project": (w, w), "points_pos_enc_project": (w, w),
                        "boxes_direct_project": (w, 4), "boxes_pool_project": (w, w, g.roi_size, g.roi_size),
                        "boxes_pos_enc_project": (w, w + 2), "final_proj": (w, w), "norm": (w,), "img_pre_norm": (w,),
                        "encode_norm": (w,)}.items():  # fmt: skip
        yield from layer(f"{at}.{name}", *shape)
    for i in range(g.num_layers):
        yield from block(f"{at}.encode.{i}", ("self_attn", "cross_attn_image"), ("norm1", "norm2", "norm3"), w, g.intermediate_size)


def detection(c: Sam3Config) -> Shapes:
    at, e, d, w = "transformer.decoder", c.detr_encoder_config, c.detr_decoder_config, c.detr_decoder_config.hidden_size
    for i in range(e.num_layers):
        yield from block(f"transformer.encoder.layers.{i}", ("self_attn", "cross_attn_image"), ("norm1", "norm2", "norm3"), w,
                         e.intermediate_size)
    for i in range(d.num_layers):
        yield from block(f"{at}.layers.{i}", ("self_attn", "ca_text", "cross_attn"), ("norm1", "catext_norm", "norm2", "norm3"), w,
                         d.intermediate_size)
    yield from ((f"{at}.query_embed.weight", (d.num_queries, w)), (f"{at}.reference_points.weight", (d.num_queries, 4)),
                (f"{at}.presence_token.weight", (1, w)))
    for name, widths in {"bbox_embed": (w, w, w, 4), "presence_token_head": (w, w, w, 1), "ref_point_head": (2 * w, w, w),
                         "boxRPB_embed_x": (2, w, d.num_attention_heads), "boxRPB_embed_y": (2, w, d.num_attention_heads)}.items():
        yield from perceptron(f"{at}.{name}", *widths)
    for name in ("norm", "presence_token_out_norm"):
        yield from layer(f"{at}.{name}", w)


def masks(c: Sam3Config) -> Shapes:
    at, m, w = "segmentation_head", c.mask_decoder_config, c.mask_decoder_config.hidden_size
    for i in range(m.num_upsampling_stages):
        yield from layer(f"{at}.pixel_decoder.conv_layers.{i}", w, w, 3, 3)
        yield from layer(f"{at}.pixel_decoder.norms.{i}", w)
    yield from perceptron(f"{at}.mask_predictor.mask_embed", w, w, w, w)
    yield from together(f"{at}.cross_attend_prompt", w)
    for name, shape in {"cross_attn_norm": (w,), "semantic_seg_head": (1, w, 1, 1), "instance_seg_head": (w, w, 1, 1)}.items():
        yield from layer(f"{at}.{name}", *shape)
    inner = c.detr_decoder_config.intermediate_size
    yield from perceptron("dot_prod_scoring.prompt_mlp", w, inner, w)
    for name, shape in {"prompt_mlp.out_norm": (w,), "prompt_proj": (w, w), "hs_proj": (w, w)}.items():
        yield from layer(f"dot_prod_scoring.{name}", *shape)


def published(c: Sam3Config) -> dict[str, tuple[int, ...]]:
    """Names, without `detector.`, and shapes of sam3.pt for an architecture."""
    return {name: shape for part in (vision, words, prompts, detection, masks) for name, shape in part(c)}


def test_names_of_the_published_size() -> None:
    """Every tensor of the detector has one of the published file, of its shape; 840 million parameters."""
    with torch.device("meta"):
        model = Sam3Model(Sam3Config())
        given = {name: torch.empty(shape) for name, shape in published(model.config).items()}
    found = {name: tuple(tensor.shape) for name, tensor in our_state_dict(given).items()}
    assert found == {name: tuple(tensor.shape) for name, tensor in model.state_dict().items()}
    assert sum(parameter.numel() for parameter in model.parameters()) == 840_376_374


@pytest.fixture
def checkpoint(tmp_path: Path) -> tuple[Path, dict[str, Tensor]]:
    """A folder with a tiny sam3.pt, its config and tokenizer; the tensors of its detector."""
    folder = save_sam3(tmp_path / "given")
    (folder / "model.safetensors").unlink()
    drawn = torch.Generator().manual_seed(0)
    shapes = published(Sam3Config.from_pretrained(folder))
    tensors = {name: torch.randn(shape, generator=drawn) for name, shape in shapes.items()}
    torch.save({f"detector.{name}": tensor for name, tensor in tensors.items()} | {"tracker.x": torch.ones(2)}, folder / "sam3.pt")
    return folder, tensors


def test_layout_of_the_imported_tensors(checkpoint: tuple[Path, dict[str, Tensor]], tmp_path: Path) -> None:
    """Queries, keys and values are apart, positions lack the class token, the projection of texts is transposed."""
    folder, given = checkpoint
    assert bring("sam3", [folder], tmp_path / "out", "float32", False) == 0
    found = load_file(next((tmp_path / "out").glob("*.safetensors")))
    for name, ours in (("transformer.decoder.layers.0.ca_text", "detr_decoder.layers.0.text_cross_attn"),
                       ("backbone.language_backbone.encoder.transformer.resblocks.1.attn",
                        "text_encoder.text_model.encoder.layers.1.self_attn")):
        assert torch.equal(torch.cat([found[f"{ours}.{part}_proj.bias"] for part in "qkv"]), given[f"{name}.in_proj_bias"])
    qkv = torch.cat([found[f"vision_encoder.backbone.layers.0.attention.{part}_proj.weight"] for part in "qkv"])
    assert torch.equal(qkv, given["backbone.vision_backbone.trunk.blocks.0.attn.qkv.weight"])
    positions = found["vision_encoder.backbone.embeddings.position_embeddings"]
    assert torch.equal(positions, given["backbone.vision_backbone.trunk.pos_embed"][:, 1:])
    projection = found["text_encoder.text_projection.weight"]
    assert torch.equal(projection, given["backbone.language_backbone.encoder.text_projection"].T)
    norms = {"vision_cross_attn": "norm1", "text_cross_attn": "catext_norm", "self_attn": "norm2", "mlp": "norm3"}
    for ours, name in norms.items():
        norm = found[f"detr_decoder.layers.0.{ours}_layer_norm.weight"]
        assert torch.equal(norm, given[f"transformer.decoder.layers.0.{name}.weight"])


def test_checkpoint_without_a_tokenizer_is_refused(checkpoint: tuple[Path, dict[str, Tensor]], tmp_path: Path,
                                                   capfd: pytest.CaptureFixture[str]) -> None:  # fmt: skip
    """One sentence that says what to add."""
    folder, _ = checkpoint
    (folder / "tokenizer.json").unlink()
    assert bring("sam3", [folder], tmp_path / "out", "float32", False) == 1
    assert "the tokenizer.json of SAM 3 or CLIP" in " ".join(capfd.readouterr().err.split())
