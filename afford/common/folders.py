"""Files of a source folder, and packs of images: a tar, a zip or a large folder.

Folders are listed by name alone, and links that leave the folder are listed but never followed. A folder of many images is one
entry: 11.5 million frames are 700 entries. Packs are read in place and never unpacked. A frame of a pack has the name that it would
have if the pack were a folder, such as `P03/rgb_frames/P03_101.tar/frame_0000000157.jpg` (EPIC-KITCHENS-100 has one tar of frames
for each video, VISOR one zip of key frames).
"""

from __future__ import annotations

import os
import stat
import tarfile
import zipfile
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import islice
from pathlib import Path, PurePosixPath

from afford.common.bounded import ZIP_ERRORS, TooLargeError, read_member, reason
from afford.common.errors import SourceError
from schemas.files import FileRef, FileTree

VIDEO_SUFFIXES = (".mp4", ".mkv", ".mov", ".avi", ".webm", ".m4v", ".mpg", ".mpeg")
IMAGE_SUFFIXES = (".jpg", ".jpeg", ".png")
PACK_SUFFIXES = (".tar", ".zip")
"""archives of frames"""
DENSE = "Interpolations-DenseAnnotations/"
FEW = 500
"""images of a folder that are listed one by one; a larger folder is one entry, as a tar is"""


@dataclass(frozen=True)
class Entry:
    """File below the root of a source, or an entry that must not be opened.

    The second kind is a link that leaves the root, a named pipe, a socket or a device.
    """

    name: str
    """root-relative, with forward slashes"""
    path: Path
    leaves: bool
    """the entry must not be opened"""
    many: bool = False
    """a folder of more than `FEW` images"""
    odd: str = ""
    """kind of an entry that is neither file nor folder; reading it may never end"""

    @property
    def stem(self) -> str:
        """File name without folder and suffix."""
        return PurePosixPath(self.name).stem

    @property
    def is_pack(self) -> bool:
        """Return True for a pack of frames: a tar, a zip or a folder of many images."""
        return self.many or is_pack(self.name)

    @property
    def suffix(self) -> str:
        """Suffix in lower case, with its dot."""
        return PurePosixPath(self.name).suffix.lower()

    @property
    def folder(self) -> str:
        """Name of the folder of the file; '' at the top level."""
        return PurePosixPath(self.name).parent.name

    @property
    def top(self) -> bool:
        """True for a file in the root folder itself."""
        return "/" not in self.name


def media_of(files: FileTree) -> FileTree:
    """Return the files of a video that contain its images.

    Stages that decode frames get these files alone, so that an edited table or outline causes no new decoding.
    """
    suffixes = VIDEO_SUFFIXES + IMAGE_SUFFIXES
    return FileTree(files.name, tuple(
        f for f in files.files if PurePosixPath(f.name).suffix.lower() in suffixes or is_pack(f.name)))


def is_pack(name: str) -> bool:
    """Return True for a pack of frames by its name: a folder (no suffix), a tar or a zip."""
    suffix = PurePosixPath(name).suffix.lower()
    return (suffix == "" or suffix in PACK_SUFFIXES) and not name.startswith(DENSE)


def entries(root: Path) -> tuple[Entry, ...]:
    """List everything below `root` except hidden files, sorted by name. OSError when the folder cannot be listed."""
    real = root.resolve()
    return tuple(sorted(_walk(real, real, ""), key=lambda entry: entry.name))


def _walk(real: Path, folder: Path, prefix: str) -> Iterator[Entry]:
    with os.scandir(folder) as found:
        some = list(islice(found, FEW + 1))
        if prefix and len(some) > FEW and all(_is_image(item.name) and item.is_file() for item in some):
            yield Entry(prefix.removesuffix("/"), folder, leaves=False, many=True)
            return
        items = [item for item in (*some, *found) if not item.name.startswith(".")]
    for item in items:
        path = Path(item.path)
        target = Path(os.path.realpath(path)) if item.is_symlink() else path
        if target != path and not target.is_relative_to(real):
            yield Entry(prefix + item.name, path, leaves=True)
        elif not os.path.isdir(path):
            odd = "" if item.is_file(follow_symlinks=False) else _odd(path)
            yield Entry(prefix + item.name, path, leaves=bool(odd), odd=odd)
        elif target == path or not path.is_relative_to(target):
            yield from _walk(real, path, f"{prefix}{item.name}/")


def _odd(path: Path) -> str:
    """Return the kind of a special file that a path leads to, '' for a regular file and for a broken link."""
    try:
        mode = os.stat(path).st_mode
    except OSError:
        return ""
    if stat.S_ISREG(mode):
        return ""
    return "a named pipe" if stat.S_ISFIFO(mode) else "a socket" if stat.S_ISSOCK(mode) else "a device"


def _is_image(name: str) -> bool:
    return PurePosixPath(name).suffix.lower() in IMAGE_SUFFIXES


def refuse_link(entry: Entry) -> None:
    """Raise SourceError for an entry outside the source folder and for a special file."""
    if entry.odd:
        raise SourceError(entry.name, "a file", entry.odd, "put the file itself there, or remove it from the folder")
    if entry.leaves:
        raise SourceError(entry.name, "a file inside the source folder", f"a link to {entry.path.resolve()}",
                          "copy the file into the folder, or use the folder it lies in as the source")


