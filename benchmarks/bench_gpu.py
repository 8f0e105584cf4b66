"""Measure the large models, training and physics on a GPU, part by part; writes benchmarks/gpu.md.

    PYTHONPATH=. python benchmarks/bench_gpu.py [PART ...] [--scratch DIR] [--dataset DIR]

Needs a CUDA build of torch. Each part takes less than eight minutes; figures of parts that ran before stay in benchmarks/gpu.json
with the name of their card. A part whose packages or data are missing is named. Weights are random, since speed does not depend on
them.
"""

from __future__ import annotations

import argparse
import importlib.util
import json
import statistics
import time
from collections.abc import Callable
from dataclasses import replace
from functools import partial
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import TYPE_CHECKING, Any

import numpy as np
import torch
from safetensors.torch import save_file
from torch import nn

if TYPE_CHECKING:
    from afford.twohands.train.job import TwoHandsJob

ROOT = Path(__file__).resolve().parent.parent
PAGE, FIGURES = ROOT / "benchmarks" / "gpu.md", ROOT / "benchmarks" / "gpu.json"
Figures = dict[str, str]
"""what was measured -> figure with its unit"""


def seconds(work: Callable[[], object], repeats: int = 5) -> float:
    """Median seconds of a call, after one that does not count."""
    found = []
    for n in range(repeats + 1):
        torch.cuda.synchronize()
        began = time.perf_counter()
        work()
        torch.cuda.synchronize()
        found += [time.perf_counter() - began] if n else []
    return statistics.median(found)


def peak_gib() -> str:
    """Largest memory of torch on the device since the last reset."""
    return f"{torch.cuda.max_memory_allocated() / 2**30:.1f} GiB"


def on_device(model: nn.Module, dtype: torch.dtype) -> nn.Module:
    """Give a model that was built on the device meta random weights on the GPU."""
    generator = torch.Generator("cuda").manual_seed(0)
    weights = {name: torch.randn(tensor.shape, generator=generator, device="cuda", dtype=dtype).mul_(0.02)
               for name, tensor in model.state_dict().items()}  # fmt: skip
    model.load_state_dict(weights, assign=True)
    return model


def sam2(args: argparse.Namespace) -> Figures:
    """SAM 2.1 hiera large: a video of 480p with two objects, from a prompt in its first frame."""
    from transformers import Sam2VideoModel

    from afford.models.sam2 import published_config, session, track_frames

    count, rgb = 48, np.random.default_rng(0).integers(0, 255, (48, 480, 854, 3)).astype(np.uint8)
    prompt = np.zeros((2, 480, 854), bool)
    prompt[0, 100:300, 100:300] = prompt[1, 200:400, 500:700] = True
    out: Figures = {}
    for dtype in (torch.float32, torch.bfloat16):
        torch.cuda.reset_peak_memory_stats()
        model = Sam2VideoModel(published_config("large")).to("cuda", dtype).eval()
        made = session(model, rgb, {0: prompt})
        list(track_frames(model, rgb, {0: prompt}, range(4), within=made))
        torch.cuda.synchronize()
        began = time.perf_counter()
        list(track_frames(model, rgb, {0: prompt}, range(count), within=made))
        torch.cuda.synchronize()
        name = str(dtype).removeprefix("torch.")
        out[f"SAM 2.1 hiera large, 2 objects, {name}"] = f"{count / (time.perf_counter() - began):.1f} frames/s, {peak_gib()}"
        del model, made
    return out


def vidm(args: argparse.Namespace) -> Figures:
    """VIDM at its published size: groups of four frames of 256 x 256, 50 steps, two groups at once."""
    from afford.extraction.inpaint.vidm_model import Vidm, fill
    from afford.extraction.inpaint.vidm_unet import VidmConfig

    out: Figures = {}
    for dtype in (torch.float32, torch.bfloat16):
        torch.cuda.reset_peak_memory_stats()
        model = Vidm(VidmConfig()).to("cuda").eval()
        model.unet.to(dtype)
        rgb = np.random.default_rng(0).integers(0, 255, (2, 4, 256, 256, 3)).astype(np.uint8)
        holes = np.zeros((2, 4, 256, 256), bool)
        holes[:, :, 80:160, 80:160] = True
        took = seconds(partial(fill, model, rgb, holes, steps=50, eta=1.0, seeds=(0, 1)), 2) / 2
        out[f"VIDM, 50 steps, {str(dtype).removeprefix('torch.')}"] = f"{took:.2f} s a frame, {peak_gib()}"
    return out


