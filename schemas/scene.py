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
class StillSpec(Schema):
    """One room with things of its own, of which stills are rendered. The same spec gives the same bytes."""

    video_id: str = value("id of the set of stills, e.g. P81_03")
    setting: str = value("kitchen, workshop or desk")
    seed: int = value("seed of everything random in it")
    split: str = value("train, val or test")
    asks: str = value("known: things and verbs that training shows; new: what it never shows; any: both")
    layouts: int = value("how often the things are laid out anew")
    views: int = value("pictures of each layout")
    tasks: int = value("most tasks asked of one picture")


@dataclass(frozen=True)
class RenderedClip(Schema):
    """A video as files: an EPIC/VISOR root of one video, and, apart, its ground truth (see `ClipTruth`)."""

    files: FileTree = value("videos/, GroundTruth-SparseAnnotations/, EPIC_100_*.csv, as in an EPIC root")
    media: FileTree = value("those of `files` that hold pictures: the video file, or the frame images")
    truth: FileTree = value("truth/<video_id>/ of the same root")