BLOCK_BYTES = 512
MOST_BYTES = 1 << 28
"""bytes of one image: 16 bits and three channels of 44 megapixels without compression"""
PADDING_BYTES = 1 << 20
"""zeros that may follow the end of a tar; tar itself pads to 10 KiB"""
Span = tuple[int, int]
"""(offset, size) in the tar, in bytes"""


@dataclass(frozen=True)
class Pack:
    """Images of a pack, sorted by name."""

    names: tuple[str, ...]
    """names inside the pack, without a leading ./"""
    sizes: tuple[int, ...]
    """stored size in bytes"""
    spans: tuple[Span, ...]
    """place of each image in a tar; empty for other packs"""


def index_pack(path: Path) -> Pack:
    """List the images of a pack from its headers, central directory or folder listing.

    Raises ValueError for a truncated file or one of another kind.
    """
    find = _in_folder if path.is_dir() else _in_zip if path.suffix.lower() == ".zip" else _in_tar
    found = sorted(find(path))
    spans = tuple(span for _, span in found)
    return Pack(tuple(name for name, _ in found), tuple(size for _, size in spans), spans if find is _in_tar else ())


def pack_of(files: FileTree, frame: str) -> FileRef | None:
    """Return the pack that contains a frame of this name, None for a file of its own."""
    parents = {str(parent) for parent in PurePosixPath(frame).parents}
    return next((file for file in files.files if file.name in parents), None)


def read_pack(pack: FileRef, frames: Sequence[str], spans: Sequence[Span]) -> Iterator[bytes]:
    """Read frames of a pack by name, or by their span in a tar.

    Raises SourceError for a frame that cannot be read or states more than `MOST_BYTES`.
    """
    names = [frame.removeprefix(f"{pack.name}/") for frame in frames]
    if pack.path.is_dir():
        yield from (read_file(pack.path / name, name) for name in names)
    elif pack.path.suffix.lower() == ".zip":
        yield from _from_zip(pack, names)
    else:
        yield from _from_tar(pack, names, spans)


def _is_frame(name: str) -> bool:
    path = PurePosixPath(name)
    return path.suffix.lower() in IMAGE_SUFFIXES and not path.name.startswith(".")


def _in_folder(path: Path) -> Iterator[tuple[str, Span]]:
    with os.scandir(path) as found:
        for item in found:
            if _is_frame(item.name):
                yield item.name, (0, item.stat().st_size)


def _in_zip(path: Path) -> Iterator[tuple[str, Span]]:
    try:
        with zipfile.ZipFile(path) as archive:
            for item in archive.infolist():
                if _is_frame(item.filename):
                    yield item.filename.removeprefix("./"), (item.header_offset, item.file_size)
    except ZIP_ERRORS as error:
        raise ValueError(f"a zip that was cut short ({reason(error)})") from error


def _in_tar(path: Path) -> Iterator[tuple[str, Span]]:
    last = "its start"
    try:
        with tarfile.open(path, "r:") as archive:
            for item in archive:
                last = item.name
                if item.isreg() and _is_frame(item.name):
                    yield item.name.removeprefix("./"), (item.offset_data, item.size)
            end = archive.offset
    except tarfile.TarError as error:
        raise ValueError(f"a tar that was cut short after {last} ({error})") from error
    _check_end(path, end, last)


def _check_end(path: Path, end: int, last: str) -> None:
    """Check that a tar ends with blocks of zeros, and with at most PADDING_BYTES of them."""
    size = path.stat().st_size
    with path.open("rb") as stream:
        stream.seek(end)
        block = stream.read(BLOCK_BYTES)
    if len(block) < BLOCK_BYTES or any(block):
        raise ValueError(f"a tar that was cut short after {last}, at {size} bytes")
    if size - end > PADDING_BYTES:
        raise ValueError(f"a tar of {size} bytes with nothing but a gap after {last}")


def _from_zip(pack: FileRef, names: Sequence[str]) -> Iterator[bytes]:
    try:
        with zipfile.ZipFile(pack.path) as archive:
            places = {item.filename.removeprefix("./"): item for item in archive.infolist()}
            for name in names:
                yield read_member(archive, places[name], f"{pack.name}/{name}", MOST_BYTES)
    except SourceError:
        raise
    except ZIP_ERRORS as error:
        raise SourceError(pack.name, f"a zip with {names[0]}", reason(error), "get the file again") from error


def _from_tar(pack: FileRef, names: Sequence[str], spans: Sequence[Span]) -> Iterator[bytes]:
    with pack.path.open("rb") as stream:
        for name, (offset, size) in zip(names, spans, strict=True):
            _check_size(size, f"{pack.name}/{name}")
            stream.seek(offset)
            data = stream.read(size)
            if len(data) < size:
                raise SourceError(pack.name, f"{size} bytes of {name}", f"{len(data)}", "get the file again")
            yield data


def read_file(path: Path, name: str) -> bytes:
    """Read an image file; SourceError for one that is larger than `MOST_BYTES` or cannot be read."""
    try:
        _check_size(path.stat().st_size, name)
        return path.read_bytes()
    except OSError as error:
        raise SourceError(name, "an image that can be read", reason(error), "get the file again") from error


def _check_size(size: int, name: str) -> None:
    if size > MOST_BYTES:
        raise TooLargeError(name, f"an image of at most {MOST_BYTES >> 20} MiB", f"{size >> 20} MiB", "make it smaller")
