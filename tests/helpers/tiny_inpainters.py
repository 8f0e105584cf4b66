"""Tiny random inpainters that tests save and load with the real code, and the names of published checkpoints.

The names are written down from the checkpoints, not from our classes.
"""

from __future__ import annotations

from collections.abc import Mapping
from itertools import pairwise
from pathlib import Path

import torch
from safetensors.torch import save_file
from torch import Tensor

from afford.extraction.inpaint.lama_network import Generator, LamaConfig
from afford.extraction.inpaint.vidm_model import Vidm, save
from afford.extraction.inpaint.vidm_unet import VidmConfig

Shapes = dict[str, tuple[int, ...]]
VIDM = VidmConfig(size_px=64, channels=32, multiples=(1, 2), blocks=1, attention_at=(2,), heads=4, codes=16,
                  first_stage=(32, 32, 64), first_stage_blocks=1)  # fmt: skip
LAMA = LamaConfig(channels=8, halvings=3, blocks=2)


def save_vidm(folder: Path, seed: int = 0) -> Path:
    """A folder with a VIDM of a quarter of a million parameters, random from a seed."""
    torch.manual_seed(seed)
    save(Vidm(VIDM), folder)
    return folder


def lama(seed: int = 0) -> Generator:
    """A generator of some twenty thousand parameters, random from a seed."""
    torch.manual_seed(seed)
    return Generator(LAMA).eval()


def save_lama(path: Path, seed: int = 0) -> Path:
    """Its tensors as safetensors, with the names of a published checkpoint."""
    path.parent.mkdir(parents=True, exist_ok=True)
    save_file({f"generator.{name}": tensor for name, tensor in lama(seed).state_dict().items()}, path)
    return path


def random_tensors(shapes: Mapping[str, tuple[int, ...]], seed: int = 0) -> dict[str, Tensor]:
    """Small random numbers of these shapes."""
    generator = torch.Generator().manual_seed(seed)
    return {name: torch.randn(shape, generator=generator) * 0.05 for name, shape in shapes.items()}


def vidm_checkpoint(c: VidmConfig) -> Shapes:
    """Every tensor of a published VIDM checkpoint: U-Net, moving average, first stage (also in the conditioner), schedule."""
    unet = {f"model.diffusion_model.{name}": shape for name, shape in _unet(c).items()}
    average = {"model_ema." + name.removeprefix("model.").replace(".", ""): shape for name, shape in unet.items()}
    first = _first_stage(c)
    schedule = ("betas", "alphas_cumprod", "alphas_cumprod_prev", "sqrt_alphas_cumprod", "sqrt_one_minus_alphas_cumprod",
                "log_one_minus_alphas_cumprod", "sqrt_recip_alphas_cumprod", "sqrt_recipm1_alphas_cumprod", "posterior_variance",
                "posterior_log_variance_clipped", "posterior_mean_coef1", "posterior_mean_coef2")  # fmt: skip
    return {**dict.fromkeys(schedule, (1000,)), **unet, "model_ema.decay": (), "model_ema.num_updates": (), **average,
            **{f"first_stage_model.{name}": shape for name, shape in first.items()},
            **{f"cond_stage_model.first_stage_model.{name}": shape for name, shape in first.items()}}  # fmt: skip


def _both(name: str, shape: tuple[int, ...]) -> Shapes:
    return {f"{name}.weight": shape, f"{name}.bias": shape[:1]}


def _unet(c: VidmConfig) -> Shapes:
    emb, now, skips, stride, number = 4 * c.channels, c.channels, [c.channels], 1, 1
    found = _both("time_embed.0", (emb, c.channels)) | _both("time_embed.2", (emb, emb))
    found |= _both("input_blocks.0.0", (c.channels, 7, 1, 3, 3))
    for level, multiple in enumerate(c.multiples):
        for _ in range(c.blocks):
            found |= _level(f"input_blocks.{number}", now, c.channels * multiple, emb, stride in c.attention_at)
            now, number = c.channels * multiple, number + 1
            skips.append(now)
        if level < len(c.multiples) - 1:
            found |= _res(f"input_blocks.{number}.0", now, now, emb)
            skips, stride, number = [*skips, now], stride * 2, number + 1
    found |= _res("middle_block.0", now, now, emb) | _attention("middle_block.1", now) | _res("middle_block.2", now, now, emb)
    number = 0
    for level, multiple in reversed(list(enumerate(c.multiples))):
        for i in range(c.blocks + 1):
            found |= _level(f"output_blocks.{number}", now + skips.pop(), c.channels * multiple, emb, stride in c.attention_at)
            now = c.channels * multiple
            if level and i == c.blocks:
                found |= _res(f"output_blocks.{number}.{2 if stride in c.attention_at else 1}", now, now, emb)
                stride //= 2
            number += 1
    return found | _both("out.0", (now,)) | _both("out.2", (now, now, c.frames, 1, 1)) | _both("out.4", (3, now, 3, 3))


def _level(at: str, given: int, wanted: int, emb: int, attends: bool) -> Shapes:
    return _res(f"{at}.0", given, wanted, emb) | (_attention(f"{at}.1", wanted) if attends else {})


