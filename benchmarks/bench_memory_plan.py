"""Compare planned with measured memory of large two-hand models; writes benchmarks/memory_plan.md.

    PYTHONPATH=. python benchmarks/bench_memory_plan.py [PART ...] [--scratch DIR]

A random model of 306 M parameters is run on a CPU, each time in a process of its own. Measured is the largest sum of its anonymous
memory and of the mapped pages of the model's files, which also hold frozen weights in training. Models of published size are
planned only, beside the figures of benchmarks/gpu.md. Rows of parts that ran before stay in benchmarks/memory_plan.json. A training
takes minutes of a core, in bfloat16 ten where the CPU has no instructions for it.
"""

from __future__ import annotations

import argparse
import gc
import json
import re
import shutil
import subprocess
import sys
import textwrap
import time
from collections.abc import Callable, Iterator
from dataclasses import replace
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np
import torch
from transformers import CLIPVisionConfig, LlamaConfig, LlavaConfig, LlavaForConditionalGeneration, SamConfig, SamModel

from afford.common.files import tree
from afford.models.meta_memory import model_tensors, peak_bytes, recomputed, tensor_bytes
from afford.models.tokens import HashedTokens
from afford.twohands.model.interface import Batch, ModelConfig, Target, build
from afford.twohands.model.large import plan_folder
from afford.twohands.model.losses import LossParams, losses
from afford.twohands.model.memory_plan import GIB, LIBRARIES, WORKSPACE, plan_prediction, trained_bytes
from afford.twohands.model.model_folder import read_config, save_model
from afford.twohands.model.predictor import Predictor
from afford.twohands.train.job import TwoHandsJob
from afford.twohands.train.memory_plan import plan_training
from benchmarks.bench_gpu import FIGURES
from benchmarks.bench_weights_import import anonymous_mib, resident_mib
from benchmarks.pages import ROOT
from stages.extraction import dataset_pack
from stages.twohands import model_train
from tests.helpers.large_models import write_backbones
from tests.helpers.made_samples import Scratch, clip

PAGE, KEPT = ROOT / "benchmarks" / "memory_plan.md", ROOT / "benchmarks" / "memory_plan.json"
SIDE, WORDS = 512, 8003
SAMPLES = {"train": 4, "val": 1}
TYPES = ("float32", "bfloat16")
KINDS: dict[str, dict[str, Any]] = {"train": {}, "train, batch 1, not checkpointed": {"batch": 1, "checkpointing": False}}
"""kind of a training -> what it changes in the paper's recipe: batch 2, with gradient checkpointing"""
LIBRARY, PUBLISHED = "libraries", "published"
SMALL = (LIBRARY, *(f"{kind}, {dtype}" for dtype in TYPES for kind in ("predict", *KINDS)))
"""parts of the random model"""
PARTS = (*SMALL, PUBLISHED)


