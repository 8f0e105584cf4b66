"""Publishing: atomic, safe for several processes, without leftovers; recordings of removed clips are deleted."""

from __future__ import annotations

import multiprocessing
import os
import time
from multiprocessing.synchronize import Barrier
from pathlib import Path

import pytest

from commands import publish as publishing
from commands.publish import LISTED, publish, publish_file, retire_recordings
from commands.session import open_runner
from runner import Runner, StoreError
from tests.helpers.command import Made
from tests.helpers.made_files import artifact, content

PUBLISHERS, TIMES, LOOKS = 3, 80, 50


def put(folder: Path, *names: str) -> set[str]:
    for name in names:
        (folder / name).write_text(name)
    return set(names)


def there(folder: Path) -> set[str]:
    return {path.name for path in folder.iterdir()} - {LISTED}


@pytest.fixture
def runner(tmp_path: Path) -> Runner:
    return open_runner(tmp_path / "store", jobs=0)


@pytest.fixture(params=["exchange", "two renames"])
def way(request: pytest.FixtureRequest, monkeypatch: pytest.MonkeyPatch) -> None:
    """Publish with and without the system call that exchanges two names."""
    if request.param == "two renames":
        monkeypatch.setattr(publishing, "_exchange", lambda one, other: False)


# -- one process -------------------------------------------------------------------------------------------------------


@pytest.mark.usefixtures("way")
def test_a_folder_is_replaced_as_a_whole(runner: Runner, tmp_path: Path) -> None:
    """Files of the previous version are gone, and nothing hidden remains."""
    out = runner.store.root / "datasets" / "set"
    publish(runner, artifact(runner, tmp_path / "a", one="1", two="2"), out)
    publish(runner, artifact(runner, tmp_path / "b", two="22"), out)
    assert content(out) == {"two": b"22"} and there(out.parent) == {"set"}


@pytest.mark.usefixtures("way")
@pytest.mark.parametrize("left", [".set.partial-{pid}", ".set.old-{pid}", ".set.partial-elsewhere-{pid}-0123abcd",
                                  ".set.partial.elsewhere-{pid}-0123abcd"])
def test_leftovers_of_a_killed_run_are_deleted_and_never_published(left: str, runner: Runner, tmp_path: Path) -> None:
    """The process id may equal our own, as in a container."""
    out = runner.store.root / "datasets" / "set"
    (out.parent / left.format(pid=os.getpid()) / "data").mkdir(parents=True)
    (out.parent / left.format(pid=os.getpid()) / "data" / "stale").write_text("of a killed run")
    publish(runner, artifact(runner, tmp_path / "a", one="1"), out)
    assert content(out) == {"one": b"1"} and there(out.parent) == {"set"}


def test_a_current_folder_is_left_alone(runner: Runner, tmp_path: Path) -> None:
    """Neither the folder nor its blobs change: the next run hashes a blob whose change time moves."""
    out = runner.store.root
    digest = artifact(runner, tmp_path / "a", one="1")
    publish(runner, digest, out / "datasets" / "set")
    publish_file(runner, digest, out / "recordings" / "set" / "a.mcap")
    shown = (out / "datasets" / "set" / "one", out / "datasets" / "set", out / "recordings" / "set" / "a.mcap")
    before = [(path.stat().st_ctime_ns, path.stat().st_ino) for path in shown]
    publish(runner, digest, out / "datasets" / "set")
    publish_file(runner, digest, out / "recordings" / "set" / "a.mcap")
    assert [(path.stat().st_ctime_ns, path.stat().st_ino) for path in shown] == before
    assert there(out / "recordings" / "set") == {"a.mcap"}


def test_a_file_leaves_no_link_behind(runner: Runner, tmp_path: Path) -> None:
    """Leftovers of earlier versions are deleted too."""
    out = runner.store.root / "recordings" / "set" / "a.mcap"
    digest = artifact(runner, tmp_path / "a", one="1")
    for _ in range(2):
        publish_file(runner, digest, out)
    os.link(out, out.with_name(".a.mcap.partial-4711"))
    publish_file(runner, digest, out)
    publish_file(runner, artifact(runner, tmp_path / "b", one="2"), out)
    assert out.read_text() == "2" and there(out.parent) == {"a.mcap"}


def test_a_published_file_that_was_exchanged_is_put_right(runner: Runner, tmp_path: Path) -> None:
    out = runner.store.root / "datasets" / "set"
    digest = artifact(runner, tmp_path / "a", one="1")
    publish(runner, digest, out)
    (out / "one").unlink()
    (out / "one").write_text("mine")
    (out / "more").touch()
    publish(runner, digest, out)
    assert content(out) == {"one": b"1"}


def test_a_long_name_can_be_published(runner: Runner, tmp_path: Path) -> None:
    """A name of the maximum length of a file system."""
    out = runner.store.root / "datasets" / ("κ" * 120)
    for text in "12":
        publish(runner, artifact(runner, tmp_path / text, one=text), out)
    assert content(out) == {"one": b"2"}


