"""The verb `check`: show how `run` would read a source. Nothing is written, and no model is used."""

from __future__ import annotations

import json
import sys
from collections.abc import Iterator, Sequence
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Any

from rich.console import Console
from rich.markup import escape

from afford.common.errors import SourceError
from afford.common.folders import VIDEO_SUFFIXES, entries
from afford.extraction.sources.cut import Cutting
from afford.extraction.sources.discover import discover
from afford.extraction.sources.examine import VideoSummary, examine
from afford.surface.meshes.read import is_mesh
from afford.surface.meshes.surface import URDF
from commands.errors import UsageError, unknown
from commands.settings import settings
from maps.settings import Settings

SHOWN = 6
"""clips, categories and narrations listed for a video; --json lists all"""
Refusals = list[tuple[str, str]]
"""(video or object, reason), one sentence each"""


@dataclass
class SourceReport:
    """A source as `run` would read it."""

    source: str
    kind: str
    """epic, own, bare or meshes; '' for a folder that is not a source"""
    videos: list[VideoSummary] = field(default_factory=list)
    meshes: list[dict[str, Any]] = field(default_factory=list)
    missing: list[str] = field(default_factory=list)
    """annotated videos without media"""
    refused: Refusals = field(default_factory=list)

    @property
    def ok(self) -> bool:
        """True when all of the source is usable."""
        return not self.refused


def check(root: Path, clips: Sequence[str], sets: Sequence[str], as_json: bool) -> int:
    """Show a source.

    Returns 0 when all of it is usable, 1 when a part is refused. UsageError when `root` is not a folder.
    """
    if not root.is_dir():
        got = "is a file" if root.exists() else "does not exist"
        raise UsageError(f"{root} {got}; give the folder of a source, see docs/extraction/own-video.md")
    found = _checked(root, clips, settings(sets, None))
    if as_json:
        sys.stdout.write(json.dumps(_tree(found), sort_keys=True) + "\n")
    else:
        console = Console()
        for line in _lines(found):
            console.print(line, highlight=False, soft_wrap=True)
    return int(not found.ok)


def _checked(root: Path, clips: Sequence[str], chosen: Settings) -> SourceReport:
    try:
        return _meshes(root) if _holds_meshes(root) else _videos(root, clips, chosen)
    except (SourceError, OSError) as error:
        return SourceReport(str(root), "", refused=[(root.resolve().name, str(error).removeprefix(f"{root}: "))])


def _videos(root: Path, clips: Sequence[str], chosen: Settings) -> SourceReport:
    source, read = discover(root, _unread, clips), chosen.extraction.source_read
    cutting = Cutting(read.max_gap_s, read.max_still_gap_s, read.max_frames, read.margin_frames)
    videos = [examine(files, cutting, read.still_fps) for files in source.videos]
    _check_clips(clips, videos)
    refused = [(one.video_id, one.reason) for one in source.refused]
    refused += [(one.video, one.refusal) for one in videos if one.refusal]
    return SourceReport(str(root), source.kind, videos, missing=list(source.missing), refused=refused)


def _check_clips(clips: Sequence[str], videos: Sequence[VideoSummary]) -> None:
    names = [name for video in videos for name in (video.video, *(clip.clip_id for clip in video.clips))]
    for clip in clips:
        if clip not in names:
            raise unknown("clip", clip, names)


def _unread(path: Path) -> str:
    """Empty digest, since no content is stored."""
    return ""


def _holds_meshes(root: Path) -> bool:
    found = entries(root)
    return any(is_mesh(e.name) or e.suffix == URDF for e in found) and not any(e.suffix in VIDEO_SUFFIXES for e in found)


def _meshes(root: Path) -> SourceReport:
    from afford.surface.meshes.discover import discover as find
    from afford.surface.meshes.read import read_surface

    source, checked = find(root, _unread), SourceReport(str(root), "meshes")
    checked.refused += [(one.name, one.reason) for one in source.refused]
    for files in source.objects:
        try:
            surface = read_surface(files)
        except (SourceError, OSError) as error:
            checked.refused.append((files.name, str(error)))
            continue
        sides = (surface.vertices.max(axis=0) - surface.vertices.min(axis=0)).tolist()
        checked.meshes.append({"object": files.name, "files": [file.name for file in files.files], "size": sides,
                               "vertices": len(surface.vertices), "triangles": len(surface.faces)})  # fmt: skip
    return checked


