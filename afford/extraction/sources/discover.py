"""Discovery of the videos of a source folder: one file tree per video, from names and digests alone.

Discovery runs before any file is parsed, and digests only the files that the videos need. A source has one of three kinds:
`epic`, an EPIC-KITCHENS-100 / VISOR root; `own`, one video with masks and narrations; `bare`, one video without masks, or several
with EPIC's tables (docs/extraction/own-video.md). In an EPIC root, annotated videos with media become trees; those without media
are listed in `missing`, unreadable ones in `refused`. The media of a video are its video file, or else its frames: a tar or zip,
a folder, or VISOR's key frames alone.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass
from pathlib import Path

from afford.common.errors import SourceError
from afford.common.folders import DENSE, IMAGE_SUFFIXES, PACK_SUFFIXES, VIDEO_SUFFIXES, Entry, entries, refuse_link
from schemas.files import FileRef, FileTree

SPARSE = "GroundTruth-SparseAnnotations/"
DENSE_ENDING = "_interpolations"
TRUTH = "truth/"
CORRECTIONS = ("corrections.json", "correct.json")
"""tables of corrected contacts; the second is the name in VISOR-HOS"""
FRAME_MAPPING = "frame_mapping.json"
EXTRAS = (*CORRECTIONS, FRAME_MAPPING)
NO_PICTURES = ("flow", "flow_frames", "object_detection_images", "masks", "hand-objects", "meta_data")
"""folders of EPIC-KITCHENS whose files have the names of frames, but contain other data"""
Digest = Callable[[Path], str]


@dataclass(frozen=True)
class Refused:
    """A video that is present but unreadable, or links out of the source; other videos are not affected."""

    video_id: str
    reason: str
    """one sentence: file, expected, got, what to do"""


@dataclass(frozen=True)
class Source:
    """The videos of a source folder."""

    kind: str
    """epic, own, bare, or meshes (afford/surface/meshes/discover.py)"""
    name: str
    """name of the folder"""
    videos: tuple[FileTree, ...]
    """one tree per video, named by video id, with exactly the files that it needs"""
    truths: dict[str, FileTree]
    """video id -> the files of truth/<video id>/, with names relative to that folder"""
    missing: tuple[str, ...]
    """annotated videos without media"""
    refused: tuple[Refused, ...]
    """videos with a file that links out of the root or cannot be read"""


def discover(root: Path, digest: Digest, clips: Iterable[str] = ()) -> Source:
    """Discover the videos of `root`. SourceError for a missing folder, an unknown layout, or a refused file that all videos share.

    clips: the requested clips, all when empty; other videos are neither digested nor listed.
    """
    if not root.is_dir():
        raise SourceError(str(root), "a folder", "a file" if root.exists() else "nothing", "give the root of a source")
    found = entries(root)
    if any(entry.name.startswith((SPARSE, DENSE)) for entry in found):
        return _epic(root, found, digest, tuple(clips))
    if any(entry.top and entry.suffix == ".json" and entry.name not in EXTRAS for entry in found):
        return _own(root, found, digest)
    return _bare(root, found, digest, tuple(clips))


def _epic(root: Path, found: tuple[Entry, ...], digest: Digest, clips: tuple[str, ...]) -> Source:
    shared = [e for e in found if e.top and (e.name in EXTRAS or (e.suffix == ".csv" and e.name.startswith("EPIC_100")))]
    for entry in shared:
        refuse_link(entry)
    annotations, media = _select_clips(_annotations(found), clips), _media(found)
    present = {video: media.get(video) or _blocking_links(video, found) for video in annotations}
    groups = {video: [*shared, *annotations[video], *present[video]] for video in sorted(annotations) if present[video]}
    trees, refused = _trees(groups, digest)
    missing = tuple(sorted(video for video in annotations if not present[video]))
    if not trees and not refused:
        raise SourceError(str(root), "a video or frame folder for an annotated video", f"none of {', '.join(missing)}",
                          "put videos/<video id>.MP4 or rgb_frames/<video id>/*.jpg there")
    return Source("epic", root.resolve().name, trees, _truths(found, digest), missing, refused)


def _annotations(found: Iterable[Entry]) -> dict[str, list[Entry]]:
    """Find the sparse and dense annotation files by video id."""
    out: dict[str, list[Entry]] = {}
    for entry in found:
        if entry.name.startswith(SPARSE) and entry.suffix == ".json":
            out.setdefault(entry.stem, []).append(entry)
        if entry.name.startswith(DENSE) and entry.suffix in (".json", ".zip"):
            out.setdefault(entry.stem.removesuffix(DENSE_ENDING), []).append(entry)
    return out


def _select_clips(annotations: dict[str, list[Entry]], clips: tuple[str, ...]) -> dict[str, list[Entry]]:
    """Select the videos of the requested clips; all videos if none matches, so that the error can list them.

    The name of a clip is that of its video, with a suffix when the video is cut.
    """
    some = {video: files for video, files in annotations.items()
            if any(clip == video or clip.startswith(f"{video}_s") for clip in clips)}
    return some or annotations


def _media(found: Iterable[Entry]) -> dict[str, list[Entry]]:
    """Find the media by video id: the video file, or else frames in a tar or zip, a folder of images, or VISOR's key frames.

    Several files of the same type are resolved to the first by name.
    """
    videos: dict[str, list[Entry]] = {}
    packs: dict[str, list[Entry]] = {}
    frames: dict[str, list[Entry]] = {}
    keys: dict[str, list[Entry]] = {}
    for entry in found:
        folders = entry.name.split("/")[:-1]
        sparse = entry.name.startswith(SPARSE)
        if entry.name.startswith((TRUTH, DENSE)) or set(NO_PICTURES) & set(folders) or (sparse and "rgb_frames" not in folders):
            continue
        if entry.suffix in VIDEO_SUFFIXES:
            videos.setdefault(entry.stem, [entry])
        elif entry.is_pack:
            (keys if sparse else packs).setdefault(entry.stem, [entry])
        elif entry.suffix in IMAGE_SUFFIXES and not entry.top:
            images = (keys if sparse else frames).setdefault(entry.folder, [])
            if not images or images[0].path.parent == entry.path.parent:
                images.append(entry)
    return keys | frames | packs | videos


def _blocking_links(video: str, found: Iterable[Entry]) -> list[Entry]:
    """Find links out of the root that may contain the media of a video: links with its name, and links to folders."""
    return [e for e in found if e.leaves and (e.stem == video or (e.suffix == "" and not e.name.startswith(TRUTH)))][:1]


def _truths(found: Iterable[Entry], digest: Digest) -> dict[str, FileTree]:
    groups: dict[str, list[Entry]] = {}
    for entry in found:
        if entry.name.startswith(TRUTH) and entry.name.count("/") >= 2:
            groups.setdefault(entry.name.split("/")[1], []).append(entry)
    return {video: _tree(video, group, digest, f"{TRUTH}{video}/") for video, group in groups.items()}


def _own(root: Path, found: tuple[Entry, ...], digest: Digest) -> Source:
    video, media = _own_media(root, found)
    texts = [e for e in found if e.top and e.suffix in (".json", ".csv")]
    trees, refused = _trees({video: [*texts, *media]}, digest)
    return Source("own", root.resolve().name, trees, {}, (), refused)


def _bare(root: Path, found: tuple[Entry, ...], digest: Digest, clips: tuple[str, ...]) -> Source:
    """Discover videos without masks: the only one of a folder, or all of a root with EPIC's tables."""
    texts = [e for e in found if e.top and e.suffix == ".csv"]
    several = _select_clips(_media(found), clips) if any(e.name.startswith("EPIC_100") for e in texts) else {}
    media = several if len(several) > 1 else dict([_own_media(root, found)])
    trees, refused = _trees({video: [*texts, *media[video]] for video in sorted(media)}, digest)
    return Source("bare", root.resolve().name, trees, {}, (), refused)


