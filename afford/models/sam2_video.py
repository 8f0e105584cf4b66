"""SAM 2 for video (Ravi et al. 2024), through `transformers.Sam2VideoModel`: mask prompts in, masks on every frame out.

The class's own processors need a package that does not work beside the pinned torch, so frames are resized and normalised
here, with the mean and deviation of the published preprocessing (ImageNet), each when it is its turn. Memory is bounded: what the
model can no longer recall is forgotten, and image features are kept for as many frames as asked.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import torch
from torch.nn.functional import interpolate
from transformers import Sam2VideoModel
from transformers.models.sam2_video.modeling_sam2_video import Sam2VideoInferenceSession

from afford.models import sam2_names
from afford.models.pretrained import kept, read

MEAN = (0.485, 0.456, 0.406)
DEVIATION = (0.229, 0.224, 0.225)


class Seen(NamedTuple):
    """What the model finds in one frame."""

    at: int
    logits: torch.Tensor
    """(n, h', w') float32 on the CPU, of n objects at the model's own size; positive inside"""


def load_model(name: str, device: str = "cpu", dtype: str = "float32") -> Sam2VideoModel:
    """A model from a folder that `save_pretrained` wrote or from a published file `sam2*_hiera_*.pt`, for inference.

    ValueError in one sentence: nothing there, another model, a tensor that is missing, left over or misshapen.
    """
    model: Sam2VideoModel = kept(_read_any, Sam2VideoModel, name, "sam2", device, dtype)
    return model


def _read_any(kind: Any, where: Path) -> Any:
    return sam2_names.read(where) if where.is_file() else read(kind, where)


def track(model: Sam2VideoModel, rgb: np.ndarray, prompts: Mapping[int, np.ndarray]) -> np.ndarray:
    """Follow n objects through a short video, forwards from the first prompt and then backwards.

    rgb: (t, h, w, 3) uint8. prompts: frame position -> (n, h, w) bool masks of all n objects (an empty mask says that the
    object is out of sight). Returns (n, t, h, w) float32 mask logits; positive inside.
    """
    first, size = min(prompts), rgb.shape[1:3]
    count = next(iter(prompts.values())).shape[0]
    logits = np.full((count, len(rgb), *size), -10.0, np.float32)
    for order in (range(first, len(rgb)), range(first, -1, -1) if first else range(0)):
        for seen in follow(model, rgb, prompts, order):
            logits[:, seen.at] = full_size(seen.logits, size)
    return logits


@torch.inference_mode()
def session(model: Sam2VideoModel, rgb: np.ndarray, prompts: Mapping[int, np.ndarray], cache: int = 1) -> Sam2VideoInferenceSession:
    """A video whose prompts the model has remembered. `cache`: frames whose image features are kept."""
    size = int(model.config.image_size)
    made = Sam2VideoInferenceSession(
        video_height=rgb.shape[1], video_width=rgb.shape[2], inference_device=model.device, inference_state_device=model.device,
        dtype=model.dtype, max_vision_features_cache_size=cache,
    )  # fmt: skip
    made.processed_frames = _Frames(rgb, size, model.device, model.dtype)
    for position, masks in sorted(prompts.items()):
        _prompt(model, made, position, masks, size)
    return made


def follow(model: Sam2VideoModel, rgb: np.ndarray, prompts: Mapping[int, np.ndarray], order: Iterable[int], *,
           within: Sam2VideoInferenceSession | None = None) -> Iterator[Seen]:  # fmt: skip
    """The frames of `order`, ascending or descending, one after the other, each with the memory of those before it and of all
    prompts. `within` is a `session` of the same video and prompts, which forgets all but the prompts.
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
        yield Seen(position, out.pred_masks[:, 0].float().cpu())


def full_size(logits: torch.Tensor, size: tuple[int, ...]) -> np.ndarray:
    """(n, h', w') logits -> (n, h, w) float32."""
    return interpolate(logits[:, None], size, mode="bilinear", align_corners=False)[:, 0].numpy()


def _forget(made: Sam2VideoInferenceSession, keep: set[int]) -> None:
    """Drop what was found in other frames than `keep`; prompts stay."""
    for outputs in made.output_dict_per_obj.values():
        found = outputs["non_cond_frame_outputs"]
        for position in [at for at in found if at not in keep]:
            del found[position]


def _prompt(model: Sam2VideoModel, made: Sam2VideoInferenceSession, position: int, masks: np.ndarray, size: int) -> None:
    """Tell the session the masks of all objects in one frame, and let it remember them."""
    scaled = interpolate(torch.from_numpy(np.array(masks)).float()[:, None], (size, size), mode="bilinear", antialias=True)
    for entity in range(len(masks)):
        index = made.obj_id_to_idx(entity)
        made.add_mask_inputs(index, position, (scaled[entity : entity + 1] >= 0.5).float())
        made.remove_point_inputs(index, position)
    made.obj_with_new_inputs = list(range(len(masks)))
    model(made, frame_idx=position)


class _Frames(dict[int, torch.Tensor]):
    """The frames of a video as the model wants them, each made when it is asked for."""

    def __init__(self, rgb: np.ndarray, size: int, device: torch.device, dtype: torch.dtype) -> None:
        super().__init__()
        self._rgb, self._size, self._device, self._dtype = rgb, size, device, dtype
        self._mean, self._deviation = (torch.tensor(three, device=device).view(3, 1, 1) for three in (MEAN, DEVIATION))

    def __len__(self) -> int:
        return len(self._rgb)

    def __getitem__(self, at: int) -> torch.Tensor:
        """(3, size, size), ImageNet-normalised; the aspect ratio is not kept, as published."""
        image = torch.from_numpy(np.array(self._rgb[at])).to(self._device).permute(2, 0, 1)[None].float() / 255
        image = interpolate(image, (self._size, self._size), mode="bilinear", align_corners=False, antialias=True)[0]
        return ((image - self._mean) / self._deviation).to(self._dtype)
