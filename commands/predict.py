"""The verb `predict`: predict hand regions for an image, a video or a folder of them."""

from __future__ import annotations

import json
import sys
import time
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any

from rich.console import Console
from rich.markup import escape
from rich.table import Table

from commands.errors import UsageError, unknown
from commands.progress import ProgressObserver, observer
from commands.session import STORE
from runner import Reason
from schemas.video import SIDES

if TYPE_CHECKING:
    from afford.twohands.model.model_folder import ModelFolder
    from afford.twohands.model.predictor import Predictor


@dataclass(frozen=True)
class Options:
    """Options besides the picture and the task."""

    out: Path
    model: Path | None = None
    hands: str = "auto"
    threshold: float | None = None
    all_hypotheses: bool = False
    every: int = 10
    batch: int | None = None
    device: str = "cpu"
    dtype: str = ""
    force: bool = False
    store: Path | None = None
    json: bool = False
    depth: Path | None = None
    intrinsics: Path | None = None
    focal_px: float | None = None
    rate_hz: float = 10.0
    frames: int = 10
    always: bool = False
    quick: bool = False


def usable(device: str) -> str:
    """Check the requested device. UsageError when it is not available."""
    if device not in ("cpu", "cuda"):
        raise unknown("--device", device, ("cpu", "cuda"))
    if device == "cuda":
        import torch

        if not torch.cuda.is_available():
            raise UsageError("--device cuda: torch finds no usable GPU; remove --device")
    return device


STAGE = "predict"
GPU_BATCH = 8
SHOWN = 20
"""predictions that are listed; the index has all"""


@dataclass
class BatchResult:
    """Predictions, failures and times of the pictures so far."""

    predictions: list[dict[str, Any]] = field(default_factory=list)
    failures: list[dict[str, str]] = field(default_factory=list)
    cpu_ms: float = 0.0
    wall_ms: float = 0.0


def predict(image: Path, task: str, options: Options) -> int:
    """Write masks, overlay and JSON of every picture.

    Returns 0 when all went well, 1 when a picture failed. UsageError for a wrong call. `commands.predict_sequence` serves
    models of sequences (`--model sor3d`, or a folder with such a model).
    """
    _check(task, options)
    from afford.common.video.inputs import find
    from afford.twohands.inference import Question, answer_all, picture_count
    from afford.twohands.prediction_files import claim_folder

    began, done = time.perf_counter(), BatchResult()
    question = Question(task.strip(), options.hands, options.threshold, looks=1 if options.quick else 2)
    try:
        sources = find(image)
        batch = options.batch or (1 if options.device == "cpu" else GPU_BATCH)
        model, predictor = open_model(options.model, options.store, options.device, options.dtype, batch, options.always,
                                      mirror=not options.quick)
        claim_folder(options.out, options.force)
    except (ValueError, OSError) as error:
        raise UsageError(str(error)) from error
    with observer(quiet=False) as shown:
        for source in sources:
            for _ in range(picture_count(source, options.every)):
                shown.planned(STAGE, source.name)
        shown.started(STAGE, sources[0].name, Reason("forced", model.name))
        for item in answer_all(predictor, sources, question, options.every, batch):
            _keep(item, model, options, done, shown)
    return _tell(_summary(question.task, model, options, done, time.perf_counter() - began), options)


def open_model(given: Path | None, store: Path | None, device: str, dtype: str = "",
               batch: int = 1, always: bool = False, mirror: bool = True) -> tuple[ModelFolder, Predictor]:  # fmt: skip
    """Open the model of `--model`, else the one that was trained last, else the shipped one.

    UsageError when there is no model, no such device, or too little memory for a batch.
    """
    from afford.models import shipped
    from afford.twohands.model import model_folder
    from afford.twohands.model.predictor import Predictor

    try:
        folder = given or model_folder.latest_model((store or STORE) / "models") or shipped.find_shipped(shipped.TWO_HANDS)
        if folder is None:
            raise UsageError(f"{(store or STORE) / 'models'}: no trained model there; run `make train` or give --model DIR")
        found = model_folder.find_model(folder)
        return found, Predictor(found.folder, usable(device), mirror=mirror, dtype=dtype, pictures=batch, always=always)
    except ValueError as error:
        raise UsageError(str(error)) from error


def _check(task: str, options: Options) -> None:
    from afford.twohands.model.hand_selection import HANDS

    if not task.strip():
        raise UsageError("TASK: give words such as \"pour tea from kettle\"")
    if options.hands not in HANDS:
        raise unknown("--hands", options.hands, HANDS)
    if options.threshold is not None and not 0 <= options.threshold < 1:
        raise UsageError(f"--threshold {options.threshold:g}: expected a probability, 0 or more and less than 1")
    alone = [name for name in ("depth", "intrinsics", "focal_px") if getattr(options, name) is not None]
    if alone:
        raise UsageError(f"--{alone[0].replace('_', '-')}: this model does not use depth; remove the option, or give --model sor3d")
    for name, value in (("every", options.every), ("batch", options.batch)):
        if value is not None and value < 1:
            raise UsageError(f"--{name} {value}: expected 1 or more")


