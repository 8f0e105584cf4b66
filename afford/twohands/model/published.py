"""Load the weights of released 2HAff and LISA checkpoints into a `vlm` model.

The files are safetensors or PyTorch files, whole or in shards with an index; of the latter, only tensors are read. Tensors that the
released format leaves out keep their values and are reported: low-rank updates (merged before release), the image tower (always
CLIP's own) and, for LISA, which has one decoder and no taxonomy, the taxonomy head. All other tensors must fit.
"""

from __future__ import annotations

import json
import re
from pathlib import Path

import torch
from torch import Tensor

from afford.common.bounded import reason
from afford.models.loading import fill_weights
from afford.models.tensor_files import load_weights_only
from afford.twohands.model.interface import TwoHands
from schemas.video import SIDES

INDEXES = ("model.safetensors.index.json", "pytorch_model.bin.index.json")
WHOLE = ("model.safetensors", "pytorch_model.bin")
IGNORED = re.compile(r"rotary_emb\.inv_freq$|position_ids$|pixel_(mean|std)$")
"""computed buffers that older versions saved"""
MAY_STAY = re.compile(r"\.lora_[AB]\.|^vlm\.model\.vision_tower\.|^regions\.taxonomy\.")
"""tensors of the model that a released checkpoint may lack"""
GROWS = ("vlm.model.language_model.embed_tokens.weight", "vlm.lm_head.weight")
"""released vocabularies have no row for <image>, which is not used; the model has this row last"""

RENAMED = (
    (r"^base_model\.model\.", ""),
    (r"^lm_head\.", "vlm.lm_head."),
    (r"^model\.text_hidden_fcs\.0\.", "project."),
    (r"^model\.mm_projector\.0\.", "vlm.model.multi_modal_projector.linear_1."),
    (r"^model\.mm_projector\.2\.", "vlm.model.multi_modal_projector.linear_2."),
    (r"^model\.vision_tower\.vision_tower\.vision_model\.", "vlm.model.vision_tower."),
    (r"^model\.(?=(layers|embed_tokens|norm)\.)", "vlm.model.language_model."),
    (r"\.(q_proj|v_proj)\.weight$", r".\1.base_layer.weight"),
    (r"^model\.visual_model\.", "sam."),
    # image encoder
    (r"^sam\.image_encoder\.patch_embed\.proj\.", "regions.image_encoder.patch_embed.projection."),
    (r"^sam\.image_encoder\.blocks\.", "regions.image_encoder.layers."),
    (r"^sam\.image_encoder\.neck\.0\.", "regions.image_encoder.neck.conv1."),
    (r"^sam\.image_encoder\.neck\.1\.", "regions.image_encoder.neck.layer_norm1."),
    (r"^sam\.image_encoder\.neck\.2\.", "regions.image_encoder.neck.conv2."),
    (r"^sam\.image_encoder\.neck\.3\.", "regions.image_encoder.neck.layer_norm2."),
    (r"^sam\.image_encoder\.", "regions.image_encoder."),
    # prompt encoder
    (r"^sam\.prompt_encoder\.pe_layer\.positional_encoding_gaussian_matrix$",
     "regions.prompt_encoder.shared_embedding.positional_embedding"),
    (r"^sam\.prompt_encoder\.point_embeddings\.", "regions.prompt_encoder.point_embed."),
    (r"^sam\.prompt_encoder\.mask_downscaling\.0\.", "regions.prompt_encoder.mask_embed.conv1."),
    (r"^sam\.prompt_encoder\.mask_downscaling\.1\.", "regions.prompt_encoder.mask_embed.layer_norm1."),
    (r"^sam\.prompt_encoder\.mask_downscaling\.3\.", "regions.prompt_encoder.mask_embed.conv2."),
    (r"^sam\.prompt_encoder\.mask_downscaling\.4\.", "regions.prompt_encoder.mask_embed.layer_norm2."),
    (r"^sam\.prompt_encoder\.mask_downscaling\.6\.", "regions.prompt_encoder.mask_embed.conv3."),
    (r"^sam\.prompt_encoder\.", "regions.prompt_encoder."),
    # decoders; the name of the taxonomy head is not documented, so any name with taxonomy or class is accepted
    (r"^sam\.mask_decoder_left\.\w*(taxonomy|class)\w*\.", "regions.taxonomy."),
    (r"^sam\.mask_decoder_left\.", "regions.decoders.0."),
    (r"^sam\.mask_decoder_right\.", "regions.decoders.1."),
    (r"(^regions\.taxonomy|_mlps\.\d|_head)\.layers\.0\.(?=weight|bias)", r"\1.proj_in."),
    (r"(^regions\.taxonomy|_mlps\.\d|_head)\.layers\.1\.(?=weight|bias)", r"\1.layers.0."),
    (r"(^regions\.taxonomy|_mlps\.\d|_head)\.layers\.2\.(?=weight|bias)", r"\1.proj_out."),
    (r"\.norm(\d)\.", r".layer_norm\1."),
    (r"\.norm_final_attn\.", ".layer_norm_final_attn."),
    (r"\.output_upscaling\.0\.", ".upscale_conv1."),
    (r"\.output_upscaling\.1\.", ".upscale_layer_norm."),
    (r"\.output_upscaling\.3\.", ".upscale_conv2."),
)  # fmt: skip
"""(pattern, replacement), applied one after the other"""


