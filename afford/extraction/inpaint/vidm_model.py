"""VIDM: encode frames to latents, sample the latent of the target by DDIM, decode it; reading and writing of its weights."""

from __future__ import annotations

import re
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path

import numpy as np
import torch
from diffusers import DDIMScheduler, VQModel
from safetensors.torch import save_file
from torch import Tensor, nn
from torch.nn.functional import interpolate

from afford.extraction.inpaint.vidm_unet import LATENT, Unet, VidmConfig, config_text, read_config
from afford.models.importing import Imported
from afford.models.importing.source import Source
from afford.models.loading import fill_weights
from afford.models.tensor_files import read_tensors

STEPS, BETAS = 1000, (0.0015, 0.0205)
"""noise schedule of training: number of steps, range of beta"""
MAX_DDIM_STEPS = STEPS // 2
"""more steps cannot be equally spaced within the schedule"""


class Vidm(nn.Module):
    """U-Net of any type, and first stage (VQ autoencoder of stride 4) in float32."""

    def __init__(self, config: VidmConfig) -> None:
        super().__init__()
        self.config = config
        self.unet = Unet(config)
        levels = len(config.first_stage)
        self.first_stage = VQModel(
            down_block_types=("DownEncoderBlock2D",) * levels, up_block_types=("UpDecoderBlock2D",) * levels,
            block_out_channels=config.first_stage, layers_per_block=config.first_stage_blocks, latent_channels=LATENT,
            sample_size=config.size_px, num_vq_embeddings=config.codes, mid_block_add_attention=False,
        )  # fmt: skip


@torch.inference_mode()
def fill(model: Vidm, rgb: np.ndarray, holes: np.ndarray, *, steps: int, eta: float, seeds: Sequence[int]) -> np.ndarray:
    """Fill the hole of the last frame of each group.

    rgb: (b, t, s, s, 3) uint8, the target last; holes: (b, t, s, s) bool. steps: 1 to 500, eta: 0..1. Returns (b, s, s, 3) uint8;
    pixels outside the hole are also output of the model. The noise of a group depends on its seed alone, and is drawn on the CPU.
    """
    known = _condition(model, rgb, holes)
    noise = [torch.Generator().manual_seed(seed) for seed in seeds]
    shape = (1, LATENT, *known.shape[-2:])
    latent = torch.cat([torch.randn(shape, generator=one) for one in noise]).to(known.device)
    scheduler = ddim(steps)
    for step in scheduler.timesteps:
        guess = _predict_noise(model.unet, latent, known, step)
        latent = scheduler.step(guess, step, latent, eta=eta, generator=noise).prev_sample
    images = torch.cat([model.first_stage.decode(one[None]).sample for one in latent])
    return ((images.clamp(-1, 1) + 1) * 127.5).round().byte().permute(0, 2, 3, 1).cpu().numpy()


def ddim(steps: int) -> DDIMScheduler:
    """Build the published sampler, with equal steps that end at the first step of the schedule. ValueError for too many steps."""
    if not 1 <= steps <= MAX_DDIM_STEPS:
        raise ValueError(f"ddim_steps: expected 1 to {MAX_DDIM_STEPS}, got {steps}")
    scheduler = DDIMScheduler(num_train_timesteps=STEPS, beta_start=BETAS[0], beta_end=BETAS[1], beta_schedule="scaled_linear",
                              clip_sample=False, set_alpha_to_one=False, steps_offset=1)  # fmt: skip
    scheduler.set_timesteps(steps)
    return scheduler


def _condition(model: Vidm, rgb: np.ndarray, holes: np.ndarray) -> Tensor:
    """Condition (b, 4, t, s / 4, s / 4): latents of the frames with their holes black, and the holes as -1 and 1."""
    device = next(model.parameters()).device
    black = torch.from_numpy(np.where(holes[..., None], 0, rgb)).to(device).permute(0, 1, 4, 2, 3).float() / 127.5 - 1
    latents = torch.stack([model.first_stage.encode(group).latents for group in black], 0)
    masks = interpolate(torch.from_numpy(holes).to(device).float() * 2 - 1, latents.shape[-2:])
    return torch.cat([latents, masks[:, :, None]], 2).transpose(1, 2)


def _predict_noise(unet: Unet, latent: Tensor, known: Tensor, step: Tensor) -> Tensor:
    dtype = next(unet.parameters()).dtype
    repeated = latent[:, :, None].expand(-1, -1, known.shape[2], -1, -1)
    steps = step.to(latent.device).expand(len(latent))
    return unet(torch.cat([repeated, known], 1).to(dtype), steps).float()


CONFIG, WEIGHTS = "config.json", "model.safetensors"
PUBLISHED = VidmConfig()
NEEDED = "the published checkpoint (nohands_weights.ckpt, also as .safetensors) or a folder with config.json and model.safetensors"
IGNORED = re.compile(
    r"^(betas|alphas_cumprod|sqrt_|log_one_minus|posterior_|logvar$|lvlb_weights|model_ema\.(decay|num_updates)$"
    r"|cond_stage_model\.|first_stage_model\.loss\.)"
)
"""tensors that are constants, needed for training only, or a second copy of the first stage"""
PLAIN, AVERAGED, FIRST = "model.diffusion_model.", "model_ema.diffusion_model", "first_stage_model."
"""prefixes of the U-Net, of its moving average (names without dots), and of the VQ autoencoder"""
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
    """Load a model for inference, the U-Net in `dtype`; ValueError when the file is missing or does not fit.

    A file has the sizes `published`, a folder has its own config. Published names of tensors and ours are both accepted.
    """
    path = Path(name)
    if not name or not path.exists():
        got = f"got {name!r}, which does not exist" if name else "got ''"
        raise ValueError(f"backend 'vidm' needs a model: expected {NEEDED}, {got}; set hand_inpaint.vidm.model")
    config = read_config(path / CONFIG) if path.is_dir() else published
    with torch.device("meta"):
        model = Vidm(config)
    given = rename_tensors(read_tensors(path / WEIGHTS if path.is_dir() else path), model.unet.state_dict(), config)
    fill_weights(model, given, str(path), f"give {NEEDED}")
    model.unet.to(dtype)
    return model.to(device).eval()


def save(model: Vidm, folder: Path) -> None:
    """Write a model as a folder; the same weights give the same bytes."""
    folder.mkdir(parents=True, exist_ok=True)
    (folder / CONFIG).write_text(config_text(model.config), encoding="utf-8")
    save_file({name: tensor.detach().cpu().contiguous() for name, tensor in model.state_dict().items()}, folder / WEIGHTS)


def rename_tensors(published: Mapping[str, Tensor], unet: Iterable[str], config: VidmConfig) -> dict[str, Tensor]:
    """Rename published tensors to our names; the moving average of the U-Net is preferred, as in the released script.

    Unknown names are kept, so that `fit` reports them.
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


def import_vidm(source: Source) -> Imported:
    """Read a checkpoint of VIDM as published, or of `save` (`afford.models.importing.Kind`)."""
    own = next((folder / CONFIG for folder in source.folders if (folder / CONFIG).is_file()), None)
    config = read_config(own) if own else PUBLISHED
    with torch.device("meta"):
        model = Vidm(config)
    given = rename_tensors(source.tensors, model.unet.state_dict(), config)
    return Imported("VIDM, hand inpainting", "--set hand_inpaint.backend=vidm --set hand_inpaint.vidm.model=DIR",
                    {CONFIG: config_text(config)}, given, dict(model.state_dict()), keep=("first_stage.",), single=True)
