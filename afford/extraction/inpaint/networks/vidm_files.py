"""VIDM on disk: the published checkpoint, or a folder of ours (config.json, model.safetensors)."""

from __future__ import annotations

import re
from collections.abc import Iterable, Mapping
from pathlib import Path

import torch
from safetensors.torch import save_file
from torch import Tensor

from afford.extraction.inpaint.networks.vidm_config import VidmConfig, config_text, read_config
from afford.extraction.inpaint.networks.vidm_model import Vidm
from afford.models.archive import read_tensors
from afford.models.loading import fill_weights

CONFIG, WEIGHTS = "config.json", "model.safetensors"
PUBLISHED = VidmConfig()
NEEDED = "the published checkpoint (nohands_weights.ckpt, also as .safetensors) or a folder with config.json and model.safetensors"
IGNORED = re.compile(
    r"^(betas|alphas_cumprod|sqrt_|log_one_minus|posterior_|logvar$|lvlb_weights|model_ema\.(decay|num_updates)$"
    r"|cond_stage_model\.|first_stage_model\.loss\.)"
)
"""computed from constants, of training alone, or a second copy of the first stage"""
PLAIN, AVERAGED, FIRST = "model.diffusion_model.", "model_ema.diffusion_model", "first_stage_model."
"""the U-Net, its moving average with the dots of the names left out, and the VQ autoencoder"""
RENAMED = (
    (r"\.down\.(\d+)\.block\.", r".down_blocks.\1.resnets."),
    (r"\.down\.(\d+)\.downsample\.", r".down_blocks.\1.downsamplers.0."),
    (r"\.up\.(\d+)\.block\.", r".up_blocks.\1.resnets."),
    (r"\.up\.(\d+)\.upsample\.", r".up_blocks.\1.upsamplers.0."),
    (r"\.mid\.block_1\.", ".mid_block.resnets.0."),
    (r"\.mid\.block_2\.", ".mid_block.resnets.1."),
    (r"\.nin_shortcut\.", ".conv_shortcut."),
    (r"\.norm_out\.", ".conv_norm_out."),
)
"""(pattern, replacement) from the first stage of latent diffusion to VQModel of diffusers"""


def load(name: str, device: torch.device, dtype: torch.dtype, published: VidmConfig = PUBLISHED) -> Vidm:
    """A model for inference, the U-Net in `dtype`; ValueError, one sentence, when there is none or it does not fit.

    A file has the sizes `published`, a folder says its own; the names may be the published ones or ours.
    """
    path = Path(name)
    if not name or not path.exists():
        got = f"got {name!r}, which is not there" if name else "got ''"
        raise ValueError(f"backend 'vidm' needs a model: expected {NEEDED}, {got}; set hand_inpaint.vidm.model")
    config = read_config(path / CONFIG) if path.is_dir() else published
    with torch.device("meta"):
        model = Vidm(config)
    given = our_names(read_tensors(path / WEIGHTS if path.is_dir() else path), model.unet.state_dict(), config)
    fill_weights(model, given, str(path), f"give {NEEDED}")
    model.unet.to(dtype)
    return model.to(device).eval()


def save(model: Vidm, folder: Path) -> None:
    """Write a model as a folder; the same weights give the same bytes."""
    folder.mkdir(parents=True, exist_ok=True)
    (folder / CONFIG).write_text(config_text(model.config), encoding="utf-8")
    save_file({name: tensor.detach().cpu().contiguous() for name, tensor in model.state_dict().items()}, folder / WEIGHTS)


def our_names(published: Mapping[str, Tensor], unet: Iterable[str], config: VidmConfig) -> dict[str, Tensor]:
    """Published tensors by our names; of the U-Net its moving average where there is one, as the released script takes it.

    Names that nobody knows stay as they are, so that `fit` speaks of them.
    """
    averaged = {AVERAGED + name.replace(".", ""): f"unet.{name}" for name in unet}
    has_average = any(name.startswith(AVERAGED) for name in published)
    found = {}
    for name, tensor in published.items():
        if name in averaged:
            found[averaged[name]] = tensor
        elif name.startswith(FIRST) and not IGNORED.search(name):
            found[_first_stage(name, len(config.first_stage))] = tensor
        elif name.startswith(PLAIN):
            found |= {} if has_average else {f"unet.{name.removeprefix(PLAIN)}": tensor}
        elif not IGNORED.search(name):
            found[name] = tensor
    return found


def _first_stage(name: str, levels: int) -> str:
    name = "first_stage." + name.removeprefix(FIRST)
    for pattern, replacement in RENAMED:
        name = re.sub(pattern, replacement, name)
    return re.sub(r"\.up_blocks\.(\d+)\.", lambda found: f".up_blocks.{levels - 1 - int(found[1])}.", name)