def load_published(model: TwoHands, path: Path) -> list[str]:
    """Fill a `vlm` model from a released checkpoint; returns the names of the model's tensors that the checkpoint lacks, in order.

    ValueError names tensors that are missing, extra or of another shape.
    """
    if model.config.variant != "vlm":
        raise ValueError(f"released checkpoints fit the variant vlm, got {model.config.variant}")
    given = {ours: tensor for name, tensor in read_weights(path).items() for ours in our_names(name, model.config.decoders)}
    own = model.state_dict()
    for name in GROWS:
        if name in given and len(given[name]) == len(own[name]) - 1:
            given[name] = torch.cat([given[name], own[name][-1:].to(given[name])])
    stay = [name for name in own if name not in given and MAY_STAY.search(name)]
    fill_weights(model, given | {name: own[name] for name in stay}, str(path), "give the published weights of this size")
    return stay


def our_names(name: str, decoders: int = 2) -> list[str]:
    """Names of a released tensor in the model: none for a computed buffer, both decoders for the single one of LISA."""
    if IGNORED.search(name):
        return []
    if ".mask_decoder." in name:
        sides = SIDES[:decoders]
        return [one for side in sides for one in our_names(name.replace(".mask_decoder.", f".mask_decoder_{side}."), decoders)]
    elsewhere = "vision_tower" in name or "visual_model" in name
    for pattern, replacement in RENAMED:
        if not (elsewhere and "base_layer" in replacement):
            name = re.sub(pattern, replacement, name)
    return [name]


def read_weights(path: Path) -> dict[str, Tensor]:
    """Read tensors by name from a file, or from a folder with one file or with shards. ValueError without a file."""
    if path.is_file():
        return _read_file(path)
    for name in INDEXES:
        if (path / name).is_file():
            return {key: tensor for shard in _shards(path / name) for key, tensor in _read_file(shard).items()}
    for name in WHOLE:
        if (path / name).is_file():
            return _read_file(path / name)
    raise ValueError(f"{path}: expected one of {', '.join(INDEXES + WHOLE)}")


def _shards(index: Path) -> list[Path]:
    try:
        names = set(json.loads(index.read_text(encoding="utf-8"))["weight_map"].values())
    except (OSError, ValueError, KeyError, AttributeError, TypeError, RecursionError) as error:
        raise ValueError(f"{index}: expected {{\"weight_map\": {{tensor: file}}}}; {reason(error)}") from error
    outside = sorted(str(name) for name in names if Path(str(name)).name != name)
    if outside:
        raise ValueError(f"{index}: expected names of files beside it, got {', '.join(outside)}")
    return [index.parent / name for name in sorted(names)]


def _read_file(path: Path) -> dict[str, Tensor]:
    found = load_weights_only(path, "a file of tensors")
    if not all(isinstance(tensor, Tensor) for tensor in found.values()):
        raise ValueError(f"{path}: expected a flat mapping of names to tensors")
    return found
