"""Summary of a video before a run: clips, masks, contacts and narrations, read as in `source_read`, without decoding frames."""

from __future__ import annotations

from collections import Counter
from dataclasses import dataclass, field

from afford.common.bounded import image_size
from afford.common.errors import SourceError
from afford.common.video.frames import pictures
from afford.extraction.sources.cut import Cutting
from afford.extraction.sources.hand_names import side_of
from afford.extraction.sources.key_frames import has_masks, read_annotated_images
from afford.extraction.sources.media import Media
from afford.extraction.sources.read import clips_of, media_of_video
from afford.extraction.sources.remarks import Size, aspect_remark, no_hands_remark
from schemas.files import FileTree
from schemas.video import NOT_IN_CONTACT, UNKNOWN_CONTACT, Annotation, Clip, KeyFrame, Narration


@dataclass(frozen=True)
class Category:
    """Masks of one name, as written in the source."""

    name: str
    role: str
    """left hand, right hand, glove or object"""
    masks: int


@dataclass
class VideoSummary:
    """Summary of one video of a source."""

    video: str
    media: str = ""
    """the video file, or the first image"""
    frames: int = 0
    """frames that exist"""
    fps: float = 0.0
    size_wh: Size = (0, 0)
    """width and height of its pictures, px"""
    grids: tuple[Size, ...] = ()
    """sizes that its masks refer to, px"""
    clips: tuple[Clip, ...] = ()
    categories: tuple[Category, ...] = ()
    contacts: dict[str, Counter[str]] = field(default_factory=dict)
    """hand -> touches a mask, touches nothing, inconclusive, not given: number of manually annotated key frames"""
    narrations: tuple[Narration, ...] = ()
    """narrations of all clips"""
    warnings: tuple[str, ...] = ()
    refusal: str = ""
    """reason why it cannot be used, one sentence; '' for a usable video"""


def examine(files: FileTree, cutting: Cutting, still_fps: float) -> VideoSummary:
    """Read one video; an error is stored in `refusal`, not raised."""
    found = VideoSummary(files.name)
    try:
        media = media_of_video(files, still_fps)
        found.media, found.frames, found.fps = media.names[0], len(media.numbers), media.fps
        _fill(found, files, media, cutting)
    except (SourceError, OSError) as error:
        found.refusal = str(error)
    return found


def _fill(found: VideoSummary, files: FileTree, media: Media, cutting: Cutting) -> None:
    found.categories = _categories(files, media) if has_masks(files) else ()
    found.clips = clips_of(files, media, cutting)
    found.size_wh = media.size_wh or _first_size(files, found.clips[0])
    keys = list({key.frame: key for clip in found.clips for key in clip.key_frames}.values())
    found.grids = tuple(sorted({(key.width_px, key.height_px) for key in keys}))
    found.contacts = _contacts(keys)
    found.narrations = tuple({n.narration_id: n for clip in found.clips for n in clip.narrations}.values())
    remarks = [aspect_remark([(key.width_px, key.height_px) for key in keys], found.size_wh),
               no_hands_remark((mask.side, mask.name) for key in keys for mask in key.annotations)]  # fmt: skip
    warnings = [text for clip in found.clips for text in clip.warnings] + [remark for remark in remarks if remark]
    found.warnings = tuple(dict.fromkeys(warnings))


def _first_size(files: FileTree, clip: Clip) -> Size:
    """Read the size of the first image of a clip from its header."""
    return image_size(next(pictures(files, clip)), clip.media[0])


def _categories(files: FileTree, media: Media) -> tuple[Category, ...]:
    rows = [row for annotated, _ in read_annotated_images(files, [], media.names).values() for row in annotated.rows]
    roles = {row.name: _role(row.name, bool(row.worn)) for row in rows}
    counts = Counter(row.name for row in rows)
    ordered = sorted(counts, key=lambda name: (roles[name] == "object", -counts[name], name))
    return tuple(Category(name, roles[name], counts[name]) for name in ordered)


def _role(name: str, worn: bool) -> str:
    side = side_of(name)
    return f"{side} hand" if side else "glove" if worn else "object"


def _contacts(keys: list[KeyFrame]) -> dict[str, Counter[str]]:
    counts: dict[str, Counter[str]] = {}
    for key in keys:
        for mask in key.annotations if not key.dense else ():
            if mask.side:
                counts.setdefault(mask.name, Counter())[_contact(mask)] += 1
    return counts


def _contact(hand: Annotation) -> str:
    if hand.contact in NOT_IN_CONTACT:
        return "touches nothing"
    if hand.contact in UNKNOWN_CONTACT:
        return hand.contact or "not given"
    return "touches a mask"
