"""SAM 2 for video (Ravi et al. 2024), through `transformers.Sam2VideoModel`: mask prompts in, masks on every frame out.

The class's own processors need a package that does not work beside the pinned torch, so frames are resized and normalised
here, with the mean and deviation of the published preprocessing (ImageNet).
"""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
import torch
from torch.nn.functional import interpolate
from transformers import Sam2VideoModel
from transformers.models.sam2_video.modeling_sam2_video import Sam2VideoInferenceSession

MEAN = (0.485, 0.456, 0.406)
DEVIATION = (0.229, 0.224, 0.225)


def load_model(name: str) -> Sam2VideoModel:
    """A model from a local folder or a hub id, ready for inference on the best device here.

    ValueError when the name is empty or nothing can be loaded from it; the message says what was tried.
    """
    if not name:
        raise ValueError("backend 'sam2' needs a model: set `model` to a local folder or a hub id of a Sam2VideoModel")
    try:
        model = Sam2VideoModel.from_pretrained(name)
    except OSError as error:
        raise ValueError(f"model {name!r}: expected a Sam2VideoModel folder or hub id; {str(error).splitlines()[0]}") from error
    device = "cuda" if torch.cuda.is_available() else "cpu"
    return model.to(device).eval()


@torch.inference_mode()
def track(model: Sam2VideoModel, rgb: np.ndarray, prompts: Mapping[int, np.ndarray]) -> np.ndarray:
    """Follow n objects through a video.

    rgb: (t, h, w, 3) uint8. prompts: frame position -> (n, h, w) bool masks of all n objects (an empty mask says that the
    object is out of sight). Returns (n, t, h, w) float32 mask logits; positive inside. The prompted frames are the memory:
    the video is followed forwards from the first of them, then backwards.
    """
    size = int(model.config.image_size)
    video = _preprocess(rgb, size)
    count = next(iter(prompts.values())).shape[0]
    height, width = rgb.shape[1:3]
    session = Sam2VideoInferenceSession(
        video=video, video_height=height, video_width=width, inference_device=model.device,
        inference_state_device=model.device, dtype=model.dtype,
    )  # fmt: skip
    for position, masks in sorted(prompts.items()):
        _prompt(model, session, position, masks, size)
    logits = np.full((count, len(rgb), height, width), -10.0, np.float32)
    first = min(prompts)
    for reverse in (False, True):
        for out in model.propagate_in_video_iterator(session, start_frame_idx=first, reverse=reverse):
            logits[:, out.frame_idx] = _full_size(out.pred_masks, height, width)
    return logits


def _preprocess(rgb: np.ndarray, size: int) -> torch.Tensor:
    """(t, 3, size, size) float32, ImageNet-normalised; the aspect ratio is not kept, as published."""
    video = torch.from_numpy(np.ascontiguousarray(rgb)).permute(0, 3, 1, 2).float() / 255
    video = interpolate(video, (size, size), mode="bilinear", align_corners=False, antialias=True)
    mean, deviation = torch.tensor(MEAN).view(1, 3, 1, 1), torch.tensor(DEVIATION).view(1, 3, 1, 1)
    return (video - mean) / deviation


def _prompt(model: Sam2VideoModel, session: Sam2VideoInferenceSession, position: int, masks: np.ndarray, size: int) -> None:
    """Tell the session the masks of all objects in one frame, and let it remember them."""
    scaled = interpolate(torch.from_numpy(masks).float()[:, None], (size, size), mode="bilinear", antialias=True)
    for entity in range(len(masks)):
        index = session.obj_id_to_idx(entity)
        session.add_mask_inputs(index, position, (scaled[entity : entity + 1] >= 0.5).float())
        session.remove_point_inputs(index, position)
    session.obj_with_new_inputs = list(range(len(masks)))
    model(session, frame_idx=position)


def _full_size(masks: torch.Tensor, height: int, width: int) -> np.ndarray:
    """(n, 1, h', w') logits -> (n, h, w) float32."""
    resized = interpolate(masks.float(), (height, width), mode="bilinear", align_corners=False)
    return resized[:, 0].cpu().numpy()
