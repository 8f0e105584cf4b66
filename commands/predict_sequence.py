"""The verb `predict` for models of sequences (SOR3D-AFF): affordances of one RGB-D sequence, video or picture."""

from __future__ import annotations

import json
import sys
import time
from dataclasses import fields
from pathlib import Path
from typing import TYPE_CHECKING, Any

from rich.console import Console
from rich.markup import escape

from commands.errors import UsageError
from commands.predict import Options, usable
from commands.session import STORE

if TYPE_CHECKING:
    from afford.rgbd.footage import Footage
    from afford.rgbd.model.predictor import Predictor
    from afford.twohands.model.model_folder import ModelFolder
    from schemas.interaction import SceneFlow

NAME = "sor3d"
ALIEN = ("hands", "all_hypotheses", "always", "quick", "every", "batch", "dtype")
"""options that do not apply to a model of sequences"""


def is_sequence_model(model: Path | None) -> bool:
    """Return True when `--model` names a model of sequences: by the word, or by the config of a folder."""
    if model is None:
        return False
    from afford.rgbd.model.checkpoint import FORMAT
    from afford.twohands.model.model_folder import format_of

    return str(model) == NAME or format_of(model) == FORMAT


def predict(path: Path, task: str, options: Options) -> int:
    """Write the prediction for one sequence.

    Returns 0, or 1 when the sequence cannot be read. UsageError for a wrong call.
    """
    _check(path, task, options)
    from afford.rgbd.footage import Lens, Sampling, read_footage
    from afford.rgbd.prediction import write_prediction
    from afford.twohands.prediction_files import claim_folder, write_index

    stored, predictor = open_model(options)
    try:
        claim_folder(options.out, options.force)
    except (ValueError, OSError) as error:
        raise UsageError(str(error)) from error
    predictions, failures = [], []
    try:
        lens, sampling = Lens(options.intrinsics, options.focal_px), Sampling(options.rate_hz, options.frames)
        footage = read_footage(path, options.depth, lens, sampling, predictor.config.size_px)
        folder = write_prediction(_predicted(path, footage, predictor, options), stored, options.out / path.stem)
        predictions.append({"source": str(path), "folder": folder.name})
    except (ValueError, OSError) as error:
        failures.append({"source": str(path), "message": str(error)})
    summary: dict[str, Any] = {"model": {"name": stored.name, "digest": stored.digest}, "predictions": predictions,
                               "failures": failures}  # fmt: skip
    write_index(options.out, summary)
    _tell(summary, options)
    return int(bool(failures))


def open_model(options: Options) -> tuple[ModelFolder, Predictor]:
    """Open the model of `--model`; for the word sor3d, the one that was trained last, else the shipped one.

    UsageError when there is none.
    """
    from afford.models import shipped
    from afford.rgbd.model.checkpoint import FORMAT
    from afford.rgbd.model.predictor import Predictor
    from afford.twohands.model.model_folder import find_model, latest_model

    models = (options.store or STORE) / "models"
    try:
        named = str(options.model) == NAME
        folder = latest_model(models, FORMAT) or shipped.find_shipped(shipped.SOR3D) if named else options.model
        if folder is None:
            raise UsageError(f"{models}: no model of `run sor3d` there; run it first or give --model DIR")
        found = find_model(folder)
        return found, Predictor(found.folder, usable(options.device))
    except ValueError as error:
        raise UsageError(str(error)) from error


def _check(path: Path, task: str, options: Options) -> None:
    usual = {field.name: field.default for field in fields(options)}
    if task.strip():
        raise UsageError(f"TASK {task!r}: model sor3d takes no task; remove it")
    for name in ALIEN:
        if getattr(options, name) != usual[name]:
            raise UsageError(f"--{name.replace('_', '-')}: model sor3d does not have this option; remove it")
    if options.threshold is not None and not 0 <= options.threshold < 1:
        raise UsageError(f"--threshold {options.threshold:g}: expected a probability, 0 or more and less than 1")
    if options.rate_hz <= 0 or options.frames < 1:
        raise UsageError(f"--rate-hz {options.rate_hz:g} --frames {options.frames}: expected more than 0, and 1 or more")
    if options.focal_px is not None and options.focal_px <= 0:
        raise UsageError(f"--focal-px {options.focal_px:g}: expected more than 0; give the focal length in pixels")
    for given in (path, options.depth, options.intrinsics):
        if given is not None and not given.exists():
            raise UsageError(f"{given}: no such file or folder; check the path")


def _predicted(path: Path, footage: Footage, predictor: Predictor, options: Options) -> Any:
    """Prediction with its cost, motion included."""
    from afford.rgbd.prediction import CONFIDENT, SequencePrediction

    wall, cpu = time.perf_counter(), time.process_time()
    flow = _flow(footage, predictor.config.flow)
    found = predictor.predict(predictor.inputs_of_clip(footage.clip, flow))
    costs = 1000 * (time.process_time() - cpu), 1000 * (time.perf_counter() - wall)
    config = predictor.config
    if not footage.has_depth and (config.depth or config.flow == "3d"):
        unseen = "depth and motion" if config.flow == "3d" else "depth"
        Console(stderr=True).print(f"[yellow]no depth[/] only colours are used; this model also uses {unseen}: give --depth")
    threshold = CONFIDENT if options.threshold is None else options.threshold
    return SequencePrediction(str(path), footage, found, config.flow if flow is not None else "none", threshold, *costs)


def _flow(footage: Footage, kind: str) -> SceneFlow | None:
    """Motion as the stage computes it: scene flow with depth, optical flow without; None for a single picture."""
    from stages.rgbd import scene_flow

    if len(footage.clip.rgb) < 2 or kind == "none" or (kind == "3d" and not footage.has_depth):
        return None
    return scene_flow.run(footage.clip, scene_flow.Params())


def _tell(summary: dict[str, Any], options: Options) -> None:
    console = Console(stderr=True)
    for one in summary["predictions"]:
        found = json.loads((options.out / one["folder"] / "prediction.json").read_text(encoding="utf-8"))
        action = found["action"]["label"]
        regions = [f"{name} {part['area_share']:.1%}" for name, part in found["affordances"].items() if part["area_px"]]
        console.print(f"{escape(one['folder'])}: action {action} ({found['action']['probabilities'][action]:.2f}); affords "
                      f"{', '.join(regions) or 'nothing'}", highlight=False, soft_wrap=True)  # fmt: skip
    for failure in summary["failures"]:
        console.print(f"[red]failed[/] {escape(failure['message'])}", highlight=False, soft_wrap=True)
    console.print(f"[bold]predictions[/] {escape(str(options.out))}", highlight=False, soft_wrap=True)
    if options.json:
        sys.stdout.write(json.dumps({**summary, "out": str(options.out)}, sort_keys=True) + "\n")
