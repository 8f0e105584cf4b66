"""Bounded reading: check the sizes that a file states before anything is decoded, decompressed or allocated.

A small file can state, or unpack to, gigabytes. Every function of this module reads the header first and raises TooLargeError
beyond a limit. Memory is allocated only for what the file contains.
"""

from __future__ import annotations

import io
import lzma
import math
import struct
import tokenize
import warnings
import zipfile
import zlib
from collections.abc import Callable, Iterable
from pathlib import Path
from typing import TYPE_CHECKING, Any, BinaryIO, NamedTuple

from afford.common.errors import SourceError

if TYPE_CHECKING:
    import numpy as np

MAX_PIXELS = 64_000_000
"""pixels of one image: more than any camera records today; 16 bits a pixel decode to 128 MB, 8-bit RGB to 192 MB"""
MAX_ARRAY_BYTES = 8 * MAX_PIXELS
"""bytes of one .npy, or of all arrays of an .npz together: one float64 for each pixel of the largest image"""
CHUNK = 1 << 20
"""bytes decompressed at a time"""
SMALL_CHUNK = 1 << 12
"""compressed bytes at a time for methods without a bounded decompression (bzip2, LZMA)"""
PNG_SIGNATURE = b"\x89PNG\r\n\x1a\n"
PNG_FRAME_BYTES = 12
"""bytes of a chunk besides its content: length, name, checksum"""
PLAIN_KINDS = "biufUS"
"""dtype kinds of numbers and text"""
ZIP_ERRORS = (zipfile.BadZipFile, zlib.error, lzma.LZMAError, OSError, EOFError, ValueError, RuntimeError, NotImplementedError,
              LookupError, OverflowError, struct.error)  # fmt: skip
"""exceptions of zipfile for an archive that is damaged, truncated, encrypted or compressed in another way"""
HEADER_ERRORS = (ValueError, TypeError, SyntaxError, tokenize.TokenError, OverflowError, RecursionError, MemoryError, EOFError,
                 LookupError, struct.error)  # fmt: skip
"""exceptions of NumPy for a damaged .npy header, which is a Python literal"""
IMAGE_ERRORS = (OSError, ValueError, SyntaxError, TypeError, LookupError, EOFError, OverflowError, AttributeError, RuntimeError,
                struct.error, zlib.error)  # fmt: skip
"""exceptions of Pillow for a damaged image header"""
Refuse = Callable[[str], SourceError]
"""function from a description of the input to the error to raise"""


class TooLargeError(SourceError):
    """Error for a file that states, or unpacks to, more than a limit allows."""


class Header(NamedTuple):
    """Shape and dtype in the header of an .npy."""

    shape: tuple[int, ...]
    dtype: np.dtype[Any]

    @property
    def bytes(self) -> int:
        """Size of the array in bytes."""
        return math.prod(self.shape) * self.dtype.itemsize


def image_size(data: bytes, name: str) -> tuple[int, int]:
    """Read width and height in pixels from the header of an image.

    Supports PNG, JPEG, BMP, WebP and TIFF. Raises SourceError for any other file.
    """
    from PIL import Image  # readers of arrays do not need Pillow

    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", Image.DecompressionBombWarning)
            with Image.open(io.BytesIO(data)) as header:
                return header.size
    except Image.DecompressionBombError as error:
        raise TooLargeError(name, "an image of a camera's size", "one of far more pixels", "make it smaller") from error
    except IMAGE_ERRORS as error:
        raise not_an_image(name, len(data)) from error


def check_image(data: bytes, name: str, most: int = MAX_PIXELS) -> tuple[int, int]:
    """Return width and height of an image of at most `most` pixels.

    Raises TooLargeError for a larger image and SourceError for a file of another kind.
    """
    width, height = image_size(data, name)
    if width * height > most:
        raise TooLargeError(name, f"an image of at most {most / 1e6:g} megapixels", f"{width} x {height}", "make it smaller")
    check_chunks(data, name)
    return width, height


