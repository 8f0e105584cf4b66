"""Input images of predictions: an image, a video, or a folder of both at any depth."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path, PurePosixPath

from afford.common.errors import SourceError
from afford.common.files import RECORD
from afford.common.folders import IMAGE_SUFFIXES, VIDEO_SUFFIXES, entries
from afford.common.image_files import Picture, read_image
from afford.common.video.frames import every_nth

IMAGES = (*IMAGE_SUFFIXES, ".webp", ".bmp", ".tif", ".tiff")


@dataclass(frozen=True)
class Source:
    """Image or video file of a prediction."""

    path: Path
    name: str
    """unique among the sources of a call: path below the folder without suffix, or with suffix where stems collide"""

    @property
    def is_video(self) -> bool:
        """True for a video, by its suffix."""
        return self.path.suffix.lower() in VIDEO_SUFFIXES


def find(path: Path) -> list[Source]:
    """List the images and videos at a path: the file itself, or every one below a folder, sorted.

    Hidden files, links that leave the folder and output of earlier predictions are skipped. Raises SourceError when nothing is
    left.
    """
    if not path.is_dir():
        if not path.exists():
            raise SourceError(str(path), "an image, a video or a folder of them", "nothing there", "check the path")
        return [Source(path, path.stem)]
    known = IMAGES + VIDEO_SUFFIXES
    listed = [(PurePosixPath(entry.name), entry) for entry in entries(path)]
    written = {name.parent for name, _ in listed if name.name == RECORD}
    found = [name for name, entry in listed if entry.suffix in known and not entry.leaves and not written & set(name.parents)]
    if not found:
        raise SourceError(str(path), f"images or videos ({', '.join(known)}) at any depth", "no such file", "give another folder")
    stems = Counter(name.with_suffix("") for name in found)
    stems.update({folder for name in found for folder in name.parents})
    return [Source(path / name, str(name if stems[name.with_suffix("")] > 1 else name.with_suffix(""))) for name in found]


def pictures(source: Source, every: int) -> Iterator[Picture]:
    """Yield the image, or frames 1, 1 + every, ... of the video. SourceError for an unreadable file."""
    if not source.is_video:
        yield Picture(source.name, str(source.path), read_image(source.path))
        return
    count = 0
    try:
        for number, time_s, rgb in every_nth(source.path, every):
            count += 1
            yield Picture(f"{source.name}/frame_{number:07d}", str(source.path), rgb, number, time_s)
    except (ValueError, OSError) as error:
        raise SourceError(str(source.path), "a video that can be read", str(error), "get the file again") from error
    if not count:
        raise SourceError(str(source.path), "a video with frames", "none that can be decoded", "get the file again")
