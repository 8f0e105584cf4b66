"""Bad input and bad stores, from the command line: one clear sentence, exit 1, and the other clip succeeds."""

from __future__ import annotations

import os
import subprocess
from collections.abc import Iterator
from pathlib import Path

import pyarrow.parquet as pq
import pytest

from runner.index import Index
from tests.helpers.command import KEYS, Called, Made, call
from tests.helpers.tiny_root import write_points
from tests.helpers.tiny_source import FRAMES, VIDEOS, media, write_narrations, write_source

GOOD, BAD = VIDEOS


@pytest.fixture
def mine(made: Made, tmp_path: Path) -> Made:
    """Copy of the source and the store."""
    return made.copy(tmp_path)


def column(made: Made, name: str, part: str = "") -> list[str]:
    shards = sorted((made.store / "datasets" / f"{made.source.name}{part}" / "data").glob("*.parquet"))
    return [value for shard in shards for value in pq.read_table(shard, columns=[name])[name].to_pylist()]


def fails_alone(called: Called) -> bool:
    """Check exit 1 with a summary, one failure and no traceback, and the recording of the other clip."""
    assert called.code == 1 and set(called.json) == KEYS and "Traceback" not in called.err, called.err
    return sum(called.json["failed"].values()) == 1 and called.json["cached"]["clip_record"] == 1


# -- a clip fails alone ------------------------------------------------------------------------------------------------


def test_a_video_that_leads_out_of_the_source_is_refused(mine: Made, tmp_path: Path) -> None:
    """The target of a symbolic link is not part of the source."""
    elsewhere = tmp_path / "elsewhere.MP4"
    media(mine.source, BAD).rename(elsewhere)
    media(mine.source, BAD).symlink_to(elsewhere)
    refused = mine.run("recordings")
    assert fails_alone(refused)
    assert "expected a file inside the source folder" in refused.words and "copy the file into the folder" in refused.words


@pytest.mark.parametrize("size", [0, 1000])
def test_an_empty_or_cut_off_video_is_refused(size: int, mine: Made) -> None:
    """The file is named."""
    os.truncate(media(mine.source, BAD), size)
    refused = mine.run("recordings")
    assert fails_alone(refused) and f"{BAD}.MP4" in refused.words


def test_masks_of_a_missing_frame_are_refused(mine: Made) -> None:
    """A video with fewer frames than its annotations."""
    short = write_source(mine.source.parent / "short", (GOOD,))
    data = (short / "videos" / f"{GOOD}.MP4").read_bytes()
    media(mine.source, BAD).write_bytes(data)
    path = next(mine.source.rglob(f"{BAD}.json"))
    path.write_text(path.read_text().replace(f"frame_{FRAMES:010d}", f"frame_{9 * FRAMES:010d}"))
    refused = mine.run("recordings")
    assert fails_alone(refused) and str(9 * FRAMES) in refused.words


def test_brackets_in_a_message_are_shown_as_they_are(mine: Made) -> None:
    """Text from a file is not markup."""
    path = next(mine.source.rglob(f"{BAD}.json"))
    path.write_text(path.read_text().replace('"segments": [[[', '"segments": [[["[/bold]",', 1))
    refused = mine.run("recordings")
    assert fails_alone(refused) and f"{BAD}.json" in refused.words


def test_a_clip_without_masks_gives_no_samples_and_harms_no_other(mine: Made) -> None:
    """A data set of one video replaces that of two only with --replace."""
    write_points(mine.source, BAD, [])
    shown = mine.run("dataset")
    assert "Traceback" not in shown.err and set(column(mine, "video", "-part")) == {GOOD}
    assert "tiny-part is partial: " in shown.words and set(column(mine, "video")) == {GOOD, BAD}
    assert mine.run("dataset", "--replace").code == shown.code and set(column(mine, "video")) == {GOOD}