def check_chunks(data: bytes, name: str) -> None:
    """Raise SourceError for a PNG that ends inside a chunk; data of other formats pass.

    OpenCV allocates the size that a chunk states before it checks whether the file is that long.
    """
    if not data.startswith(PNG_SIGNATURE):
        return
    at = len(PNG_SIGNATURE)
    while at < len(data):
        length = int.from_bytes(data[at : at + 4], "big")
        at += PNG_FRAME_BYTES + length
        if at > len(data):
            raise SourceError(name, "a whole PNG", f"one that ends {at - len(data)} bytes early", "get the file again")
        if data[at - PNG_FRAME_BYTES - length + 4 : at - PNG_FRAME_BYTES - length + 8] == b"IEND":
            return


def not_an_image(name: str, length: int) -> SourceError:
    """Build the error for a file of `length` bytes that cannot be decoded as an image."""
    got = f"{length} bytes that cannot be decoded" if length else "an empty file"
    return SourceError(name, "an image (JPEG, PNG, WebP, BMP or TIFF)", got, "give another file")


def load_npy(path: Path, name: str, most: int = MAX_ARRAY_BYTES) -> np.ndarray:
    """Load an array of numbers or text of at most `most` bytes from an .npy.

    Raises TooLargeError beyond the limit and SourceError for any other file.
    """

    def refuse(got: str) -> SourceError:
        return SourceError(name, "an .npy of plain numbers", got, "save it with allow_pickle=False, without objects")

    try:
        with path.open("rb") as stream:
            return _array(stream, path.stat().st_size, name, most, refuse)
    except OSError as error:
        raise SourceError(name, "an .npy of plain numbers", reason(error), "check the path") from error


def load_npz(path: Path, name: str, wanted: Callable[[str], bool] = lambda _: True,
             most: int = MAX_ARRAY_BYTES) -> dict[str, np.ndarray]:  # fmt: skip
    """Load the `wanted` arrays of numbers or text from an .npz, by name, in the order of the file.

    Raises TooLargeError when the arrays unpack to more than `most` bytes, and SourceError for any other file.
    """

    def refuse(got: str) -> SourceError:
        return SourceError(name, "an .npz of plain arrays", got, "save it with numpy.savez, without objects")

    try:
        with zipfile.ZipFile(path) as archive:
            members = {info.filename.removesuffix(".npy"): info for info in archive.infolist()}
            chosen = {key: info for key, info in members.items() if wanted(key)}
            _check_bytes(sum(info.file_size for info in chosen.values()), name, "arrays", most)
            return {key: _member_array(archive, info, f"{name}, {key}", most, refuse) for key, info in chosen.items()}
    except SourceError:
        raise
    except ZIP_ERRORS as error:
        raise refuse(reason(error)) from error


def read_member(archive: zipfile.ZipFile, info: zipfile.ZipInfo, name: str, most: int) -> bytes:
    """Read one file of a zip archive.

    Raises TooLargeError, before anything is decompressed, for a file that states more than `most` bytes. Raises SourceError for a
    damaged file or one whose length differs from the stated length.
    """
    _check_bytes(info.file_size, name, "a file in a zip", most)
    chunk = CHUNK if info.compress_type in (zipfile.ZIP_STORED, zipfile.ZIP_DEFLATED) else SMALL_CHUNK
    parts, left = [], info.file_size
    try:
        with archive.open(info) as stream:
            while left > 0 and (part := stream.read(min(chunk, left))):
                parts.append(part)
                left -= len(part)
    except ZIP_ERRORS as error:
        raise SourceError(name, "a whole file in a zip", reason(error), "was it cut short? get it again") from error
    if left:
        raise SourceError(name, f"{info.file_size} bytes, as the zip states", f"{info.file_size - left}", "get the file again")
    return b"".join(parts)


