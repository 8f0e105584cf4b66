"""Set-up of networks out of wheels: verified files, kept, replaced when damaged, refused when wrong."""

from __future__ import annotations

import hashlib
import sys
import zipfile
from collections.abc import Callable
from pathlib import Path
from types import ModuleType

import pytest

from afford.extraction.landmarks import files
from afford.models import encoder_place
from tests.helpers.install_scripts import of_install

SCRIPTS = {"landmark_files": "the hand landmark networks", "image_encoder": "the weights of the image encoder EfficientNet-Lite0"}
"""scripts of install/, and the names of their files in messages"""


def content(name: str) -> bytes:
    """Small content of a file."""
    return name.encode() * 20


def small(name: str, monkeypatch: pytest.MonkeyPatch) -> ModuleType:
    """Load a script, and give it the digests of small files."""
    script = of_install(name)
    files = {name: script.Published(published.source, len(content(name)), hashlib.sha256(content(name)).hexdigest())
             for name, published in script.FILES.items()}  # fmt: skip
    monkeypatch.setattr(script, "FILES", files)
    return script


@pytest.fixture(params=SCRIPTS)
def script(request: pytest.FixtureRequest, monkeypatch: pytest.MonkeyPatch) -> ModuleType:
    """The script, with the digests of small files."""
    return small(request.param, monkeypatch)


def all_content(script: ModuleType) -> dict[str, bytes]:
    return {name: content(name) for name in script.FILES}


def wheel(script: ModuleType, folder: Path, **changed: bytes) -> Path:
    """Write a wheel with the files of a script, some of them changed by name."""
    path = folder / "package.whl"
    with zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED) as archive:
        for name, published in script.FILES.items():
            archive.writestr(published.source, changed.get(name, content(name)))
    return path


def offline(folder: Path) -> Path:
    raise AssertionError(f"a download into {folder}")


def kept(script: ModuleType, prefix: Path) -> dict[str, bytes]:
    """Contents of all files below the prefix, by name."""
    return {path.name: path.read_bytes() for path in prefix.rglob("*") if path.is_file()}


def test_verified_files_are_kept_without_network(script: ModuleType, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """The first run writes exactly its files, the second writes and prints nothing."""
    assert script.main(tmp_path, lambda folder: wheel(script, folder)) == 0
    assert kept(script, tmp_path) == all_content(script) and len(capsys.readouterr().out.splitlines()) == 1
    assert script.main(tmp_path, offline) == 0
    assert capsys.readouterr() == ("", "")


def test_a_damaged_file_is_replaced(script: ModuleType, tmp_path: Path) -> None:
    """A file of the same size with other bytes, and a file that is missing."""
    script.main(tmp_path, lambda folder: wheel(script, folder))
    for name in script.FILES:
        path = tmp_path / script.FOLDER / name
        path.write_bytes(bytes(len(content(name))))
        assert script.main(tmp_path, lambda folder: wheel(script, folder)) == 0 and kept(script, tmp_path) == all_content(script)
        path.unlink()
        assert script.main(tmp_path, lambda folder: wheel(script, folder)) == 0 and kept(script, tmp_path) == all_content(script)


@pytest.mark.parametrize("name", SCRIPTS)
def test_set_up_goes_on_without_a_network(name: str, tmp_path: Path, capsys: pytest.CaptureFixture[str],
                                          monkeypatch: pytest.MonkeyPatch) -> None:  # fmt: skip
    """One sentence names the missing files, the reason, what works without them, and what to do."""
    script = small(name, monkeypatch)

    def fails(folder: Path) -> Path:
        raise sys.modules["published_files"].DownloadError("no route to host")

    assert script.main(tmp_path, fails) == 0 and kept(script, tmp_path) == {}
    message = capsys.readouterr().err
    assert message.count("\n") == 1 and message.startswith(f"note: {SCRIPTS[name]} are missing")
    assert all(words in message for words in ("no route to host", script.WITHOUT, f"install/{name}.py"))


@pytest.mark.parametrize("change", [lambda data: data[::-1], lambda data: data + b"more", lambda data: b""])
def test_another_file_is_refused(script: ModuleType, tmp_path: Path, capsys: pytest.CaptureFixture[str],
                                 change: Callable[[bytes], bytes]) -> None:  # fmt: skip
    """No file is kept, also not the right ones."""
    for name in script.FILES:
        assert script.main(tmp_path, lambda folder, name=name: wheel(script, folder, **{name: change(content(name))})) == 1
        assert kept(script, tmp_path) == {} and "is not the published file" in capsys.readouterr().err


def test_another_wheel_is_refused(script: ModuleType, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """A wheel without the files, and bytes that are no wheel."""
    def empty(folder: Path) -> Path:
        with zipfile.ZipFile(folder / "package.whl", "w") as archive:
            archive.writestr("package/__init__.py", "")
        return folder / "package.whl"

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
    bomb = wheel(script, tmp_path, **{next(iter(script.FILES)): bytes(20_000_000)})
    with pytest.raises(sys.modules["published_files"].RefusedError, match="not the published file"):
        script.extract(bomb)
    most = max(published.size for published in script.FILES.values())
    assert read and all(0 <= n <= most + 1 for n in read)


def test_the_library_finds_the_landmark_networks(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Same folder, same names; None before, and an error for another folder that lacks them."""
    script = small("landmark_files", monkeypatch)
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


def test_the_library_finds_the_image_encoder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Same folder, same name; None before."""
    script = small("image_encoder", monkeypatch)
    monkeypatch.setattr(sys, "prefix", str(tmp_path))
    assert encoder_place.encoder_files(lambda path: "digest") is None
    script.main(tmp_path, lambda folder: wheel(script, folder))
    found = encoder_place.encoder_files(lambda path: "digest")
    assert found is not None and [file.name for file in found.files] == [encoder_place.FILE]
    assert found.files[0].path == tmp_path / script.FOLDER / encoder_place.FILE
