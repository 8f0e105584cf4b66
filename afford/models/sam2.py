"""SAM 2 and 2.1 for video (Ravi et al. 2024), through `transformers.Sam2VideoModel`: mask prompts in, masks of every frame out.

Published checkpoints (`sam2*_hiera_*.pt`) are loaded tensor by tensor, by their names in `transformers`. The class's own processor
needs a package that does not work beside the pinned torch, so frames are resized and normalised here, on request. Memory is
bounded: frames that the model no longer attends to are cleared, and features are kept for a fixed number of frames.
"""

from __future__ import annotations

import re
from collections.abc import Iterable, Iterator, Mapping
from pathlib import Path
from typing import Any

import numpy as np
import torch
from torch import Tensor
from torch.nn.functional import interpolate
from transformers import Sam2HieraDetConfig, Sam2VideoConfig, Sam2VideoModel, Sam2VisionConfig
from transformers.models.sam2_video.modeling_sam2_video import Sam2VideoInferenceSession

from afford.models import tensor_files
from afford.models.frame_masks import FrameMasks, full_size
from afford.models.loading import fill_weights, load_cached, read_pretrained

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
"""prefix of the names in a published file"""
POINTS = 4
"""kinds of point prompts; a tensor for each in the published file, rows of one tensor in `transformers`"""
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
    """Name in `transformers` of a published tensor."""
    for pattern, replacement in RENAMED:
        name = re.sub(pattern, replacement, name)
    found = DOWNSAMPLER.match(name)
    if found:  # repeated: a convolution, its norm, and an activation without weights
        layer, part = divmod(int(found[2]), 3)
        name = f"{found[1]}.layers.{layer}.{('conv', 'layer_norm', 'activation')[part]}.{found[3]}"
    return name


def our_state_dict(published: Mapping[str, Tensor]) -> dict[str, Tensor]:
    """Rename a published state dict: rows of points are stacked, frequencies of positions copied."""
    out = {our_name(name): tensor for name, tensor in published.items()}
    rows = [out.pop(f"prompt_encoder.point_embeddings.{i}.weight", None) for i in range(POINTS)]
    there = [row for row in rows if row is not None]
    if there:
        out["prompt_encoder.point_embed.weight"] = torch.cat(there)
    if FREQUENCIES in out:
        out[COPY] = out[FREQUENCIES]
    return out


def published_config(size: str, *, version: str = "2.1") -> Sam2VideoConfig:
    """Architecture of a published size; version 2.0 lacks temporal positions of pointers and the occlusion embedding."""
    hiera = SIZES[size]
    widths = [hiera["hidden_size"] * 2**stage for stage in range(4)]
    vision = Sam2VisionConfig(backbone_config=Sam2HieraDetConfig(embed_dim_per_stage=widths, **hiera),
                              backbone_channel_list=widths[::-1])  # fmt: skip
    later = version != "2.0"
    return Sam2VideoConfig(vision_config=vision, enable_temporal_pos_encoding_for_object_pointers=later,
                           enable_occlusion_spatial_embedding=later)  # fmt: skip


def published_size(published: Mapping[str, Tensor], where: str) -> str:
    """Published size of a state dict, by the width and number of its blocks. ValueError for another architecture."""
    first = published.get("image_encoder.trunk.patch_embed.proj.weight")
    numbers = {int(found[1]) for name in published if (found := re.match(r"image_encoder\.trunk\.blocks\.(\d+)\.", name))}
    got = (0 if first is None else len(first), len(numbers))
    known = {(hiera["hidden_size"], sum(hiera["blocks_per_stage"])): size for size, hiera in SIZES.items()}
    if got not in known:
        raise ValueError(f"{where}: expected a checkpoint of SAM 2 (hiera {', '.join(SIZES)}), got {got[1]} blocks of width "
                         f"{got[0]}; give sam2.1_hiera_*.pt as it is published, or a folder of a Sam2VideoModel")
    return known[got]


def read_published(path: Path) -> Sam2VideoModel:
    """Load a published checkpoint. ValueError names tensors that are missing, extra or misshaped."""
    published = published_tensors(path)
    version = "2.1" if "no_obj_embed_spatial" in published else "2.0"
    config = published_config(published_size(published, str(path)), version=version)
    return fill_published(Sam2VideoModel(config), published, str(path))


def fill_published(model: Sam2VideoModel, published: Mapping[str, Tensor], where: str) -> Sam2VideoModel:
    """Fill a model with published weights. ValueError when a tensor does not fit."""
    fill_weights(model, our_state_dict(published), where, "give a published SAM 2 or 2.1")
    return model


def published_tensors(path: Path) -> dict[str, Tensor]:
    """Read the tensors of a published file, {"model": {name: tensor}}. ValueError for another structure."""
    found = tensor_files.read_tensors(path)
    if foreign := [name for name in found if not name.startswith(TOP)]:
        raise ValueError(f'{path}: expected {{"model": {{name: tensor}}}} as SAM 2 is published, got {", ".join(foreign[:4])}')
    return {name.removeprefix(TOP): tensor for name, tensor in found.items()}


MEAN = (0.485, 0.456, 0.406)
DEVIATION = (0.229, 0.224, 0.225)