def npy_header(stream: BinaryIO, refuse: Refuse) -> Header:
    """Read shape and dtype from the header of an .npy.

    Raises the error of `refuse` for a damaged header and for dtypes other than numbers and text.
    """
    import numpy as np  # loaded late: discovery of sources reads no array

    try:
        version = np.lib.format.read_magic(stream)
        read = np.lib.format.read_array_header_1_0 if version == (1, 0) else np.lib.format.read_array_header_2_0
        shape, _, dtype = read(stream)
    except HEADER_ERRORS as error:
        raise refuse(reason(error)) from error
    if dtype.kind not in PLAIN_KINDS or dtype.itemsize == 0 or any(size < 0 for size in shape):
        raise refuse(f"{dtype} {shape}")
    return Header(shape, dtype)


def reason(error: BaseException) -> str:
    """Return the first line of an error's message, or the error's type without a message."""
    text = str(getattr(error, "strerror", None) or error).strip()
    return text.splitlines()[0] if text else type(error).__name__


def _member_array(archive: zipfile.ZipFile, info: zipfile.ZipInfo, name: str, most: int, refuse: Refuse) -> np.ndarray:
    data = read_member(archive, info, name, most)
    return _array(io.BytesIO(data), len(data), name, most, refuse)


def _array(stream: BinaryIO, size: int, name: str, most: int, refuse: Refuse) -> np.ndarray:
    """Read the array of a stream of `size` bytes."""
    import numpy as np  # loaded late: discovery of sources reads no array

    header = npy_header(stream, refuse)
    _check_bytes(header.bytes, name, "an array", most)
    if header.bytes > size - stream.tell():
        raise refuse(f"{size - stream.tell()} bytes for {header.dtype} {header.shape}")
    stream.seek(0)
    try:
        found: np.ndarray = np.lib.format.read_array(stream, allow_pickle=False)
    except HEADER_ERRORS as error:
        raise refuse(reason(error)) from error
    return found


def _check_bytes(stated: int, name: str, what: str, most: int) -> None:
    if stated > most:
        raise TooLargeError(name, f"{what} of at most {most / 2**20:.0f} MiB", f"{stated / 2**20:.0f} MiB", "make it smaller")


MOST_OUTLINE_PX = 2**21
"""length of one outline: a hand at 4K has a few thousand pixels"""
MOST_DRAWN_PX = 2**36
"""total area of the boxes around all masks of one file: 8,000 images of 8 megapixels, each covered by masks"""


def outline_px(corners: np.ndarray, where: str) -> int:
    """Return the length of the closed outline of (n, 2) corners in pixels.

    Raises SourceError for an outline that is too long for a mask.
    """
    import numpy as np  # loaded late: discovery of sources reads no array

    length = int(np.abs(np.diff(corners, axis=0, append=corners[:1])).max(axis=1).sum()) if len(corners) else 0
    if length > MOST_OUTLINE_PX:
        raise SourceError(where, f"an outline of at most {MOST_OUTLINE_PX} px", f"one of {length}", "draw it again")
    return length


def box_px(corners: np.ndarray, width_px: int, height_px: int) -> int:
    """Return the area of the bounding box of (n, 2) corners inside an image, in pixels."""
    import numpy as np  # loaded late: discovery of sources reads no array

    if not len(corners):
        return 0
    size = np.clip(corners.max(axis=0), 0, (width_px, height_px)) - np.clip(corners.min(axis=0), 0, (width_px, height_px)) + 1
    return int(size[0]) * int(size[1])


def check_drawn(areas: Iterable[int], name: str) -> None:
    """Raise SourceError when the masks of the file `name` cover more than `MOST_DRAWN_PX` pixels together."""
    total = sum(areas)
    if total > MOST_DRAWN_PX:
        raise SourceError(name, f"masks of at most {MOST_DRAWN_PX / 1e9:.0f} gigapixels together", f"{total / 1e9:.0f}",
                          "annotate fewer frames, or smaller pictures")
