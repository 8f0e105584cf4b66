"""Provenance of a recording as metadata: names, content digests and parameters, never a clock or a path."""

from __future__ import annotations

import json
from dataclasses import replace
from typing import Any

from afford.codecs.kinds import digest, kind_of, schema_version
from afford.recording.mcap_files import Recording
from schemas.episodes import GraspEpisodes
from schemas.files import FileTree
from schemas.hand import HandModel
from schemas.mesh import ObjectViews
from schemas.surface import NegativeAffordances
from schemas.video import Clip, Frames

Parameters = tuple[tuple[str, str], ...]
"""(stage, its parameters as a JSON object) for every stage that a recording shows"""


def with_parameters(recording: Recording, parameters: Parameters) -> Recording:
    """Add a metadata record `parameters/<stage>` for each stage: parameter -> value as JSON."""
    more = {f"parameters/{stage}": {name: json.dumps(value, sort_keys=True) for name, value in json.loads(text).items()}
            for stage, text in parameters}  # fmt: skip
    return replace(recording, metadata={**recording.metadata, **more})


def of_value(recording: Recording, stage: str, value: Any, one_of: str = "") -> Recording:
    """Add a metadata record `provenance/<stage>` about a named value.

    The name is `provenance/<stage>/<one_of>` when the recording shows several values of a stage.
    """
    kind = kind_of(value)
    record = {"stage": stage, "name": value.name, "schema": kind, "schema_version": schema_version(kind),
              "artifact": digest(value)}  # fmt: skip
    name = f"provenance/{stage}/{one_of}" if one_of else f"provenance/{stage}"
    return replace(recording, metadata={**recording.metadata, name: record})


def with_provenance(recording: Recording, stage: str, value: Any, frames: Frames) -> Recording:
    """Add a metadata record `provenance/<stage>`; `pipeline.py lineage` takes its `artifact`."""
    kind = kind_of(value)
    record = {"stage": stage, "clip_id": value.clip_id, "schema": kind, "schema_version": schema_version(kind),
              "artifact": digest(value), "frames": digest(frames)}  # fmt: skip
    return replace(recording, metadata={**recording.metadata, f"provenance/{stage}": record})


def of_files(recording: Recording, stage: str, files: FileTree) -> Recording:
    """Add a metadata record `provenance/<stage>` about a tree of files."""
    kind = kind_of(files)
    record = {"stage": stage, "files": files.name, "schema": kind, "schema_version": schema_version(kind),
              "artifact": digest(files)}  # fmt: skip
    return replace(recording, metadata={**recording.metadata, f"provenance/{stage}": record})


def of_object(recording: Recording, views: ObjectViews, found: NegativeAffordances) -> Recording:
    """Add a metadata record `provenance/<stage>` of each value of an object's recording."""
    more = {}
    for stage, value in (("view_render", views), ("negative_affordance_projection", found)):
        kind = kind_of(value)
        more[f"provenance/{stage}"] = {"stage": stage, "object": views.name, "schema": kind, "schema_version": schema_version(kind),
                                       "artifact": digest(value)}  # fmt: skip
    return replace(recording, metadata={**recording.metadata, **more})


def of_clip(clip: Clip) -> dict[str, dict[str, str]]:
    """Metadata record `provenance` of a clip's recording."""
    record = {"clip_id": clip.clip_id, "video_id": clip.video_id, "participant_id": clip.participant_id, "split": clip.split,
              "fps": repr(clip.fps), "first_frame": str(clip.first_frame), "last_frame": str(clip.last_frame),
              "key_frames": " ".join(str(key.frame) for key in clip.key_frames), "artifact": digest(clip),
              "log_time": "2020-01-01T00:00:00Z + media time"}  # fmt: skip
    warnings = {f"{i:04d}": text for i, text in enumerate(clip.warnings)}
    return {"provenance": record} | ({"warnings": warnings} if warnings else {})


def of_grasps(recording: Recording, episodes: GraspEpisodes, hand: HandModel) -> Recording:
    """Add a metadata record `provenance/<stage>` of each value of a recording of grasps."""
    return of_value(of_value(recording, "grasp_evaluate", episodes), "hand_model", hand)