def load_model(name: str, device: str = "cpu", dtype: str = "float32") -> Sam2VideoModel:
    """Load a model for inference from a folder of `save_pretrained` or a published file `sam2*_hiera_*.pt`.

    ValueError, one sentence: no such file, another model, or tensors that are missing, extra or misshaped.
    """
    model: Sam2VideoModel = load_cached(_read_any, Sam2VideoModel, name, "sam2", device, dtype)
    return model


def _read_any(kind: Any, where: Path) -> Any:
    return read_published(where) if where.is_file() else read_pretrained(kind, where)


def track(model: Sam2VideoModel, rgb: np.ndarray, prompts: Mapping[int, np.ndarray]) -> np.ndarray:
    """Track n objects through a short video, forwards from the first prompt and then backwards.

    rgb: (t, h, w, 3) uint8. prompts: frame position -> (n, h, w) bool masks of all n objects (an empty mask for an
    object out of sight). Returns (n, t, h, w) float32 mask logits; positive inside.
    """
    first, size = min(prompts), rgb.shape[1:3]
    count = next(iter(prompts.values())).shape[0]
    logits = np.full((count, len(rgb), *size), -10.0, np.float32)
    for order in (range(first, len(rgb)), range(first, -1, -1) if first else range(0)):
        for seen in track_frames(model, rgb, prompts, order):
            logits[:, seen.at] = full_size(seen.logits, size)
    return logits


@torch.inference_mode()
def session(model: Sam2VideoModel, rgb: np.ndarray, prompts: Mapping[int, np.ndarray], cache: int = 1) -> Sam2VideoInferenceSession:
    """Start an inference session of a video with its prompts in memory. `cache`: number of frames whose features are kept."""
    size = int(model.config.image_size)
    made = Sam2VideoInferenceSession(
        video_height=rgb.shape[1], video_width=rgb.shape[2], inference_device=model.device, inference_state_device=model.device,
        dtype=model.dtype, max_vision_features_cache_size=cache,
    )  # fmt: skip
    made.processed_frames = _Frames(rgb, size, model.device, model.dtype)
    for position, masks in sorted(prompts.items()):
        _prompt(model, made, position, masks, size)
    return made


def track_frames(model: Sam2VideoModel, rgb: np.ndarray, prompts: Mapping[int, np.ndarray], order: Iterable[int], *,
           within: Sam2VideoInferenceSession | None = None) -> Iterator[FrameMasks]:  # fmt: skip
    """Propagate the prompts through the frames of `order`, ascending or descending; yields the masks of each frame.

    `within` is a `session` of the same video and prompts; its memory of other frames is cleared.
    """
    made = within or session(model, rgb, prompts)
    positions = list(order)
    reverse = len(positions) > 1 and positions[1] < positions[0]
    far = max(int(model.config.num_maskmem), int(model.config.max_object_pointers_in_encoder))
    _forget(made, set())
    for position in positions:
        with torch.inference_mode():
            out = model(made, frame_idx=position, reverse=reverse)
        _forget(made, set(range(position - far, position + far + 1)))
        yield FrameMasks(position, out.pred_masks[:, 0].float().cpu())


def _forget(made: Sam2VideoInferenceSession, keep: set[int]) -> None:
    """Clear the memory of other frames than `keep`; prompts are kept."""
    for outputs in made.output_dict_per_obj.values():
        found = outputs["non_cond_frame_outputs"]
        for position in [at for at in found if at not in keep]:
            del found[position]


def _prompt(model: Sam2VideoModel, made: Sam2VideoInferenceSession, position: int, masks: np.ndarray, size: int) -> None:
    """Add the masks of all objects in one frame to the memory of the session."""
    scaled = interpolate(torch.from_numpy(np.array(masks)).float()[:, None], (size, size), mode="bilinear", antialias=True)
    for entity in range(len(masks)):
        index = made.obj_id_to_idx(entity)
        made.add_mask_inputs(index, position, (scaled[entity : entity + 1] >= 0.5).float())
        made.remove_point_inputs(index, position)
    made.obj_with_new_inputs = list(range(len(masks)))
    model(made, frame_idx=position)


class _Frames(dict[int, torch.Tensor]):
    """Frames of a video as model inputs, computed on request."""

    def __init__(self, rgb: np.ndarray, size: int, device: torch.device, dtype: torch.dtype) -> None:
        super().__init__()
        self._rgb, self._size, self._device, self._dtype = rgb, size, device, dtype
        self._mean, self._deviation = (torch.tensor(three, device=device).view(3, 1, 1) for three in (MEAN, DEVIATION))

    def __len__(self) -> int:
        return len(self._rgb)

    def __getitem__(self, at: int) -> torch.Tensor:
        """Frame (3, size, size), normalised by ImageNet's mean and deviation; the aspect ratio is not kept, as published."""
        image = torch.from_numpy(np.array(self._rgb[at])).to(self._device).permute(2, 0, 1)[None].float() / 255
        image = interpolate(image, (self._size, self._size), mode="bilinear", align_corners=False, antialias=True)[0]
        return ((image - self._mean) / self._deviation).to(self._dtype)
