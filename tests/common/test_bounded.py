"""Bounded reading: stated sizes are checked before any data is read."""

from __future__ import annotations

import io
import pickle
import zipfile
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from afford.common.bounded import TooLargeError, check_image, image_size, load_npy, load_npz, read_member
from afford.common.errors import SourceError

MIB = 1 << 20


def image(kind: str, width: int, height: int) -> bytes:
    """Write an image in a format."""
    out = io.BytesIO()
    Image.new("RGB", (width, height)).save(out, kind)
    return out.getvalue()


def npy(header: str, body: bytes = b"") -> bytes:
    """Write an .npy with any header."""
    text = header.encode("latin-1") + b"\n"
    return b"\x93NUMPY\x01\x00" + len(text).to_bytes(2, "little") + text + body


def zipped(path: Path, members: dict[str, bytes], method: int = zipfile.ZIP_DEFLATED) -> Path:
    """Write a zip of members."""
    with zipfile.ZipFile(path, "w", method) as archive:
        for name, data in members.items():
            archive.writestr(name, data)
    return path


def lie(path: Path, true: int, stated: int) -> None:
    """Change the stated size of the only member in both headers of a zip."""
    path.write_bytes(path.read_bytes().replace(true.to_bytes(4, "little"), stated.to_bytes(4, "little")))


@pytest.mark.parametrize("kind", ["PNG", "JPEG", "BMP", "WebP", "TIFF"])
def test_image_size_is_read_from_the_header(kind: str) -> None:
    """Check width and height of half a file."""
    data = image(kind, 31, 17)
    assert image_size(data, "one") == (31, 17)
    with pytest.raises(TooLargeError, match=r"one: expected an image of at most 0\.0005 megapixels, got 31 x 17"):
        check_image(data, "one", 500)


def test_file_without_an_image_is_refused() -> None:
    """Check text and an empty file."""
    for data in (b"", b"no picture"):
        with pytest.raises(SourceError, match="one: expected an image"):
            image_size(data, "one")


@pytest.mark.parametrize("value", [np.arange(6.0).reshape(2, 3), np.array("word"), np.zeros((0, 3), np.float32), np.array([True])])
def test_plain_arrays_equal_numpy(value: np.ndarray, tmp_path: Path) -> None:
    """Check .npy and .npz."""
    np.save(tmp_path / "one.npy", value)
    np.savez_compressed(tmp_path / "one.npz", value=value, other=value)
    found = load_npz(tmp_path / "one.npz", "one.npz", lambda name: name == "value")
    assert list(found) == ["value"]
    for one in (load_npy(tmp_path / "one.npy", "one.npy"), found["value"]):
        assert one.dtype == value.dtype and np.array_equal(one, value)


@pytest.mark.parametrize("header", [
    "{'descr': '<f8', 'fortran_order': False, 'shape': (1000000, 1000000), }",
    "{'descr': '<U100000000', 'fortran_order': False, 'shape': (2,), }",
])  # fmt: skip
def test_stated_npy_size_is_checked_first(header: str, tmp_path: Path) -> None:
    """Check a file and an archive."""
    (tmp_path / "one.npy").write_bytes(npy(header))
    zipped(tmp_path / "one.npz", {"value.npy": npy(header)})
    for read in (lambda: load_npy(tmp_path / "one.npy", "one"), lambda: load_npz(tmp_path / "one.npz", "one")):
        with pytest.raises(TooLargeError, match=r"one.*: expected an array of at most 488 MiB"):
            read()


@pytest.mark.parametrize("data", [
    b"", b"no array", npy("{'descr': '<f8', 'fortran_order': False, 'shape': (4,), }", b"short"),
    npy("{'descr': '|O', 'fortran_order': False, 'shape': (4,), }"),
    npy("{'descr': '<f8', 'fortran_order': False, 'shape': (-4,), }"),
    npy("{'descr': '<U0', 'fortran_order': False, 'shape': (1000000000000,), }"), npy("{'descr': '<f8', (((("), npy("(" * 5000),
    npy("{'descr': '<f8', 'fortran_order': False, 'shape': (" + "9" * 5000 + ",), }"), npy("1L + \"\"\""),
])  # fmt: skip
def test_invalid_arrays_are_refused(data: bytes, tmp_path: Path) -> None:
    """Check truncated files, objects, negative sizes and damaged headers."""
    (tmp_path / "one.npy").write_bytes(data)
    zipped(tmp_path / "one.npz", {"value.npy": data})
    for read in (lambda: load_npy(tmp_path / "one.npy", "one"), lambda: load_npz(tmp_path / "one.npz", "one")):
        with pytest.raises(SourceError, match=r"one.*: expected") as caught:
            read()
        assert "\n" not in str(caught.value)


def test_stated_member_size_is_checked_first(tmp_path: Path) -> None:
    """Check that sizes of all wanted arrays of an .npz count together."""
    path = zipped(tmp_path / "one.npz", {"a.npy": bytes(3 * MIB), "b.npy": bytes(3 * MIB)})
    with zipfile.ZipFile(path) as archive, pytest.raises(TooLargeError, match="a: expected a file in a zip of at most 2 MiB"):
        read_member(archive, archive.getinfo("a.npy"), "a", 2 * MIB)
    with pytest.raises(TooLargeError, match="one: expected arrays of at most 4 MiB, got 6 MiB"):
        load_npz(path, "one", most=4 * MIB)


@pytest.mark.parametrize("method", [zipfile.ZIP_STORED, zipfile.ZIP_DEFLATED, zipfile.ZIP_BZIP2, zipfile.ZIP_LZMA])
def test_compression_methods(method: int, tmp_path: Path) -> None:
    """Check members that are read in chunks."""
    data = np.random.default_rng(0).bytes(3 * MIB)
    path = zipped(tmp_path / "one.zip", {"a": data}, method)
    with zipfile.ZipFile(path) as archive:
        assert read_member(archive, archive.getinfo("a"), "a", 4 * MIB) == data


@pytest.mark.parametrize(("stated", "check"), [(2 * MIB, lambda size: size == 2 * MIB), (4 * MIB, lambda size: False)])
def test_false_member_size(stated: int, check: Callable[[int], bool], tmp_path: Path) -> None:
    """Check that a longer stream ends at the stated size, and a shorter one is refused."""
    path = zipped(tmp_path / "one.zip", {"a": bytes(3 * MIB)})
    lie(path, 3 * MIB, stated)
    with zipfile.ZipFile(path) as archive:
        try:
            assert check(len(read_member(archive, archive.getinfo("a"), "a", 8 * MIB)))
        except SourceError as error:
            assert str(error).startswith("a: expected")


def test_errors_are_short_sentences() -> None:
    """Check any content."""
    said = str(SourceError("one\ntwo", "a number", "9" * 5000, "correct it"))
    assert said.startswith("one two: expected a number, got 999") and len(said) < 300 and said.endswith("999; correct it")


def test_errors_of_worker_processes_keep_their_sentence() -> None:
    """Pickle an error and read it again."""
    error = SourceError("one", "a number", "a word", "correct it")
    copied = pickle.loads(pickle.dumps(error))
    assert type(copied) is SourceError and str(copied) == str(error)
