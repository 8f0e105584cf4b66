"""Set-up of the hand landmark networks: verified files out of a wheel, kept, replaced when damaged, refused when wrong."""

from __future__ import annotations

import hashlib
import sys
import zipfile
from pathlib import Path
from types import ModuleType

import pytest

from afford.extraction.landmarks import files
from tests.helpers.install_scripts import of_install

CONTENT = {"palm_detection_full.tflite": b"palms" * 100, "hand_landmark_full.tflite": b"hands" * 100, "LICENSE": b"Apache License"}


@pytest.fixture
def script(monkeypatch: pytest.MonkeyPatch) -> ModuleType:
    """The script, with the digests of small files."""
    script = of_install("landmark_files")
    small = {name: script.Published(published.source, len(CONTENT[name]), hashlib.sha256(CONTENT[name]).hexdigest())
             for name, published in script.FILES.items()}  # fmt: skip
    monkeypatch.setattr(script, "FILES", small)
    return script


def wheel(script: ModuleType, folder: Path, **changed: bytes) -> Path:
    """Write a wheel with the files of CONTENT, some of them changed by the stem of their name."""
    path = folder / "mediapipe.whl"
    with zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED) as archive:
        for name, published in script.FILES.items():
            archive.writestr(published.source, changed.get(Path(name).stem, CONTENT[name]))
    return path


def offline(folder: Path) -> Path:
    raise AssertionError(f"a download into {folder}")


def kept(script: ModuleType, prefix: Path) -> dict[str, bytes]:
    """Contents of all files below the prefix, by name."""
    return {path.name: path.read_bytes() for path in prefix.rglob("*") if path.is_file()}


def test_verified_files_are_kept_without_network(script: ModuleType, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """The first run writes exactly the three files, the second writes and prints nothing."""
    assert script.main(tmp_path, lambda folder: wheel(script, folder)) == 0
    assert kept(script, tmp_path) == CONTENT and len(capsys.readouterr().out.splitlines()) == 1
    assert script.main(tmp_path, offline) == 0
    assert capsys.readouterr() == ("", "")


@pytest.mark.parametrize("name", CONTENT)
def test_a_damaged_file_is_replaced(script: ModuleType, tmp_path: Path, name: str) -> None:
    """A file of the same size with other bytes, and a file that is missing."""
    script.main(tmp_path, lambda folder: wheel(script, folder))
    path = tmp_path / script.FOLDER / name
    path.write_bytes(bytes(len(CONTENT[name])))
    assert script.main(tmp_path, lambda folder: wheel(script, folder)) == 0 and kept(script, tmp_path) == CONTENT
    path.unlink()
    assert script.main(tmp_path, lambda folder: wheel(script, folder)) == 0 and kept(script, tmp_path) == CONTENT


def test_set_up_goes_on_without_a_network(script: ModuleType, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """One sentence says what is missing, why, what works without it, and what to do."""
    def fails(folder: Path) -> Path:
        raise script.DownloadError("no route to host")

    assert script.main(tmp_path, fails) == 0 and kept(script, tmp_path) == {}
    message = capsys.readouterr().err
    assert message.count("\n") == 1 and message.startswith("note: the hand landmark networks are missing")
    assert all(words in message for words in ("no route to host", "everything works without them", "install/landmark_files.py"))


@pytest.mark.parametrize("changed", [
    {"hand_landmark_full": b"other" * 100},  # same size
    {"palm_detection_full": b"palms" * 100 + b"more"},
    {"LICENSE": b""}])  # fmt: skip
def test_another_file_is_refused(script: ModuleType, tmp_path: Path, capsys: pytest.CaptureFixture[str],
                                 changed: dict[str, bytes]) -> None:  # fmt: skip
    """No file is kept, also not a right one."""
    assert script.main(tmp_path, lambda folder: wheel(script, folder, **changed)) == 1
    assert kept(script, tmp_path) == {} and "is not the published file" in capsys.readouterr().err


def test_another_wheel_is_refused(script: ModuleType, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """A wheel without the files, and bytes that are no wheel."""
    def empty(folder: Path) -> Path:
        with zipfile.ZipFile(folder / "mediapipe.whl", "w") as archive:
            archive.writestr("mediapipe/__init__.py", "")
        return folder / "mediapipe.whl"

    def torn(folder: Path) -> Path:
        path = wheel(script, folder)
        path.write_bytes(path.read_bytes()[:-40])
        return path

    assert script.main(tmp_path, empty) == 1 and "a file is missing" in capsys.readouterr().err
    assert script.main(tmp_path, torn) == 1 and "damaged" in capsys.readouterr().err
    assert kept(script, tmp_path) == {}


def test_files_are_read_up_to_their_published_size(script: ModuleType, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """A file that unpacks to more than its published size is refused after that size."""
    read: list[int] = []
    inner = zipfile.ZipExtFile.read
    monkeypatch.setattr(zipfile.ZipExtFile, "read", lambda self, n=-1: read.append(n) or inner(self, n))
    bomb = wheel(script, tmp_path, palm_detection_full=bytes(20_000_000))
    with pytest.raises(script.RefusedError, match="not the published file"):
        script.extract(bomb)
    assert read and all(0 <= n <= 501 for n in read)


def test_the_library_finds_what_set_up_writes(script: ModuleType, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Same folder, same names; None before, and an error for another folder that lacks them."""
    monkeypatch.setattr(sys, "prefix", str(tmp_path))
    assert files.landmark_files(lambda path: "digest") is None
    script.main(tmp_path, lambda folder: wheel(script, folder))
    found = files.landmark_files(lambda path: hashlib.sha256(path.read_bytes()).hexdigest())
    assert found is not None
    assert {file.name: (file.digest, file.size) for file in found.files} == {
        name: (script.FILES[name].sha256, script.FILES[name].size) for name in (files.HAND, files.PALM)}  # fmt: skip
    assert files.landmark_files(lambda path: "digest", str(tmp_path / files.FOLDER)) is not None
    with pytest.raises(ValueError, match=r"has no palm_detection_full\.tflite"):
        files.landmark_files(lambda path: "digest", str(tmp_path))
