"""Resolve the models that the settings name, once: local folders, or hub ids, which are downloaded if there is a network."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable
from pathlib import Path
from typing import Any

from afford.common.registry import block
from commands.backends import backends_of
from commands.errors import UsageError
from maps.settings import SYSTEM_OF, Settings
from schemas.files import FileTree
from stages.extraction.hand_detect import NO_NETWORK, TRAINED


def resolve_weights(chosen: Settings, digest: Callable[[Path], str], target: str = "") -> Settings:
    """Add the files of every model that a selected backend reads, and of the `backbones` of a training.

    The landmark networks, MobileSAM and the image encoder of `lite` are those of `make setup`, if they are there. `model` and
    `backbones` keep only a name, so that the location is not part of the key. UsageError when a model cannot be found.
    """
    found: dict[str, FileTree] = {}
    named: dict[str, Any] = {}
    networks = _landmark_networks(chosen.extraction.hand_landmarks.model, digest)
    if networks is not None:
        found["hand_landmarks"] = networks
        named["hand_landmarks"] = dataclasses.replace(chosen.extraction.hand_landmarks, model="")
    segment = _segment_networks(digest) if chosen.extraction.hand_detect.segment != NO_NETWORK else None
    if segment is not None:
        found["segment"] = segment
    training = chosen.twohands.model_train
    encoder = _image_encoder(digest) if training.variant == "lite" and not training.backbones else None
    if encoder is not None:
        found["model_train"] = encoder
    if training.start:
        found["start"] = _files("model_train.start", training.start, digest)
        named["model_train"] = dataclasses.replace(training, start=_label(training.start))
    held = chosen.extraction.hand_detect.held
    if held not in (NO_NETWORK, TRAINED):
        found["held"] = _files("hand_detect.held", held, digest)
        named["hand_detect"] = dataclasses.replace(chosen.extraction.hand_detect, held=_label(held))
    found |= _shipped(chosen, digest, target)
    people = chosen.grasping.human_motion
    if people.prior:
        found["prior"] = _files("human_motion.prior", people.prior, digest)
        named["human_motion"] = dataclasses.replace(people, prior=_label(people.prior))
    for stage in SYSTEM_OF:
        params = named.get(stage, chosen.params(stage))
        if getattr(params, "backbones", ""):
            found[stage] = _files(f"{stage}.backbones", params.backbones, digest)
            named[stage] = dataclasses.replace(params, backbones=_label(params.backbones))
        if getattr(params, "photographs", ""):
            found[stage] = _photographs(f"{stage}.photographs", params.photographs, digest)
            named[stage] = dataclasses.replace(params, photographs=_label(params.photographs))
        if not (_asked(params) and reads_weights(params)):
            continue
        name, own = params.backend, block(params, params.backend)
        if not own.model:
            raise UsageError(f"{stage}.backend={name} reads weights, but no model is named: add "
                             f"--set {stage}.{name}.model=MODEL, {_needs(stage, name)}")
        found[stage] = _files(f"{stage}.{name}.model", own.model, digest)
        named[stage] = dataclasses.replace(params, **{name: dataclasses.replace(own, model=_label(own.model))})
    return dataclasses.replace(chosen.with_stages(**named), weights=tuple(found.items()))


def _shipped(chosen: Settings, digest: Callable[[Path], str], target: str) -> dict[str, FileTree]:
    """Shipped models of a target by the stages that trained them; none where parameters of its training were set."""
    from afford.models.shipped import BODIES, PARTS, TEACHER, shipped_files

    scorer, teacher = (PARTS, ("scorer_train",)), (TEACHER, ("rl_grasp_refinement", "hand_imitation"))
    on_bodies = (teacher, (BODIES, ("body_refinement", *teacher[1])))
    served = {"negative-affordance": (scorer,), "grasp-play": (teacher,), "grasp-household": on_bodies,
              "grasp": (scorer, *on_bodies), "grasp-adapt": (scorer, *on_bodies)}  # fmt: skip
    found: dict[str, FileTree] = {}
    for name, stages in served.get(target, ()):
        if any(chosen.params(stage) != type(chosen.params(stage))() for stage in stages):
            continue
        try:
            files = shipped_files(name, digest)
        except ValueError as error:
            raise UsageError(str(error)) from error
        found |= {} if files is None else {f"shipped_{stages[0]}": files}
    return found


def reads_weights(params: Any) -> bool:
    """Return True when the selected backend of a stage declares WEIGHTS."""
    stage = type(params).__module__.rpartition(".")[2]
    chosen = getattr(params, "backend", "")
    return any(one.weights and one.name == chosen for one in backends_of(stage))


def _asked(params: Any) -> bool:
    """Return True when a model is named, or a backend other than the default is selected.

    The default backend without a model does not use one.
    """
    usual = next((field.default for field in dataclasses.fields(params) if field.name == "backend"), "")
    backend = getattr(params, "backend", "")
    return bool(getattr(block(params, backend), "model", "")) or backend != usual


def _needs(stage: str, backend: str) -> str:
    return next(one.weights for one in backends_of(stage) if one.name == backend)


def _files(parameter: str, model: str, digest: Callable[[Path], str]) -> FileTree:
    from afford.models.weights import weight_files

    try:
        return weight_files(model, digest)
    except ValueError as error:
        raise UsageError(f"{parameter}: {error}") from error


def _landmark_networks(folder: str, digest: Callable[[Path], str]) -> FileTree | None:
    from afford.extraction.landmarks.files import landmark_files

    try:
        return landmark_files(digest, folder)
    except ValueError as error:
        raise UsageError(f"hand_landmarks.model: {error}") from error


def _segment_networks(digest: Callable[[Path], str]) -> FileTree | None:
    from afford.extraction.prompted.files import segment_files

    return segment_files(digest)


def _image_encoder(digest: Callable[[Path], str]) -> FileTree | None:
    from afford.models.encoder_place import encoder_files

    return encoder_files(digest)


def _photographs(parameter: str, folder: str, digest: Callable[[Path], str]) -> FileTree:
    from afford.common.photographs import photograph_files

    try:
        return photograph_files(Path(folder).expanduser().absolute(), digest)
    except ValueError as error:
        raise UsageError(f"{parameter}: {error}") from error


def _label(model: str) -> str:
    """Name of a model: a hub id unchanged, the last part of a path."""
    return Path(model).absolute().name if Path(model).expanduser().exists() else model