def test_a_place_that_cannot_be_written_is_named(runner: Runner, tmp_path: Path) -> None:
    """One sentence, and no hidden file."""
    out = runner.store.root / "recordings" / "set" / "a.mcap"
    (out / "mine").mkdir(parents=True)
    with pytest.raises(StoreError, match=r"recordings/set could not be published to .*a.mcap.* kept in the store"):
        publish_file(runner, artifact(runner, tmp_path / "a", one="1"), out)
    assert there(out.parent) == {"a.mcap"}


# -- several processes -------------------------------------------------------------------------------------------------


def _publisher(store: Path, digests: tuple[str, str], out: Path, begin: Barrier, errors: multiprocessing.Queue) -> None:  # type: ignore[type-arg]
    runner = open_runner(store, jobs=0)
    begin.wait()
    for turn in range(TIMES):
        try:
            publish(runner, digests[turn % 2], out)
        except BaseException as error:  # all that can go wrong is what is counted
            errors.put(repr(error))


def test_several_processes_publish_one_folder(runner: Runner, tmp_path: Path) -> None:
    """No error, no reader without the folder, and one version at the end, after many rounds."""
    out = runner.store.root / "datasets" / "set"
    versions = {"one": "1", "data/two": "1"}, {"one": "2", "data/three": "2"}
    digests = artifact(runner, tmp_path / "a", **versions[0]), artifact(runner, tmp_path / "b", **versions[1])
    runner.store.save()
    publish(runner, digests[0], out)
    spawn = multiprocessing.get_context("spawn")
    begin, errors = spawn.Barrier(PUBLISHERS), spawn.Queue()
    how = runner.store.root, digests, out, begin, errors
    processes = [spawn.Process(target=_publisher, args=how) for _ in range(PUBLISHERS)]
    for process in processes:
        process.start()
    absent = looks = 0
    while any(process.is_alive() for process in processes):
        for _ in range(LOOKS):
            absent += not os.path.isdir(out)
        looks += LOOKS
        time.sleep(0)
    assert [process.exitcode for process in processes] == [0] * PUBLISHERS and errors.empty(), errors.get()
    assert absent == 0 or publishing_has_no_exchange(tmp_path), f"{absent} of {looks} looks"
    assert content(out) in [{name: text.encode() for name, text in version.items()} for version in versions]
    assert there(out.parent) == {"set"} and not list((runner.store.root / "leases").glob("publish-*"))


def publishing_has_no_exchange(folder: Path) -> bool:
    """Return True when this system lacks the exchange of two names."""
    for name in "xy":
        (folder / name).mkdir()
    return not publishing._exchange(folder / "x", folder / "y")


def test_published_folders_hold_no_hidden_files(made: Made) -> None:
    """The list of recordings of clips is the exception."""
    rooms = [made.store / room for room in ("datasets", "recordings", "reports", "models") if (made.store / room).exists()]
    hidden = {path.name for room in rooms for path in room.rglob(".*")}
    assert len(rooms) > 1 and hidden <= {LISTED}


# -- recordings of clips -----------------------------------------------------------------------------------------------


def test_a_whole_run_leaves_only_its_clips(tmp_path: Path) -> None:
    """Recordings of other stages and files of the user stay as well."""
    put(tmp_path, "dataset_pack.mcap", "mine.mcap")
    retire_recordings(tmp_path, put(tmp_path, "a_s01.mcap", "a_s02.mcap"), whole=True)
    retire_recordings(tmp_path, put(tmp_path, "a.mcap"), whole=True)
    assert there(tmp_path) == {"a.mcap", "dataset_pack.mcap", "mine.mcap"}


def test_a_run_of_some_clips_deletes_nothing(tmp_path: Path) -> None:
    """Its recordings are on the list for the next complete run."""
    retire_recordings(tmp_path, put(tmp_path, "a.mcap"), whole=True)
    retire_recordings(tmp_path, put(tmp_path, "b.mcap"), whole=False)
    assert there(tmp_path) == {"a.mcap", "b.mcap"}
    retire_recordings(tmp_path, put(tmp_path, "a.mcap"), whole=True)
    assert there(tmp_path) == {"a.mcap"}


def test_a_deleted_recording_is_no_error(tmp_path: Path) -> None:
    retire_recordings(tmp_path, put(tmp_path, "a.mcap"), whole=True)
    (tmp_path / "a.mcap").unlink()
    retire_recordings(tmp_path, put(tmp_path, "b.mcap"), whole=True)
    assert there(tmp_path) == {"b.mcap"}


@pytest.mark.parametrize("name", ["../x.mcap", "/{outside}/x.mcap", "sub/x.mcap", "..", ".clips", "notes.txt", "", "\0.mcap"])
def test_a_list_that_was_tampered_with_deletes_nothing_else(name: str, tmp_path: Path) -> None:
    """Plain names of recordings in the folder itself are the only ones deleted."""
    folder = tmp_path / "recordings"
    (folder / "sub").mkdir(parents=True)
    kept = [tmp_path / "x.mcap", folder / "sub" / "x.mcap", folder / "notes.txt"]
    for path in kept:
        path.touch()
    (folder / LISTED).write_text(name.format(outside=tmp_path) + "\n")
    retire_recordings(folder, put(folder, "a.mcap"), whole=True)
    assert all(path.exists() for path in kept) and (folder / LISTED).read_text() == "a.mcap\n"