def vlm(size: str) -> Callable[[argparse.Namespace], Figures]:
    """LLaVA of a size with SAM ViT-H in bfloat16: from files onto the card, then one picture."""
    def part(args: argparse.Namespace) -> Figures:
        from afford.twohands.model.interface import Batch
        from afford.twohands.model.model_folder import load_model

        with TemporaryDirectory(dir=args.scratch) as scratch:
            folder = published(Path(scratch), size)
            gigabytes = sum(path.stat().st_size for path in folder.rglob("*")) / 1e9
            torch.cuda.reset_peak_memory_stats()
            began = time.perf_counter()
            model = load_model(folder).to("cuda")
            torch.cuda.synchronize()
            load = time.perf_counter() - began
        batch = Batch(torch.rand(1, 3, 1024, 1024, device="cuda"), ("pour tea from the kettle",))
        with torch.inference_mode():
            given, generated = seconds(lambda: model(batch), 3), seconds(lambda: model.answer(batch), 3)
        name = f"{size.upper()} with SAM ViT-H, bfloat16"
        return {f"{name}: load {gigabytes:.0f} GB from files": f"{load:.0f} s",
                f"{name}: a picture, answer given": f"{1000 * given:.0f} ms",
                f"{name}: a picture, answer generated (32 tokens)": f"{1000 * generated:.0f} ms, {peak_gib()}"}  # fmt: skip

    return part


def published(root: Path, size: str) -> Path:
    """Write a two-hand model of published size with random weights, in shards, as `weights import` writes it."""
    from afford.models.importing.source import INDEX
    from afford.twohands.model.interface import ModelConfig, build
    from afford.twohands.model.model_folder import config_json
    from tests.helpers.large_models import write_backbones

    config = ModelConfig(variant="vlm", size_px=(1024, 1024), hypotheses=1, backbones=str(write_backbones(root / "sizes", size)))
    with torch.device("meta"):
        model = build(config, 0, pretrained=False)
    folder = root / "model"
    for name, text in {**model.extra_files(), "config.json": config_json(config)}.items():
        (folder / name).parent.mkdir(parents=True, exist_ok=True)
        (folder / name).write_text(text)
    names, weight_map = list(model.state_dict()), {}
    for n, some in enumerate(names[at : at + 200] for at in range(0, len(names), 200)):
        file = f"model-{n:05d}.safetensors"
        shapes = {name: model.state_dict()[name].shape for name in some}
        drawn = {name: torch.randn(shape, device="cuda", dtype=torch.bfloat16).mul_(0.02).cpu() for name, shape in shapes.items()}
        save_file(drawn, folder / file)
        weight_map |= dict.fromkeys(some, file)
    (folder / INDEX).write_text(json.dumps({"weight_map": weight_map}))
    return folder


def lora(args: argparse.Namespace) -> Figures:
    """One LoRA step of the 7B model, all of it in bfloat16: two samples, gradient checkpointing, AdamW over what is trained."""
    with TemporaryDirectory(dir=args.scratch) as scratch:
        job, model = paper_training(Path(scratch), 2)
    took = step_s(replace(job, plan=replace(job.plan, bf16=False)), model)
    count = sum(parameter.numel() for parameter in model.parameters() if parameter.requires_grad)
    return {"7B: one LoRA step, 2 samples, bfloat16, checkpointed": f"{took:.2f} s, {peak_gib()}, {count / 1e6:.0f} M trained"}


