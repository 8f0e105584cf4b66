"""Video inpainting diffusion (VIDM, Chang et al. 2023, "Look Ma, No Hands!"): one frame from four, seconds apart.

A U-Net sees the noisy target, four frames with their holes blanked and the four masks (3 + 4 x 3 + 4 channels at 256 x 256) and
is sampled by DDIM. Loaded as a `diffusers` folder: `unet/` (UNet2DModel) and `scheduler/` (DDIMScheduler).
"""

from __future__ import annotations

from pathlib import Path
from typing import NamedTuple

import numpy as np
import torch
from diffusers import DDIMScheduler, UNet2DModel

FRAMES = 4
CHANNELS = 3 + FRAMES * 3 + FRAMES


class Diffusion(NamedTuple):
    """A loaded model."""

    unet: UNet2DModel
    scheduler: DDIMScheduler


def load_model(name: str) -> Diffusion:
    """A model from a local folder or hub id; ValueError says what was expected when it is missing or of another shape."""
    if not name:
        raise ValueError("backend 'vidm' needs a model: set `model` to a folder with unet/ and scheduler/, or a hub id")
    try:
        unet = UNet2DModel.from_pretrained(name, subfolder="unet")
        scheduler = DDIMScheduler.from_pretrained(name, subfolder="scheduler")
    except OSError as error:
        raise ValueError(f"model {name!r}: expected unet/ and scheduler/; {str(error).splitlines()[0]}") from error
    if unet.config.in_channels != CHANNELS or unet.config.out_channels != 3:
        got = f"{unet.config.in_channels} in, {unet.config.out_channels} out"
        raise ValueError(f"model {Path(name).name!r}: expected {CHANNELS} channels in and 3 out, got {got}")
    return Diffusion(unet.to("cuda" if torch.cuda.is_available() else "cpu").eval(), scheduler)


@torch.inference_mode()
def fill(model: Diffusion, rgb: np.ndarray, holes: np.ndarray, *, steps: int, eta: float, seed: int) -> np.ndarray:
    """The last of four frames without its hole.

    rgb: (4, s, s, 3) uint8, the target last; holes: (4, s, s) bool. Returns (s, s, 3) uint8; pixels outside the target's hole
    are the network's own and are thrown away by the stage. The noise comes from `seed` alone.
    """
    device = model.unet.device
    frames = torch.from_numpy(rgb).permute(0, 3, 1, 2).float() / 127.5 - 1
    masks = torch.from_numpy(holes)[:, None].float()
    condition = torch.cat([(frames * (1 - masks)).flatten(0, 1), masks.flatten(0, 1)])[None].to(device)
    noise = torch.Generator().manual_seed(seed)
    image = torch.randn((1, 3, *rgb.shape[1:3]), generator=noise).to(device)
    model.scheduler.set_timesteps(steps)
    for step in model.scheduler.timesteps:
        guess = model.unet(torch.cat([image, condition], dim=1), step).sample
        image = model.scheduler.step(guess, step, image, eta=eta, generator=noise).prev_sample
    return ((image[0].clamp(-1, 1) + 1) * 127.5).round().byte().permute(1, 2, 0).cpu().numpy()
