"""Recordings of clips that are no more do not stay beside those that are."""

from __future__ import annotations

from pathlib import Path

from commands.publish import LISTED, retire


def put(folder: Path, *names: str) -> set[str]:
    for name in names:
        (folder / name).write_text(name)
    return set(names)


def there(folder: Path) -> set[str]:
    return {path.name for path in folder.iterdir()} - {LISTED}


def test_a_whole_run_leaves_only_its_clips(tmp_path: Path) -> None:
    """And what is no clip of an earlier run: recordings of other stages, files of the user."""
    put(tmp_path, "dataset_pack.mcap", "mine.mcap")
    retire(tmp_path, put(tmp_path, "a_s01.mcap", "a_s02.mcap"), whole=True)
    retire(tmp_path, put(tmp_path, "a.mcap"), whole=True)
    assert there(tmp_path) == {"a.mcap", "dataset_pack.mcap", "mine.mcap"}


def test_a_run_of_some_clips_deletes_nothing(tmp_path: Path) -> None:
    """What it made is on the list for the next whole run."""
    retire(tmp_path, put(tmp_path, "a.mcap"), whole=True)
    retire(tmp_path, put(tmp_path, "b.mcap"), whole=False)
    assert there(tmp_path) == {"a.mcap", "b.mcap"}
    retire(tmp_path, put(tmp_path, "a.mcap"), whole=True)
    assert there(tmp_path) == {"a.mcap"}


def test_what_somebody_deleted_is_no_trouble(tmp_path: Path) -> None:
    retire(tmp_path, put(tmp_path, "a.mcap"), whole=True)
    (tmp_path / "a.mcap").unlink()
    retire(tmp_path, put(tmp_path, "b.mcap"), whole=True)
    assert there(tmp_path) == {"b.mcap"}