def frozen(args: argparse.Namespace) -> Figures:
    """One step of the paper's recipe for the 7B model, frozen weights kept in bfloat16, beside the planned memory."""
    from afford.models.loading import dtype_of
    from afford.twohands.model.frozen_weights import store_frozen
    from afford.twohands.model.memory_plan import GIB
    from afford.twohands.train.memory_plan import plan_training

    out: Figures = {}
    for count in (1, 2):
        with TemporaryDirectory(dir=args.scratch) as scratch:
            job, model = paper_training(Path(scratch), count)
            planned = plan_training(job).needed / GIB
        store_frozen(model, dtype_of(job.frozen_dtype))
        took = step_s(job, model)
        out[f"7B: one step of the paper's recipe, frozen weights in bfloat16, batch {count}"] = (
            f"{took:.2f} s, {peak_gib()}; planned {planned:.1f} GiB")
        del model
    return out


def paper_training(folder: Path, batch: int) -> tuple[TwoHandsJob, nn.Module]:
    """Job of the paper's recipe for the 7B model, frozen weights in bfloat16, and a random model in bfloat16 on the GPU."""
    from afford.twohands.model.interface import build
    from afford.twohands.model.large import compute_buffers
    from benchmarks.bench_memory_plan import published_config, published_job

    job = published_job(published_config(folder, "7b"), "bfloat16", batch)
    with torch.device("meta"):
        model: nn.Module = build(job.config, 0, pretrained=False)
    model = on_device(model, torch.bfloat16)
    compute_buffers(model)
    return job, model.to("cuda")


def step_s(job: TwoHandsJob, model: nn.Module) -> float:
    """Seconds of a step of a job on the GPU, of one micro-batch, with gradient checkpointing."""
    from afford.training.loop import autocast
    from afford.twohands.model.interface import Batch, Target
    from afford.twohands.model.losses import losses

    model.train().get_submodule("vlm").gradient_checkpointing_enable({"use_reentrant": False})  # type: ignore[operator]
    optimiser = torch.optim.AdamW([parameter for parameter in model.parameters() if parameter.requires_grad], lr=1e-5)
    count, side = job.batch, job.config.size_px[0]
    batch = Batch(torch.rand(count, 3, side, side, device="cuda"), ("pour tea",) * count)
    masks = torch.zeros(count, 2, side, side, device="cuda")
    masks[:, :, 300:600, 300:600] = 1
    target = Target(masks, torch.ones(count, 2, dtype=torch.bool, device="cuda"), torch.full((count,), 2, device="cuda"))

    def step() -> None:
        with autocast("cuda", job.plan.bf16):
            total = losses(model(batch), target, job.loss)["total"]
        total.backward()
        optimiser.step()
        optimiser.zero_grad()

    torch.cuda.empty_cache()
    torch.cuda.reset_peak_memory_stats()
    return seconds(step, 3)


def memory(args: argparse.Namespace) -> Figures:
    """Planned and measured memory of a random model of 306 M parameters, predictions and trainings."""
    from afford.twohands.model.memory_plan import process_bytes
    from benchmarks.bench_memory_plan import GIB, TYPES, on_gpu

    torch.rand(64, 64, device="cuda") @ torch.rand(64, 64, device="cuda")
    free, whole = torch.cuda.mem_get_info()
    out = {"process without a model": ratio(process_bytes("cuda") / GIB, (whole - free) / GIB)}
    for dtype in TYPES:
        with TemporaryDirectory(dir=args.scratch) as scratch:
            for kind, planned, found in on_gpu(Path(scratch), dtype):
                out[f"306 M model, {kind}, {dtype}"] = ratio(planned / GIB, found / GIB)
    return out


def ratio(planned_gib: float, measured_gib: float) -> str:
    """Planned and measured memory."""
    return f"planned {planned_gib:.2f} / measured {measured_gib:.2f} GiB = {planned_gib / measured_gib:.2f}"