# -- output ------------------------------------------------------------------------------------------------------------


def _lines(found: SourceReport) -> Iterator[str]:
    kinds = {"epic": "an EPIC-KITCHENS / VISOR root", "own": "a video with masks", "bare": "video without masks",
             "meshes": "meshes", "": "not a source"}  # fmt: skip
    yield f"[bold]{escape(found.source)}[/]: {kinds[found.kind]}"
    for video in found.videos:
        yield from _of_video(video)
    for mesh in found.meshes:
        size = " x ".join(f"{side:.4g}" for side in mesh["size"])
        yield f"[bold]{escape(mesh['object'])}[/] {mesh['vertices']} vertices, {mesh['triangles']} triangles, {size} in its unit"
    if found.missing:
        yield f"no video for {len(found.missing)} annotated video(s): {escape(_some(found.missing))}"
    for name, why in found.refused:
        yield f"[red]refused[/] {escape(f'{name}: {why}')}"
    usable = sum(not video.refusal for video in found.videos) + len(found.meshes)
    warnings = sum(len(video.warnings) for video in found.videos)
    yield f"{usable} usable, {len(found.refused)} refused, {warnings} warning(s)"


def _of_video(video: VideoSummary) -> Iterator[str]:
    size = f"{video.size_wh[0]}x{video.size_wh[1]}, " if video.size_wh[0] else ""
    yield escape(f"{video.video}: {video.media or 'unreadable'}, {size}{video.frames} frames at {video.fps:g} a second")
    clips = [f"{clip.clip_id} ({clip.first_frame} to {clip.last_frame}, {len(clip.key_frames)} key frames)" for clip in video.clips]
    if clips:
        yield escape(f"  clips       {len(clips)}: {_some(clips)}")
    if video.categories:
        grids = " and ".join(f"{width}x{height}" for width, height in video.grids)
        named = _some([_category(one) for one in video.categories])
        yield escape(f"  masks       {named}" + (f"; drawn on {grids}" if grids else ""))
    elif video.clips:
        yield "  masks       none: hands will be detected (hand_detect)"
    for hand, counts in sorted(video.contacts.items()):
        yield escape(f"  {hand:<11} {', '.join(f'{kind} in {count}' for kind, count in counts.most_common())}")
    if video.clips:
        narrations = [f"{n.text!r} ({n.start_frame} to {n.stop_frame}): {n.verb}, {n.noun}" for n in video.narrations]
        yield escape(f"  narrations  {len(narrations)}" + (f": {_some(narrations)}" if narrations else ""))
    yield from (f"  [yellow]warning[/]     {escape(text)}" for text in video.warnings)


def _category(one: Any) -> str:
    return f"{one.name} {one.masks}" + ("" if one.name == one.role else f" ({one.role})")


def _some(words: Sequence[str]) -> str:
    return "; ".join(words[:SHOWN]) + (f"; and {len(words) - SHOWN} more" if len(words) > SHOWN else "")


def _tree(found: SourceReport) -> dict[str, Any]:
    return {"source": found.source, "kind": found.kind, "ok": found.ok, "missing": found.missing, "meshes": found.meshes,
            "refused": [{"name": name, "reason": why} for name, why in found.refused],
            "videos": [_branch(video) for video in found.videos]}  # fmt: skip


def _branch(video: VideoSummary) -> dict[str, Any]:
    clips = [{"clip": clip.clip_id, "first_frame": clip.first_frame, "last_frame": clip.last_frame,
              "key_frames": [key.frame for key in clip.key_frames]} for clip in video.clips]  # fmt: skip
    return {"video": video.video, "media": video.media, "frames": video.frames, "fps": video.fps, "size": list(video.size_wh),
            "grids": [list(grid) for grid in video.grids], "clips": clips, "warnings": list(video.warnings),
            "categories": [asdict(one) for one in video.categories], "refusal": video.refusal,
            "contacts": {hand: dict(counts) for hand, counts in video.contacts.items()},
            "narrations": [asdict(n) for n in video.narrations]}  # fmt: skip
