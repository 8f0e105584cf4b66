"""Segments and their index: one writer each, damaged rows skipped, a saved index that fits or is rebuilt."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import pytest
from toy_project import HERE, Project, graph, text

from runner.index import Index, Manifest, manifest_of
from runner.lease import KeyLeases, has_writer
from runner.segments import SegmentWriter, body_of, decode, encode, lines, segment_names
from runner.upkeep import MANY_SEGMENTS


@pytest.fixture
def project(tmp_path: Path) -> Project:
    return Project.make(tmp_path)


def contents(store: Path) -> tuple[object, ...]:
    """Answers of an index."""
    index = Index(store)
    traces = sorted((trace.key, trace.output, trace.reason, trace.finished) for trace in index.all())
    return (traces, sorted(index.bodies().items()), {stage: index.shards(stage) for stage in sorted(index.stages())},
            sorted(index.latest_keys()), index.drops, index.failures())


def test_a_row_is_its_line_and_no_other() -> None:
    """Any changed byte of a line is noticed."""
    row = ["trace", "a" * 64, "ä\n\t", {"x": [1.5, None]}]
    line = encode(row)
    assert line.endswith(b"\n") and line.count(b"\n") == 1 and decode(line[:-1]) == row
    for at in range(len(line) - 1):
        changed = bytes([line[at] ^ 1])
        assert decode(line[:at] + changed + line[at + 1 : -1]) is None


def test_manifests_keep_every_name() -> None:
    """Tabs, brackets and line ends in file names, and files outside the store."""
    for name in ("a", "a\tb", "a\nb", "[", "{}", "ä/ö"):
        for kind in ("Word", "[Word"):
            found = manifest_of(body_of(kind, [[name, "0" * 64, 3, 7]], None))
            assert (found.kind, found.files[0][:4]) == (kind, (name, "0" * 64, 3, 7))
    outside = manifest_of(body_of("File", [["f", "1" * 64, 5, 0, "/x", [5, 1, 2, 3]]], None))
    assert outside.files[0].path == "/x" and outside.files[0].stamp == (5, 1, 2, 3)
    assert manifest_of(body_of("tuple", [], [["a", "2" * 64]])) == Manifest("tuple", (), (("a", "2" * 64),))


def test_the_saved_index_equals_the_segments(project: Project) -> None:
    """The index is saved, then saved with rows behind it, then missing."""
    project.run("ab", "bad")
    project.edit("toy/helper.py", '"!"', '"?"')
    project.run("ab")
    fresh = contents(project.store)
    Index(project.store).write()
    assert contents(project.store) == fresh
    project.edit("toy/helper.py", '"?"', '"!"')
    project.run("ab", "cd")
    added = contents(project.store)
    (project.store / ".cache" / "index.json").unlink()
    assert contents(project.store) == added != fresh


def test_a_new_row_does_not_write_the_index_again(project: Project) -> None:
    """The row is only appended to a segment."""
    project.run("ab")
    Index(project.store).write()
    before = os.stat(project.store / ".cache" / "index.json").st_mtime_ns
    assert project.run("ab", "cd").ran["split"] == 1
    assert os.stat(project.store / ".cache" / "index.json").st_mtime_ns == before
    project.executed()
    assert project.run("ab", "cd").ran == {} and not project.executed()


@pytest.mark.parametrize("change", ["gone", "shorter", "flipped"])
def test_a_saved_index_that_does_not_fit_is_rebuilt(change: str, project: Project) -> None:
    """A segment that is gone, shorter or changed takes its rows with it, and the next run computes them again."""
    first = project.run("ab")
    Index(project.store).write()
    for path in sorted((project.store / "traces").iterdir()):
        data = path.read_bytes()
        if change == "gone":
            path.unlink()
        else:
            path.write_bytes(data[:10] if change == "shorter" else data.replace(b"split", b"splat"))
    again = project.run("ab")
    assert again.ok and again.outputs == first.outputs and again.ran["split"] == 1
    assert project.runner().verify().ok


def test_a_torn_line_is_skipped_and_removed(project: Project) -> None:
    """A kill in the middle of a write leaves such a line."""
    project.run("ab")
    path = project.store / "traces" / segment_names(project.store)[0]
    with path.open("ab") as file:
        file.write(encode(["trace", "k"])[:20])
    project.executed()
    assert project.run("ab").ran == {} and not project.executed()
    assert project.runner().verify().ok and path.read_bytes().endswith(b"\n")


def test_segments_are_merged_when_there_are_many(project: Project) -> None:
    """The merged segment has every row, whatever the order of the names."""
    project.run("ab")
    index = Index(project.store)
    for number in range(MANY_SEGMENTS + 1):
        writer = SegmentWriter(project.store, f"other-{number}")
        writer.append(encode(["artifact", f"{number:064x}", "Word", [], None]))
        writer.close()
    index.refresh()
    before = contents(project.store)
    assert project.run("ab").ran == {} and len(segment_names(project.store)) <= 2
    assert contents(project.store) == before


def test_a_segment_has_one_writer_that_holds_its_lock(tmp_path: Path) -> None:
    """The lock goes with the process."""
    (tmp_path / "traces").mkdir()
    writer = SegmentWriter(tmp_path, "s")
    assert [writer.append(encode(["use", number])) for number in (1, 10)] == [0, len(encode(["use", 1]))]
    path = tmp_path / "traces" / writer.name
    assert has_writer(path) and len(list(lines(path.read_bytes()))) == 2
    writer.close()
    assert not has_writer(path)
    writer.append(encode(["use", 1]))
    assert tmp_path / "traces" / writer.name != path


def test_a_key_has_one_holder(tmp_path: Path) -> None:
    """The holder is in this process or another; the lease goes with its process, and no other key is touched."""
    (tmp_path / "leases").mkdir()
    mine, other = KeyLeases(tmp_path), KeyLeases(tmp_path)
    key, second = "ab" * 32, "cd" * 32
    assert mine.acquire(key) and not other.acquire(key) and not other.is_free(key) and other.acquire(second)
    mine.release(key)
    assert other.is_free(key)
    code = (f"import sys; sys.path.insert(0, {str(HERE.parents[1])!r})\n"
            "from pathlib import Path\nfrom runner.lease import KeyLeases\n"
            f"print(KeyLeases(Path({str(tmp_path)!r})).acquire({key!r}), flush=True); sys.stdin.read()")
    holder = subprocess.Popen([sys.executable, "-c", code], stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True)
    assert holder.stdout is not None and holder.stdout.readline() == "True\n" and not mine.acquire(key)
    holder.kill()
    holder.communicate()
    assert mine.acquire(key)


def test_the_index_holds_uses_in_the_order_of_time(project: Project) -> None:
    """The older trace is the last use after an undo, also when segments are read in another order."""
    project.run("ab")
    project.edit("toy/helper.py", '"!"', '"?"')
    project.run("ab")
    project.edit("toy/helper.py", '"?"', '"!"')
    report = project.run("ab")
    used = {shard: Index(project.store).shards("shout")[shard] for shard in report.used["shout"]}
    for number, name in enumerate(reversed(segment_names(project.store))):
        os.rename(project.store / "traces" / name, project.store / "traces" / f"{number}-{name}")
    assert {shard: Index(project.store).shards("shout")[shard] for shard in used} == used == report.used["shout"]
    assert text(project, report) == "A A" and len(graph("ab").stages()) == 4
