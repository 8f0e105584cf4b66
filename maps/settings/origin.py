"""What a run is made of."""

from __future__ import annotations

from typing import NamedTuple

from schemas.files import FileTree
from schemas.scene import RenderedClip, SceneSpec


class Origin(NamedTuple):
    """Where the videos come from: clips to render, or what is on disk (`truth` is an empty tree where there is none; `bare` videos
    have no masks).
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
    """of several targets that are made together: what each is made of"""

    def of(self, part: str) -> Origin:
        """What one of several targets is made of; all of it where there is one alone."""
        return dict(self.parts).get(part, self)