def sor3d(args: argparse.Namespace) -> Figures:
    """SOR3D-AFF at the paper's width; 22 ms a mask are published."""
    from afford.rgbd.model.config import VARIANTS
    from afford.rgbd.model.model import build
    from benchmarks.bench_sor3d_speed import FRAMES, answers_ms, learned_per_s

    torch.cuda.reset_peak_memory_stats()
    model = build(VARIANTS["paper"](), 0).to("cuda").eval()
    picture, video, _ = answers_ms(model, "cuda", 5)
    rate, name = learned_per_s(model, "paper", "cuda"), "SOR3D-AFF, paper width"
    return {f"{name}: a picture": f"{picture:.1f} ms", f"{name}: a video of {FRAMES} frames": f"{video:.1f} ms",
            f"{name}: learned": f"{rate:.2f} sequences/s, {peak_gib()}"}  # fmt: skip


def warp(args: argparse.Namespace) -> Figures:
    """PPO that learns with the Shadow hand and a tool in mujoco-warp; 252,938 FPS are published for 8,192 worlds on one L40.

    A control step is 1/20 s of one world.
    """
    from benchmarks.bench_engines import learning

    out = Figures()
    for worlds in (4096, 8192):
        hand, task, setting = scene(worlds)
        out[f"{of_warp(worlds)}: control steps, PPO learning"] = f"{learning(hand, [task], setting):,.0f} a second"
        print(out, flush=True)
    return out


def control(args: argparse.Namespace) -> Figures:
    """Control steps of 4,096 worlds in mujoco-warp with observation, reward and policy: in numpy on the CPU, and on the device.

    A control step is 1/20 s of one world, a physics step 1/240 s. The reset of all worlds is measured apart. The policy is a small
    untrained network.
    """
    from afford.grasping.env.arrays import NUMPY
    from afford.grasping.env.device_arrays import DeviceArrays
    from afford.grasping.env.grasp_worlds import GraspWorlds
    from afford.grasping.rl.ppo import ActorCritic, PolicyConfig

    worlds, out = 4096, Figures()
    hand, task, setting = scene(worlds)
    rngs = [np.random.default_rng(k) for k in range(worlds)]
    for name, arrays in (("in numpy", NUMPY), ("on the device", DeviceArrays("cuda"))):
        core = GraspWorlds(hand, [task] * worlds, setting.config(), arrays=arrays)
        model = ActorCritic(PolicyConfig(core.width, core.motors)).cuda()
        began = time.perf_counter()
        core.reset(range(worlds), rngs)
        reset_s, took_s = time.perf_counter() - began, seconds(partial(controlled, core, model, rngs), 10)
        solver_s = seconds(partial(advance, core.worlds), 10)
        core.close()
        out[f"{of_warp(worlds)}: control steps with observation, reward and policy, {name}"] = (
            f"{worlds / took_s:,.0f} a second; {100 * solver_s / took_s:.0f} % in the solver; reset of all {reset_s:.1f} s")
        print(out, flush=True)
    out[f"{of_warp(worlds)}: physics steps in the solver"] = f"{12 * worlds / solver_s:,.0f} a second"
    return out


def scene(worlds: int) -> tuple[Any, Any, Any]:
    """Hand, task and setting of worlds in mujoco-warp on the GPU."""
    from afford.grasping.hand.assets import shadow_files
    from benchmarks.bench_engines import Setting
    from benchmarks.bench_grasp_env import TOOLS, tool
    from stages.grasping import hand_model

    return hand_model.run(shadow_files(), hand_model.Params()), tool(next(iter(TOOLS))), Setting("warp", 50, 1, worlds, "cuda")


def of_warp(worlds: int) -> str:
    """Name of the figures of worlds in mujoco-warp."""
    return f"mujoco-warp, Shadow hand and a tool, {worlds:,} worlds"


@torch.no_grad()
def controlled(core: Any, model: Any, rngs: list[np.random.Generator]) -> None:
    """Observe, act and step once, in the library of the worlds."""
    from afford.common.arrays import like

    obs = core.observe()
    core.step(like(model.actions(torch.as_tensor(obs, device=model.device)).mean, obs), rngs)


def advance(worlds: Any) -> None:
    """Run the solver for a control step."""
    for group in getattr(worlds, "batch", worlds)._groups:
        with group._computing():
            group._advance(12)