def write_small(folder: Path, dtype: torch.dtype) -> Path:
    """Write random backbones of a two-hand model of 306 M parameters in a type."""
    torch.manual_seed(0)
    text = LlamaConfig(hidden_size=1024, intermediate_size=2816, num_hidden_layers=8, num_attention_heads=16,
                       num_key_value_heads=16, vocab_size=WORDS)  # fmt: skip
    vision = CLIPVisionConfig(hidden_size=768, intermediate_size=3072, num_hidden_layers=12, num_attention_heads=12,
                              image_size=224, patch_size=14, projection_dim=512)  # fmt: skip
    llava = LlavaConfig(text_config=text, vision_config=vision, image_token_index=3)
    LlavaForConditionalGeneration(llava).to(dtype).save_pretrained(folder / "vlm")
    encoder = {"hidden_size": 768, "num_hidden_layers": 12, "num_attention_heads": 12, "global_attn_indexes": [2, 5, 8, 11],
               "image_size": SIDE}  # fmt: skip
    sam = SamConfig(vision_config=encoder, prompt_encoder_config={"image_size": SIDE, "image_embedding_size": SIDE // 16})
    SamModel(sam).to(dtype).save_pretrained(folder / "sam")
    (folder / "vlm" / "tokenizer.json").write_text(HashedTokens(WORDS).to_json())
    config = ModelConfig(variant="vlm", size_px=(SIDE, SIDE), hypotheses=1, backbones=str(folder))
    save_model(build(config, 0).to(dtype), folder / "model")
    return folder


def settings(folder: Path, dtype: str, kind: str) -> model_train.Params:
    """Parameters of a training of two steps, with a validation after each."""
    recipe = replace(model_train.VLM, backbones=str(folder), height_px=SIDE, width_px=SIDE, steps=2, warmup=1, accumulate=1,
                     validate_every=1, val_samples=SAMPLES["val"], frozen_dtype=dtype)  # fmt: skip
    return replace(recipe, **KINDS[kind])


def run(kind: str, scratch: Path, dtype: str) -> None:
    """Body of a measured process."""
    torch.set_num_threads(1)
    folder = scratch / dtype
    if kind == "libraries":
        tiny = build(ModelConfig(variant="vlm", size_px=(64, 64), hypotheses=1), 0)
        Predictor(tiny).predict(np.zeros((64, 64, 3), np.uint8), "pour tea")
    elif kind == "predict":
        Predictor(folder / "model").predict(np.zeros((SIDE, SIDE, 3), np.uint8), "pour tea from the kettle")
    else:
        from afford.training.train import train_job

        (scratch / "run").mkdir()
        job = model_train.training_job(settings(folder, dtype, kind))  # the stage's own job
        train_job(job, tree("set", scratch / "set"), "vlm", Scratch(scratch / "run"), 1)


def measured(kind: str, scratch: Path, dtype: str) -> float:
    """Largest sum of the anonymous memory of a process and of the mapped pages of its model, in GiB."""
    command = [sys.executable, __file__, "--scratch", str(scratch), "--run", kind, "--dtype", dtype]
    most = mapped = looked = 0.0
    with subprocess.Popen(command) as process:
        while process.poll() is None:
            if abs(resident_mib(process.pid, "RssFile") - looked) > 8:  # a look holds the process up
                mapped, looked = mapped_gib(process.pid), resident_mib(process.pid, "RssFile")
            most = max(most, anonymous_mib(process.pid) / 1024 + mapped)
            time.sleep(0.02)
    if process.returncode:
        raise SystemExit(f"{' '.join(command)}: exit code {process.returncode}")
    return most


def mapped_gib(process: int) -> float:
    """Memory of the pages of mapped files of tensors of a process; pages that it has written to are anonymous."""
    try:
        text = Path(f"/proc/{process}/smaps").read_text()
    except OSError:
        return 0.0
    blocks = re.findall(r"\.safetensors\n((?:\w+: .*\n)+)", text)
    parts = [dict(re.findall(r"^(Rss|Anonymous): +(\d+) kB", block, re.M)) for block in blocks]
    return sum(int(part["Rss"]) - int(part["Anonymous"]) for part in parts) / (1 << 20)


def write_set(scratch: Path) -> Path:
    """Write a data set of random pictures."""
    clips = tuple(clip(f"P01_0{n}", count, split=split, height=SIDE, width=SIDE)
                  for n, (split, count) in enumerate(SAMPLES.items()))  # fmt: skip
    (scratch / "packed").mkdir()
    packed = dataset_pack.run(clips, dataset_pack.Params(sheet_samples=1), Scratch(scratch / "packed"))
    for file in packed.files:
        (scratch / "set" / file.name).parent.mkdir(parents=True, exist_ok=True)
        (scratch / "set" / file.name).write_bytes(file.path.read_bytes())
    return scratch / "set"


def small_row(part: str, scratch: Path) -> str:
    """Row of a part of the random model: planned, measured, ratio."""
    if part == LIBRARY:
        return compared("libraries | ", LIBRARIES, measured(LIBRARY, scratch, ""))
    kind, _, dtype = part.rpartition(", ")
    folder = scratch / dtype
    if not folder.exists():
        write_small(folder, getattr(torch, dtype))
    if kind == "predict":
        plan = plan_folder(folder / "model", read_config(folder / "model"), "", "cpu", 1)
    else:
        plan = plan_training(model_train.training_job(settings(folder, dtype, kind)), SAMPLES["train"], SAMPLES["val"])
    print(part, plan.parts(), flush=True)
    found = measured(kind, scratch, dtype)
    shutil.rmtree(scratch / "run", ignore_errors=True)
    return compared(f"{kind} | {dtype}", plan.total, found)


def compared(name: str, planned: int, measured_gib: float) -> str:
    """Row with planned and measured GiB."""
    return f"| {name} | {planned / GIB:.2f} | {measured_gib:.2f} | {planned / GIB / measured_gib:.2f} |"


def published_config(folder: Path, size: str) -> ModelConfig:
    """Config of a model of published size."""
    return ModelConfig(variant="vlm", size_px=(1024, 1024), hypotheses=1, backbones=str(write_backbones(folder / size, size)))


def lora_step(config: ModelConfig) -> int:
    """Bytes of the step that `bench_gpu.lora` measures: all of it in bfloat16."""
    with torch.device("meta"):
        model = build(config, 0, pretrained=False).to(torch.bfloat16).train()
        image, masks = torch.empty(2, 3, 1024, 1024), torch.empty(2, 2, 1024, 1024)
    model.get_submodule("vlm").gradient_checkpointing_enable({"use_reentrant": False, "context_fn": recomputed})
    target = Target(masks, torch.ones(2, 2, dtype=torch.bool), torch.tensor([2, 1]))

    def step() -> None:
        losses(model(Batch(image, ("pour tea", "open the jar"))), target, LossParams())["total"].backward()

    return tensor_bytes(model_tensors(model)) + 2 * trained_bytes(model) + peak_bytes(step, model_tensors(model))


def published_rows(scratch: Path) -> list[str]:
    """Rows of the published sizes: planned, and measured on a GPU where benchmarks/gpu.json has it."""
    figures = {name: text for part in json.loads(FIGURES.read_text()).values() for name, text in part["figures"].items()}
    rows = []
    for size in ("7b", "13b"):
        config = published_config(scratch, size)
        with torch.device("meta"):
            model = build(config, 0, pretrained=False).to(torch.bfloat16)
        torch_alone = plan_prediction(model, "cuda").needed
        key = f"{size.upper()} with SAM ViT-H, bfloat16: a picture, answer generated (32 tokens)"
        rows.append(row(f"{size.upper()}: predict, bfloat16", torch_alone, figures.get(key, "")))
    key = "7B: one LoRA step, 2 samples, bfloat16, checkpointed"
    rows.append(row("7B: one LoRA step, all in bfloat16", lora_step(published_config(scratch, "7b")), figures.get(key, "")))
    for size in ("7b", "13b"):
        for dtype, batch in (("float32", 2), ("bfloat16", 2), ("bfloat16", 1)):
            plan = plan_training(published_job(published_config(scratch, size), dtype, batch))
            rows.append(row(f"{size.upper()}: train, frozen weights in {dtype}, batch {batch}", plan.needed, ""))
            print(rows[-1], plan.parts(), flush=True)
    return rows


def published_job(config: ModelConfig, dtype: str, batch: int) -> TwoHandsJob:
    """Job of the paper's recipe on a GPU."""
    params = replace(model_train.VLM, backbones=config.backbones, frozen_dtype=dtype, batch=batch, device="cuda")
    return model_train.training_job(params)


def on_gpu(scratch: Path, dtype: str) -> Iterator[tuple[str, int, int]]:
    """Kind of a run, and its planned and its measured bytes of torch on a GPU, of the random model."""
    from afford.training.train import train_job

    data, folder = write_set(scratch), write_small(scratch / dtype, getattr(torch, dtype))
    planned = plan_folder(folder / "model", read_config(folder / "model"), "", "cuda", 1).needed + WORKSPACE
    yield "predict", planned, most_on_gpu(lambda: Predictor(folder / "model", "cuda").predict(
        np.zeros((SIDE, SIDE, 3), np.uint8), "pour tea from the kettle"))  # fmt: skip
    for kind in KINDS:
        job = model_train.training_job(replace(settings(folder, dtype, kind), device="cuda"))
        (scratch / kind).mkdir()
        yield kind, plan_training(job, SAMPLES["train"], SAMPLES["val"]).needed + WORKSPACE, most_on_gpu(
            lambda job=job, kind=kind: train_job(job, tree("set", data), "vlm", Scratch(scratch / kind), 1))


def most_on_gpu(work: Callable[[], object]) -> int:
    """Largest memory in bytes that torch has on the GPU during a call."""
    gc.collect()
    torch.cuda.empty_cache()
    torch.cuda.reset_peak_memory_stats()
    work()
    return torch.cuda.max_memory_allocated()


def row(name: str, planned: int, figure: str) -> str:
    """Row with the GiB in a figure of benchmarks/gpu.json, if there is one."""
    found = re.search(r"([\d.]+) GiB", figure)
    ratio = f"{planned / GIB / float(found[1]):.2f}" if found else ""
    return f"| {name} | {planned / GIB:.1f} | {found[1] if found else ''} | {ratio} |"


def page(kept: dict[str, list[str]]) -> str:
    """Write the Markdown page."""
    small, missing = [row for part in SMALL for row in kept.get(part, [])], [part for part in PARTS if part not in kept]
    left = [textwrap.fill(f"Not measured: {'; '.join(missing)}.", 130), ""] if missing else []
    return "\n".join((
        "# Memory of large two-hand models, planned and measured", "",
        "Written by `benchmarks/bench_memory_plan.py`. What is counted: [checkpoints](../docs/checkpoints.md#memory).", "",
        f"Random model of 306 M parameters at {SIDE} px on a CPU, each run in a process of its own: anonymous memory and the",
        "mapped pages of the model's files. Trainings are of batch 2 with gradient checkpointing, unless named otherwise. GiB.", "",
        "| run | type | planned | measured | planned / measured |", "|---|---|--:|--:|--:|", *small, "",
        "Published sizes on a GPU, memory of torch alone (the context of CUDA takes about 0.6 GiB more), beside",
        "[measured figures](gpu.md). Trainings are the paper's recipe with gradient checkpointing. GiB.", "",
        "| run | planned | measured | planned / measured |", "|---|--:|--:|--:|", *kept.get(PUBLISHED, []), "", *left))


def main() -> None:
    """Measure the random model, plan the published sizes, write the page after each part."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("parts", nargs="*", default=PARTS, metavar="PART", help="; ".join(PARTS))
    parser.add_argument("--scratch", type=Path)
    parser.add_argument("--run", help="kind of a measured process")
    parser.add_argument("--dtype", default="")
    args = parser.parse_args()
    if args.run:
        run(args.run, args.scratch, args.dtype)
        return
    kept = json.loads(KEPT.read_text()) if KEPT.is_file() else {}
    with TemporaryDirectory(dir=args.scratch) as scratch:
        write_set(Path(scratch))
        for part in args.parts:
            kept[part] = published_rows(Path(scratch)) if part == PUBLISHED else [small_row(part, Path(scratch))]
            print("\n".join(kept[part]), flush=True)
            KEPT.write_text(json.dumps(kept, indent=1) + "\n")
            PAGE.write_text(page(kept))


if __name__ == "__main__":
    main()