def _keep(item: Any, model: ModelFolder, options: Options, done: BatchResult, shown: ProgressObserver) -> None:
    """Write a prediction, or note a failure."""
    from afford.twohands.inference import Refused
    from afford.twohands.prediction_files import brief, write_prediction

    if isinstance(item, Refused):
        _failed(item.source, item.message, done, shown)
        return
    try:
        folder = write_prediction(item, model, options.out, options.all_hypotheses)
    except (ValueError, OSError) as error:
        _failed(item.picture.source, str(error), done, shown)
        return
    done.predictions.append(brief(item, folder.relative_to(options.out).as_posix()))
    done.cpu_ms, done.wall_ms = done.cpu_ms + item.cpu_ms, done.wall_ms + item.wall_ms
    shown.finished(STAGE, item.picture.name, "ran", item.wall_ms / 1000, item.cpu_ms / 1000, "")


def _failed(source: str, message: str, done: BatchResult, shown: ProgressObserver) -> None:
    done.failures.append({"source": source, "message": message})
    shown.finished(STAGE, source, "failed", 0.0, 0.0, message)


def _summary(task: str, model: ModelFolder, options: Options, done: BatchResult, seconds: float) -> dict[str, Any]:
    """Object that `--json` prints and that predictions.json contains."""
    shown = max(len(done.predictions), 1)
    from afford.twohands.model.stand_ins import unknown_words, words_read_as
    from afford.twohands.prediction_files import looked_for

    return {"task": task, "unknown_words": unknown_words(model, task), "read_as": words_read_as(model, task),
            "looked_for": looked_for(model, task), "hands_asked": options.hands, "quick": options.quick,
            "model": {"name": model.name, "digest": model.digest}, "predictions": done.predictions,
            "failures": done.failures,
            "ms_per_image": {"cpu": round(done.cpu_ms / shown, 3), "wall": round(done.wall_ms / shown, 3)},
            "seconds": round(seconds, 3)}  # fmt: skip


def _tell(summary: dict[str, Any], options: Options) -> int:
    from afford.twohands.prediction_files import write_index

    write_index(options.out, summary)
    console = Console(stderr=True)
    table = Table("picture", "taxonomy", *SIDES, "there", box=None)
    for line in summary["predictions"][:SHOWN]:
        scores = [f"{line['scores'][side]:.2f}" if side in line["scores"] else "-" for side in SIDES]
        table.add_row(escape(line["folder"]), line["taxonomy"], *scores, f"{line['present']:.0%}" if line["present"] < 1 else "-")
    if summary["predictions"]:
        console.print(table)
    for line in summary["predictions"][:SHOWN]:
        if "answer" in line:
            found = "" if line["scores"] else "; it has no [SEG], so there is no region"
            console.print(f"answer for {escape(line['folder'])}: {escape(line['answer'])!r}{escape(found)}", highlight=False,
                          soft_wrap=True)  # fmt: skip
    absent = [line for line in summary["predictions"] if not line["region"] and line["present"] < 1]
    for line in absent[:SHOWN]:
        console.print(f"[yellow]no region[/] in {escape(line['folder'])}: what the task names is probably not there "
                      f"({line['present']:.0%}); --always gives one all the same", highlight=False, soft_wrap=True)  # fmt: skip
    if len(summary["predictions"]) > SHOWN:
        console.print(f"and {len(summary['predictions']) - SHOWN} more")
    if summary["read_as"]:
        pairs = escape(", ".join(f"{word} as {other}" for word, other in summary["read_as"].items()))
        console.print(f"[bold]read[/] {pairs}: words of the training that stand in", highlight=False, soft_wrap=True)
    if summary["looked_for"]:
        words = escape(", ".join(summary["looked_for"]))
        console.print(f"[bold]looked for[/] {words}: by the classifier of the image encoder; no training showed how people act on "
                      "it", highlight=False, soft_wrap=True)  # fmt: skip
    strange = [word for word in summary["unknown_words"] or () if word not in summary["looked_for"]]
    if strange:
        words = escape(", ".join(strange))
        console.print(f"[yellow]unknown words[/] {words}: this model was not trained with them, so the prediction goes by the "
                      "other words and the picture; words.json of the model has those that it knows",
                      highlight=False, soft_wrap=True)  # fmt: skip
    for failure in summary["failures"]:
        console.print(f"[red]failed[/] {escape(failure['message'])}", highlight=False, soft_wrap=True)
    cost = summary["ms_per_image"]
    console.print(f"model {escape(summary['model']['name'])} {summary['model']['digest'][:12]}, {cost['cpu']:.1f} ms CPU and "
                  f"{cost['wall']:.1f} ms an image", highlight=False)  # fmt: skip
    console.print(f"[bold]predictions[/] {escape(str(options.out))}", highlight=False, soft_wrap=True)
    if options.json:
        sys.stdout.write(json.dumps({**summary, "out": str(options.out)}, sort_keys=True) + "\n")
    return int(bool(summary["failures"]))