def _res(at: str, given: int, wanted: int, emb: int) -> Shapes:
    skip = _both(f"{at}.skip_connection", (wanted, given, 1, 1, 1)) if given != wanted else {}
    return (_both(f"{at}.in_layers.0", (given,)) | _both(f"{at}.in_layers.2", (wanted, given, 1, 3, 3))
            | _both(f"{at}.emb_layers.1", (wanted, emb)) | _both(f"{at}.out_layers.0", (wanted,))
            | _both(f"{at}.out_layers.3", (wanted, wanted, 1, 3, 3)) | skip)  # fmt: skip


def _attention(at: str, width: int) -> Shapes:
    return _both(f"{at}.norm", (width,)) | _both(f"{at}.qkv", (3 * width, width, 1)) | _both(f"{at}.proj_out", (width, width, 1))


def _first_stage(c: VidmConfig) -> Shapes:
    found = {"quantize.embedding.weight": (c.codes, 3)} | _both("quant_conv", (3, 3, 1, 1)) | _both("post_quant_conv", (3, 3, 1, 1))
    widths, last = c.first_stage, len(c.first_stage) - 1
    now = widths[0]
    found |= _both("encoder.conv_in", (now, 3, 3, 3))
    for level, width in enumerate(widths):
        for i in range(c.first_stage_blocks):
            found |= _vq_res(f"encoder.down.{level}.block.{i}", now, width)
            now = width
        if level != last:
            found |= _both(f"encoder.down.{level}.downsample.conv", (now, now, 3, 3))
    for half in ("encoder", "decoder"):
        found |= _vq_res(f"{half}.mid.block_1", now, now) | _vq_res(f"{half}.mid.block_2", now, now)
    found |= _both("encoder.norm_out", (now,)) | _both("encoder.conv_out", (3, now, 3, 3))
    found |= _both("decoder.conv_in", (now, 3, 3, 3))
    for level in reversed(range(len(widths))):
        for i in range(c.first_stage_blocks + 1):
            found |= _vq_res(f"decoder.up.{level}.block.{i}", now, widths[level])
            now = widths[level]
        if level:
            found |= _both(f"decoder.up.{level}.upsample.conv", (now, now, 3, 3))
    return found | _both("decoder.norm_out", (now,)) | _both("decoder.conv_out", (3, now, 3, 3))


def _vq_res(at: str, given: int, wanted: int) -> Shapes:
    skip = _both(f"{at}.nin_shortcut", (wanted, given, 1, 1)) if given != wanted else {}
    return (_both(f"{at}.norm1", (given,)) | _both(f"{at}.conv1", (wanted, given, 3, 3)) | _both(f"{at}.norm2", (wanted,))
            | _both(f"{at}.conv2", (wanted, wanted, 3, 3)) | skip)  # fmt: skip


def lama_checkpoint(c: LamaConfig) -> Shapes:
    """Every tensor of a published LaMa checkpoint that is the generator's, and one of its discriminator."""
    widths = [c.channels * 2**level for level in range(c.halvings + 1)]
    deep, wide = widths[-1], int(widths[-1] * c.share)
    at = {"1.ffc.convl2l.weight": (widths[0], 4, 7, 7)} | _bn("1.bn_l", widths[0])
    for i, (given, wanted) in enumerate(pairwise(widths), start=2):
        outer = int(wanted * c.share) if wanted == deep else 0
        at |= {f"{i}.ffc.convl2l.weight": (wanted - outer, given, 3, 3)} | _bn(f"{i}.bn_l", wanted - outer)
        at |= {f"{i}.ffc.convl2g.weight": (outer, given, 3, 3)} | _bn(f"{i}.bn_g", outer) if outer else {}
    start = 2 + c.halvings
    for i in range(start, start + c.blocks):
        at |= _ffc(f"{i}.conv1", deep - wide, wide) | _ffc(f"{i}.conv2", deep - wide, wide)
    for i, (given, wanted) in enumerate(zip(widths[:0:-1], widths[-2::-1], strict=True)):
        number = start + c.blocks + 1 + 3 * i
        at |= {f"{number}.weight": (given, wanted, 3, 3), f"{number}.bias": (wanted,)} | _bn(str(number + 1), wanted)
    at |= _both(str(start + c.blocks + 2 + 3 * c.halvings), (3, widths[0], 7, 7))
    return {f"generator.model.{name}": shape for name, shape in at.items()} | {"discriminator.model0.0.weight": (8, 3, 4, 4)}


def _bn(at: str, width: int) -> Shapes:
    return _both(at, (width,)) | {f"{at}.running_mean": (width,), f"{at}.running_var": (width,), f"{at}.num_batches_tracked": ()}


def _ffc(at: str, near: int, far: int) -> Shapes:
    half = far // 2
    ffc = {"convl2l": (near, near, 3, 3), "convl2g": (far, near, 3, 3), "convg2l": (near, far, 3, 3),
           "convg2g.conv1.0": (half, far, 1, 1), "convg2g.fu.conv_layer": (2 * half, 2 * half, 1, 1),
           "convg2g.conv2": (far, half, 1, 1)}  # fmt: skip
    norms = {"ffc.convg2g.conv1.1": half, "ffc.convg2g.fu.bn": 2 * half, "bn_l": near, "bn_g": far}
    found = {f"{at}.ffc.{name}.weight": shape for name, shape in ffc.items()}
    for name, width in norms.items():
        found |= _bn(f"{at}.{name}", width)
    return found
