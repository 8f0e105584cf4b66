"""Bounded reading: what a file states is checked before it is read."""

from __future__ import annotations

import io
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
    """A picture as a file of this kind."""
    out = io.BytesIO()
    Image.new("RGB", (width, height)).save(out, kind)
    return out.getvalue()


def npy(header: str, body: bytes = b"") -> bytes:
    """An .npy with any header."""
    text = header.encode("latin-1") + b"\n"
    return b"\x93NUMPY\x01\x00" + len(text).to_bytes(2, "little") + text + body


def zipped(path: Path, members: dict[str, bytes], method: int = zipfile.ZIP_DEFLATED) -> Path:
    """A zip of members."""
    with zipfile.ZipFile(path, "w", method) as archive:
        for name, data in members.items():
            archive.writestr(name, data)
    return path


def lie(path: Path, true: int, stated: int) -> None:
    """Change the size of the only member in both headers of a zip."""
    path.write_bytes(path.read_bytes().replace(true.to_bytes(4, "little"), stated.to_bytes(4, "little")))


@pytest.mark.parametrize("kind", ["PNG", "JPEG", "BMP", "WebP", "TIFF"])
def test_the_size_of_a_picture_is_read_from_its_header(kind: str) -> None:
    """Width, then height; half of the file is enough."""
    data = image(kind, 31, 17)
    assert image_size(data, "one") == (31, 17)
    with pytest.raises(TooLargeError, match=r"one: expected an image of at most 0\.0005 megapixels, got 31 x 17"):
        check_image(data, "one", 500)


def test_a_file_without_a_picture_has_no_size() -> None:
    """Text and nothing are refused."""
    for data in (b"", b"no picture"):
        with pytest.raises(SourceError, match="one: expected an image"):
            image_size(data, "one")


@pytest.mark.parametrize("value", [np.arange(6.0).reshape(2, 3), np.array("word"), np.zeros((0, 3), np.float32), np.array([True])])
def test_plain_arrays_are_read_as_numpy_reads_them(value: np.ndarray, tmp_path: Path) -> None:
    """The files are .npy and .npz."""
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
def test_the_size_that_an_npy_states_is_checked_before_it_is_read(header: str, tmp_path: Path) -> None:
    """The .npy is a file, or a member of an archive."""
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
def test_damaged_and_foreign_arrays_are_refused_in_a_sentence(data: bytes, tmp_path: Path) -> None:
    """Cut files, objects, negative sizes, damaged headers."""
    (tmp_path / "one.npy").write_bytes(data)
    zipped(tmp_path / "one.npz", {"value.npy": data})
    for read in (lambda: load_npy(tmp_path / "one.npy", "one"), lambda: load_npz(tmp_path / "one.npz", "one")):
        with pytest.raises(SourceError, match=r"one.*: expected") as caught:
            read()
        assert "\n" not in str(caught.value)


def test_a_member_is_refused_by_its_stated_size_before_it_is_decompressed(tmp_path: Path) -> None:
    """The sizes of all wanted arrays of an .npz are summed."""
    path = zipped(tmp_path / "one.npz", {"a.npy": bytes(3 * MIB), "b.npy": bytes(3 * MIB)})
    with zipfile.ZipFile(path) as archive, pytest.raises(TooLargeError, match="a: expected a file in a zip of at most 2 MiB"):
        read_member(archive, archive.getinfo("a.npy"), "a", 2 * MIB)
    with pytest.raises(TooLargeError, match="one: expected arrays of at most 4 MiB, got 6 MiB"):
        load_npz(path, "one", most=4 * MIB)


@pytest.mark.parametrize("method", [zipfile.ZIP_STORED, zipfile.ZIP_DEFLATED, zipfile.ZIP_BZIP2, zipfile.ZIP_LZMA])
def test_members_of_every_method_are_read_whole(method: int, tmp_path: Path) -> None:
    """Members are read in chunks."""
    data = np.random.default_rng(0).bytes(3 * MIB)
    path = zipped(tmp_path / "one.zip", {"a": data}, method)
    with zipfile.ZipFile(path) as archive:
        assert read_member(archive, archive.getinfo("a"), "a", 4 * MIB) == data


@pytest.mark.parametrize(("stated", "check"), [(2 * MIB, lambda size: size == 2 * MIB), (4 * MIB, lambda size: False)])
def test_a_member_that_states_another_size_is_cut_or_refused(stated: int, check: Callable[[int], bool], tmp_path: Path) -> None:
    """A zip can lie: the stream ends at the stated size, and one that ends before is refused."""
    path = zipped(tmp_path / "one.zip", {"a": bytes(3 * MIB)})
    lie(path, 3 * MIB, stated)
    with zipfile.ZipFile(path) as archive:
        try:
            assert check(len(read_member(archive, archive.getinfo("a"), "a", 8 * MIB)))
        except SourceError as error:
            assert str(error).startswith("a: expected")


def test_an_error_is_one_sentence_of_bounded_length() -> None:
    """Whatever the file holds."""
    said = str(SourceError("one\ntwo", "a number", "9" * 5000, "correct it"))
    assert said.startswith("one two: expected a number, got 999") and len(said) < 300 and said.endswith("999; correct it")
