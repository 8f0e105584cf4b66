"""Parameters of every stage, by system, and the sources of a run."""

from __future__ import annotations

from dataclasses import dataclass, fields, replace
from typing import Any, NamedTuple

from maps.settings.extraction import Extraction
from maps.settings.grasping import Grasping
from maps.settings.rgbd import PRESETS as RGBD_PRESETS
from maps.settings.rgbd import Rgbd
from maps.settings.surface import Surface
from maps.settings.synthetic import Synthetic
from maps.settings.twohands import MODES, Twohands
from maps.settings.twohands import PRESETS as TWOHANDS_PRESETS
from schemas.files import FileTree
from schemas.scene import RenderedClip, SceneSpec


class Origin(NamedTuple):
    """Sources of a run: clips to render, or files on disk.

    `truth` is an empty tree where there is none; `bare` videos have no masks.
    """

    name: str
    specs: tuple[SceneSpec, ...] = ()
    videos: tuple[RenderedClip, ...] = ()
    cases: FileTree | None = None
    predictions: tuple[FileTree, ...] = ()
    dataset: FileTree | None = None
    meshes: tuple[FileTree, ...] = ()
    sequences: tuple[FileTree, ...] = ()
    actions: FileTree | None = None
    pictures: FileTree | None = None
    bare: bool = False
    motions: FileTree | None = None
    parts: tuple[tuple[str, Origin], ...] = ()
    """sources of each of several targets that run together"""

    def of(self, part: str) -> Origin:
        """Return the sources of one of several targets, or all of them when there is only one."""
        return dict(self.parts).get(part, self)


PRESETS = {**TWOHANDS_PRESETS, **RGBD_PRESETS}
"""(stage, parameter, value) -> defaults of all parameters of the stage when the parameter has this value"""
__all__ = ["MODES", "PRESETS", "SYSTEMS", "SYSTEM_OF", "Origin", "Settings"]


@dataclass(frozen=True)
class Settings:
    """Parameters of every stage, by system. A stage name occurs in one system only."""

    extraction: Extraction = Extraction()
    twohands: Twohands = Twohands()
    surface: Surface = Surface()
    grasping: Grasping = Grasping()
    rgbd: Rgbd = Rgbd()
    synthetic: Synthetic = Synthetic()
    weights: tuple[tuple[str, FileTree], ...] = ()
    """(stage, files) of every stage whose backend reads weights"""

    @classmethod
    def of(cls, **stages: Any) -> Settings:
        """Return the defaults with other parameters of some stages: `Settings.of(mask_densify=mask_densify.Params(radius=3))`."""
        return cls().with_stages(**stages)

    def with_stages(self, **stages: Any) -> Settings:
        """Return a copy with other parameters of some stages. Raises TypeError for an unknown stage."""
        unknown = stages.keys() - SYSTEM_OF.keys()
        if unknown:
            raise TypeError(f"Settings: expected names of stages, got {', '.join(sorted(unknown))}")
        changed = {system: {name: params for name, params in stages.items() if SYSTEM_OF[name] == system} for system in SYSTEMS}
        return replace(self, **{system: replace(getattr(self, system), **mine) for system, mine in changed.items() if mine})

    def params(self, stage: str) -> Any:
        """Return the parameters of a stage, whichever system has it."""
        return getattr(getattr(self, SYSTEM_OF[stage]), stage)


SYSTEMS: tuple[str, ...] = tuple(field.name for field in fields(Settings) if field.name != "weights")
SYSTEM_OF: dict[str, str] = {stage.name: system for system in SYSTEMS for stage in fields(getattr(Settings, system))}
"""stage -> system, in the order of both"""