def _own_media(root: Path, found: Iterable[Entry]) -> tuple[str, list[Entry]]:
    """Find the video id and media of an own folder: its only video file, or else its only folder, tar or zip of images."""
    videos = [e for e in found if e.suffix in VIDEO_SUFFIXES]
    packs = {e.stem: [e] for e in found if e.suffix in PACK_SUFFIXES}
    folders: dict[str, list[Entry]] = {e.stem: [e] for e in found if e.many}
    for entry in found:
        if entry.suffix in IMAGE_SUFFIXES:
            folders.setdefault(entry.folder or root.resolve().name, []).append(entry)
    choices = {e.stem: [e] for e in videos} or folders or packs
    if len(choices) != 1 or len(videos) > 1:
        got = ", ".join(sorted(e.name for e in videos) or sorted(folders)) or "none"
        raise SourceError(str(root), "exactly one video, or one folder of frame images", got, "see docs/extraction/own-video.md")
    return next(iter(choices.items()))


def _trees(groups: Mapping[str, list[Entry]], digest: Digest) -> tuple[tuple[FileTree, ...], tuple[Refused, ...]]:
    trees, refused = [], []
    for video, group in groups.items():
        try:
            trees.append(_tree(video, group, digest))
        except (SourceError, OSError) as error:
            refused.append(Refused(video, str(error)))
    return tuple(trees), tuple(refused)


def _tree(name: str, group: Iterable[Entry], digest: Digest, prefix: str = "") -> FileTree:
    members = sorted(group, key=lambda entry: entry.name)
    for entry in members:
        refuse_link(entry)
    return FileTree(name, tuple(
        FileRef(e.name.removeprefix(prefix), digest(e.path), 0 if e.many else e.path.stat().st_size, e.path) for e in members))