def test_an_unreadable_source_gives_no_data_set(made: Made, tmp_path: Path) -> None:
    """Exit 1, all failures listed, and no output."""
    source = write_source(tmp_path / "all-bad", VIDEOS)
    for video in VIDEOS:
        media(source, video).write_bytes(b"")
    refused = call("run", "dataset", "--source", source, "--store", tmp_path / "store", "--jobs", "0", "--json")
    assert refused.code == 1 and refused.json["failed"] == {"source_read": 2} and refused.json["outputs"] == {}


@pytest.mark.filterwarnings("ignore:Glyph")  # plots show boxes for scripts that their font lacks
def test_long_and_unicode_narrations_reach_the_data_set(mine: Made) -> None:
    """40,000 characters in several scripts, with quotes and line breaks, and nouns that EPIC lacks."""
    text = ('κόψε "το" ψωμί, 切面包 🍞 [/red]\n' * 2000)[:40_000]
    write_narrations(mine.source, {GOOD: {}, BAD: {"narration": text, "noun": "面包", "noun_class": -1, "all_nouns": "['面包']"}})
    done = mine.run("dataset")
    assert done.code == 0 and {text, "pick up card"} == set(column(mine, "narration")) and "面包" in column(mine, "noun")
    assert mine.ask("explain", "narration_labelling").code == 0


# -- the store cannot be used ------------------------------------------------------------------------------------------


@pytest.fixture
def small_disk(tmp_path: Path) -> Iterator[Path]:
    """A file system of 3 MB, where mounting is permitted."""
    place = tmp_path / "small"
    place.mkdir()
    mounted = subprocess.run(["mount", "-t", "tmpfs", "-o", "size=3m", "tmpfs", str(place)], capture_output=True)
    if mounted.returncode:
        pytest.skip("no right to mount a file system")
    yield place
    subprocess.run(["mount", "-o", "remount,rw", str(place)], capture_output=True)
    subprocess.run(["umount", "-l", str(place)], check=True)


def test_a_full_disk_is_reported_and_finished_results_are_kept(made: Made, small_disk: Path) -> None:
    """Exit 1 and one sentence; the next run, with more space, resumes."""
    store = small_disk / "store"
    words = ("run", "dataset", "--source", made.source, "--store", store, "--jobs", "0", "--json")
    full = call(*words)
    assert full.code == 1 and "no space left on the disk" in full.words and "Traceback" not in full.err
    subprocess.run(["mount", "-o", "remount,size=100m", str(small_disk)], check=True)
    finished = Index(store).keys()
    more = call(*words)
    assert more.code == 0 and finished and sum(more.json["cached"].values()) == len(finished)


def test_a_read_only_store_is_refused(made: Made, small_disk: Path) -> None:
    """One sentence with advice, before anything is computed."""
    subprocess.run(["mount", "-o", "remount,ro", str(small_disk)], check=True)
    refused = call("run", "dataset", "--source", made.source, "--store", small_disk / "store", "--jobs", "0")
    assert refused.code == 1 and "the file system is read-only" in refused.words
    assert "choose another folder for the store" in refused.words and "Traceback" not in refused.err


def test_a_store_that_is_a_file_is_refused(made: Made, tmp_path: Path) -> None:
    """The same error for each verb that opens a store."""
    (tmp_path / "store").touch()
    for verb in ("status", "verify", "gc", "run"):
        refused = call(verb, "--store", tmp_path / "store")
        assert refused.code == 2 and f"error: --store {tmp_path / 'store'}: " in refused.err and "is a file" in refused.err, verb


def test_a_source_with_an_unusual_name_is_a_source(made: Made, tmp_path: Path) -> None:
    """Spaces, brackets, Greek: outputs have the same name."""
    source = write_source(tmp_path / "κουζίνα [red] 1", (GOOD,))
    done = call("run", "recordings", "--source", source, "--store", made.copy(tmp_path).store, "--jobs", "0", "--json")
    assert done.code == 0 and source.name in done.json["outputs"]["recordings"] and source.name in done.err
