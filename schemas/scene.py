"""What a synthetic clip is asked to be, and the files that come of it."""

from __future__ import annotations

from dataclasses import dataclass

from schemas.files import FileTree
from schemas.spec import Schema, value


@dataclass(frozen=True)
class SceneSpec(Schema):
    """One clip to render. The same spec gives the same bytes."""

    video_id: str = value("EPIC-style id of the clip, e.g. P91_03")
    script: str = value("name of the choreography, e.g. 'pour', 'carry', 'open_jar'")
    setting: str = value("kitchen, workshop or desk")
    seed: int = value("seed of everything random in the clip")
    frames: int = value("length of the clip", default=121)
    key_gap: int = value("distance between annotated key frames", unit="frames", default=15)
    split: str = value("train or val", default="train")


@dataclass(frozen=True)
class RenderedClip(Schema):
    """A rendered clip as files: an EPIC/VISOR root of one video, and, apart, its ground truth (see `ClipTruth`)."""

    files: FileTree = value("videos/, GroundTruth-SparseAnnotations/, EPIC_100_*.csv, as in an EPIC root")
    truth: FileTree = value("truth/<video_id>/ of the same root")
