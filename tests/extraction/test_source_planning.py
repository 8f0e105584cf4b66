"""Laws of ingest at size: a root of 700 videos is planned without opening what is large or what is not needed."""

from __future__ import annotations

import os
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import pytest

from runner.files import PLAN_HASH_BYTES, RACY_NS, FileMemo
from tests.helpers.command import call
from tests.helpers.made_epic import write_folder, write_tables

VIDEOS = tuple(f"P{person:02d}_{number}" for person in range(1, 36) for number in range(101, 121))
ANNOTATED = VIDEOS[::10]
TAR_BYTES = 400 << 20
watched: list[tuple[str, str]] | None = None


def _hook(event: str, arguments: tuple[Any, ...]) -> None:
    if watched is not None and event in ("open", "os.scandir", "os.listdir") and isinstance(arguments[0], (str, os.PathLike)):
        watched.append((event, os.fspath(arguments[0])))


sys.addaudithook(_hook)


@contextmanager
def watching(root: Path) -> Iterator[dict[str, list[Path]]]:
    """Record the paths below `root` that this process opens and lists, by event."""
    global watched
    watched, found = [], {}
    try:
        yield found
    finally:
        for event, path in watched:
            if path.startswith(f"{root}{os.sep}") or path == str(root):
                found.setdefault(event, []).append(Path(path))
        watched = None


@pytest.fixture(scope="module")
def root(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """700 videos as published, one sparse tar each: 280 GB that no disk holds; 70 of them are annotated."""
    folder = tmp_path_factory.mktemp("epic") / "EPIC-KITCHENS"
    write_tables(folder, ANNOTATED)
    for video in VIDEOS:
        path = folder / video[:3] / "rgb_frames" / f"{video}.tar"
        path.parent.mkdir(parents=True, exist_ok=True)
        with path.open("wb") as stream:
            stream.truncate(TAR_BYTES)
    time.sleep(2 * RACY_NS / 1e9)  # the digest of a younger file is not remembered
    return folder


def test_a_plan_opens_no_archive_and_lists_every_folder_once(root: Path, tmp_path: Path) -> None:
    """A plan opens the annotations of 70 videos and the tables, each once, and none of 700 tars."""
    with watching(root) as seen:
        said = call("run", "dataset", "--source", root, "--store", tmp_path, "--dry-run", "--json").json
    assert sorted(task["clip"] for task in said["tasks"] if task["stage"] == "source_read") == sorted(ANNOTATED)
    opened = [path.relative_to(root) for path in seen["open"]]
    assert len(opened) == len(set(opened)) == len(ANNOTATED) + 3 and not [path for path in opened if path.suffix == ".tar"]
    folders = [path for path in (root, *root.rglob("*")) if path.is_dir()]
    assert len(seen["os.scandir"]) == len(folders) and "os.listdir" not in seen


def test_one_clip_of_many_needs_one_video(root: Path, tmp_path: Path) -> None:
    """`--clip` looks at the annotations of that video alone."""
    with watching(root) as seen:
        said = call("run", "dataset", "--source", root, "--store", tmp_path, "--clip", ANNOTATED[3], "--dry-run", "--json").json
    assert {task["clip"] for task in said["tasks"] if task["stage"] == "source_read"} == {ANNOTATED[3]}
    assert [path.stem for path in seen["open"] if "annotations" in path.parts] == [ANNOTATED[3]]


def test_a_plan_writes_nothing_down_of_what_it_has_not_read(root: Path, tmp_path: Path) -> None:
    """Stand-ins for digests are in no manifest and in no memory."""
    call("run", "dataset", "--source", root, "--store", tmp_path, "--dry-run", "--json")
    assert not list((tmp_path / "traces").iterdir())
    assert ".tar" not in (tmp_path / ".cache" / "files.json").read_text()


def test_a_large_folder_is_looked_at_once(tmp_path: Path) -> None:
    """Remembered by its own stamp: after the first digest no frame is opened or listed; a frame more is noticed."""
    folder, store = write_folder(tmp_path / "root", frames=600), tmp_path / "store"
    first, memo = FileMemo(store), FileMemo(store)
    time.sleep(2e-9 * RACY_NS)  # what has just changed is not remembered: it may change again within the same tick
    wanted = first.digest(folder)
    first.save()
    memo = FileMemo(store)
    with watching(folder) as seen:
        assert memo.digest(folder) == wanted and memo.knows(folder)
    assert seen == {}
    (folder / "frame_0000000601.jpg").write_bytes(b"x")
    assert not memo.knows(folder) and memo.digest(folder)[0] != wanted[0]


def test_a_glance_reads_small_files_alone(tmp_path: Path) -> None:
    """A large file that was never hashed gets a stand-in; once hashed, its digest."""
    large = tmp_path / "large"
    with large.open("wb") as stream:
        stream.truncate(PLAN_HASH_BYTES + 1)
    time.sleep(2e-9 * RACY_NS)
    with watching(tmp_path) as seen:
        stand_in = FileMemo(tmp_path / "store", plan_only=True).digest(large)[0]
    assert large not in seen.get("open", [])
    memo = FileMemo(tmp_path / "store")
    found = memo.digest(large)[0]
    memo.save()
    assert stand_in != found == FileMemo(tmp_path / "store", plan_only=True).digest(large)[0]