def decode(args: argparse.Namespace) -> Figures:
    """Training of the variant small from a data set: share of the time in which the device is not waiting for pictures."""
    from afford.common.files import tree
    from afford.training.loop import SINGLE_PROCESS, accumulate_gradients, make_optimizer, prefetch
    from stages.twohands import model_train

    job = model_train.training_job(model_train.Params(device="cuda", steps=200, batch=32))  # the stage's own job
    with TemporaryDirectory(dir=args.scratch) as scratch:
        job.prepare({file.name: file.path for file in tree("set", args.dataset).files}, Path(scratch))
        task = job.task(Path(scratch), 1)
        model = task.model.to("cuda").train()
        optimiser = make_optimizer(model, job.plan)

        def step(batch: Any) -> None:
            accumulate_gradients(lambda one: task.loss(model, one), [batch], model, SINGLE_PROCESS)
            optimiser.step()
            optimiser.zero_grad()

        first = task.batch(0)
        alone_s = seconds(lambda: step(first), 20)
        out = {}
        for workers in (1, 8):
            batches = prefetch(task.batch, range(120), workers, 2 * workers)
            step(next(batches))
            torch.cuda.synchronize()
            began = time.perf_counter()
            for batch in batches:
                step(batch)
            torch.cuda.synchronize()
            each = (time.perf_counter() - began) / 119
            out[f"decoding ahead, {workers} threads, {len(first.task)} samples a step"] = (
                f"{len(first.task) / each:.0f} samples/s, device busy {100 * min(alone_s / each, 1):.0f} %")
    return out


PARTS: dict[str, tuple[Callable[[argparse.Namespace], Figures], tuple[str, ...]]] = {
    "sam2": (sam2, ("transformers",)), "vidm": (vidm, ("diffusers",)), "vlm-7b": (vlm("7b"), ("transformers", "peft")),
    "vlm-13b": (vlm("13b"), ("transformers", "peft")), "lora": (lora, ("peft",)),
    "frozen": (frozen, ("peft",)), "memory": (memory, ("transformers", "peft")), "sor3d": (sor3d, ()),
    "warp": (warp, ("mujoco", "mujoco_warp", "warp")), "control": (control, ("mujoco", "mujoco_warp", "warp")),
    "decode": (decode, ("pyarrow",))}  # fmt: skip
"""part -> measurement, packages that it needs"""


def page(found: dict[str, Any]) -> str:
    """Write the Markdown page."""
    rows = [f"| {name} | {figure} | {part['card']} |" for part in found.values() for name, figure in part["figures"].items()]
    missing = [name for name in PARTS if name not in found]
    text = "Written by `benchmarks/bench_gpu.py`; random weights, medians after a warm-up, memory of torch alone."
    left = [f"Not measured: {', '.join(missing)}."] if missing else []
    table = ("| measured | figure | card |", "|---|---|---|", *rows)
    return "\n".join(("# Large models on a GPU", "", text, "", *table, "", *left, ""))


def main() -> None:
    """Measure the parts that are asked for, each on its own."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("parts", nargs="*", default=list(PARTS))
    parser.add_argument("--scratch", type=Path)
    parser.add_argument("--dataset", type=Path, help="folder of a data set, for decode")
    args = parser.parse_args()
    if not torch.cuda.is_available():
        raise SystemExit("bench_gpu needs a CUDA build of torch and a GPU; none is here")
    found = json.loads(FIGURES.read_text()) if FIGURES.is_file() else {}
    for name in args.parts:
        work, needs = PARTS[name]
        lacking = [package for package in needs if importlib.util.find_spec(package) is None]
        if lacking or (name == "decode" and args.dataset is None):
            print(f"{name}: left out, {', '.join(lacking) or '--dataset'} missing", flush=True)
            continue
        began = time.perf_counter()
        found[name] = {"card": torch.cuda.get_device_name(), "figures": work(args)}
        print(f"{name}: {time.perf_counter() - began:.0f} s, {found[name]['figures']}", flush=True)
        torch.cuda.empty_cache()
        FIGURES.write_text(json.dumps(found, indent=1) + "\n")
        PAGE.write_text(page(found))


if __name__ == "__main__":
    main()
