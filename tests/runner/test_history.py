"""History of runs: what a log holds, also of killed runs; tables, differences, credentials, expiry."""

from __future__ import annotations

import os
import random
import signal
import subprocess
import sys
import time
from contextlib import suppress
from pathlib import Path
from typing import Any

import pytest
from mcap.reader import NonSeekingReader, SeekingReader
from toy import shout
from toy_project import Project, graph, wait_until

from runner import RunReport, StoreError
from runner.history import FAILURES, TOPICS, RunLog, collect
from runner.log_file import BrokenLogError, LogWriter, read_log
from runner.masking import MASK, mask, mask_text
from runner.past_runs import UnknownRunError, expired, find_run, list_runs, logged_tasks, read_run, run_paths
from runner.process_tree import tree_usage
from runner.report import Reason
from runner.run_diff import compare_runs
from runner.run_table import LostTableError, read_table, write_table

TOY = Path(__file__).resolve().parents[1] / "toy_domain" / "toy_main.py"


@pytest.fixture
def project(tmp_path: Path) -> Project:
    return Project.make(tmp_path)


def recorded(project: Project, *words: str, jobs: int = 0, params: shout.Params | None = None, **settings: Any) -> RunReport:
    """Run the toy graph under a log."""
    with RunLog(project.store, "all", settings, jobs=jobs) as log:
        report = project.run(*words, jobs=jobs, params=params, observer=log)
        log.ended(report)
    return report


# -- logs --------------------------------------------------------------------------------------------------------------


def test_a_run_is_recorded(project: Project) -> None:
    """Counts, outcome, settings and the complete table are those of the report; tasks have start, end and reason."""
    report = recorded(project, "ab", "cd", sets=["shout.backend=plain"])
    run = find_run(project.store, "last")
    assert (run.outcome, run.target, run.settings) == ("ok", "all", {"sets": ["shout.backend=plain"]})
    assert run.counts == {"ran": report.ran} and run.keys() == report.used
    tasks = logged_tasks(run.path)
    assert len(tasks) == sum(report.ran.values()) and {task.reason for task in tasks} == {"first run"}
    assert all(run.began - 1 <= task.start <= task.end <= run.began + run.seconds + 1 for task in tasks)


def test_hits_are_counted_by_stage(project: Project) -> None:
    """A run with nothing to do has no message for a task, shares its table with the run before, and is small."""
    recorded(project, "ab", "cd")
    tables = set((project.store / "runs" / "tables").iterdir())
    report = recorded(project, "ab", "cd")
    run, before = list_runs(project.store)
    assert run.counts == {"cached": report.cached} and run.table == before.table
    assert [message.topic for message in read_log(run.path)] == ["/run", *["/hits"] * len(report.cached), "/run"]
    assert set((project.store / "runs" / "tables").iterdir()) == tables


def test_logs_are_valid_mcap(project: Project) -> None:
    """Both readers of the package accept all checksums, and find schemas, channels and statistics."""
    recorded(project, "ab")
    path = run_paths(project.store)[0]
    with path.open("rb") as stream:
        seeking = SeekingReader(stream, validate_crcs=True)
        summary = seeking.get_summary()
        assert summary is not None and summary.statistics is not None
        assert {channel.topic for channel in summary.channels.values()} == set(TOPICS)
        found = [(channel.topic, message.data) for _, channel, message in seeking.iter_messages(log_time_order=False)]
    with path.open("rb") as stream:
        linear = NonSeekingReader(stream, validate_crcs=True)
        assert [(channel.topic, message.data) for _, channel, message in linear.iter_messages(log_time_order=False)] == found
    assert summary.statistics.message_count == len(found) and summary.statistics.chunk_count == len(summary.chunk_indexes)


def test_failures_are_recorded(project: Project) -> None:
    """Message and reason of a failed task; the tasks behind it are blocked."""
    report = recorded(project, "ab", "bad")
    run = find_run(project.store, "last")
    assert run.outcome == "failed" and run.counts["failed"] == report.failed and run.counts["blocked"] == report.blocked
    assert {message.data["message"] for message in read_log(run.path, (FAILURES,))} == {one.message for one in report.failures}


def test_messages_are_read_in_many_chunks(tmp_path: Path) -> None:
    """Every message comes back, of one topic or of all, with and without compression."""
    path = tmp_path / "log.mcap"
    file = os.open(path, os.O_WRONLY | os.O_CREAT)
    writer = LogWriter(file, TOPICS)
    for number in range(20_000):
        writer.compress = number > 10_000
        writer.write("/hits" if number % 3 else "/starts", number, {"stage": f"stage {number}", "count": number})
    writer.finish()
    os.close(file)
    assert [message.data["count"] for message in read_log(path)] == list(range(20_000))
    assert [message.time_ns for message in read_log(path, ("/starts",))] == list(range(0, 20_000, 3))


# -- runs that end early -------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("size", range(9, 4000, 371))
def test_a_torn_log_is_read_as_far_as_it_goes(project: Project, size: int) -> None:
    """Whatever the place of the tear, the messages before it are found, and the run has ended early."""
    recorded(project, "ab", "cd")
    path = run_paths(project.store)[0]
    whole = list(read_log(path))
    path.write_bytes(path.read_bytes()[:size])
    assert list(read_log(path)) == whole[: len(list(read_log(path)))]
    assert read_run(path).outcome == "ended early"


def test_a_flipped_byte_is_found(project: Project) -> None:
    """The log is either reported as damaged, or says the same as before; the other runs are listed all the same."""
    recorded(project, "ab")
    recorded(project, "ab", "cd")
    path = run_paths(project.store)[0]
    data, whole, random_at = path.read_bytes(), read_run(path), random.Random(0)
    for _ in range(300):
        flipped = bytearray(data)
        flipped[random_at.randrange(len(data))] ^= 1 << random_at.randrange(8)
        path.write_bytes(flipped)
        found = list_runs(project.store)
        assert len(found) == 2 and found[1].outcome == "ok"
        assert found[0].outcome in ("damaged", "ended early") or found[0] == whole
        with suppress(BrokenLogError):  # no other error
            logged_tasks(path)


def test_a_killed_run_is_shown(project: Project, tmp_path: Path) -> None:
    """Its log is 'running', then 'ended early' with what it had flushed; the next run gives it its final name."""
    code = (f"import sys; sys.path[:0] = {[str(TOY.parents[2]), str(TOY.parent)]!r}\n"
            "from pathlib import Path\nfrom toy import shout\nfrom toy_project import Project, graph\n"
            "from runner.history import RunLog\n"
            f"project = Project(*map(Path, {[str(project.root), str(project.store), str(project.log)]!r}))\n"
            "with RunLog(project.store, 'all', {}) as log:\n"
            "    project.run('ab', 'cd', params=shout.Params(sleep_s=0.6), observer=log)\n")  # fmt: skip
    process = subprocess.Popen([sys.executable, "-c", code])
    try:
        wait_until(lambda: any(task.result == "ran" for path in run_paths(project.store) for task in logged_tasks(path)))
        assert read_run(run_paths(project.store)[0]).outcome == "running"
    finally:
        process.send_signal(signal.SIGKILL)
        process.wait()
    path = run_paths(project.store)[0]
    run = read_run(path)
    assert path.name.startswith(".") and run.outcome == "ended early" and run.count("ran") > 0
    with pytest.raises(UnknownRunError, match="no table"):
        run.keys()
    recorded(project, "ab", "cd")
    assert [one.outcome for one in list_runs(project.store)] == ["ok", "ended early"]
    assert not [path for path in run_paths(project.store) if path.name.startswith(".")]


def test_a_run_in_progress_is_left_alone(project: Project) -> None:
    """A second run in the meantime does not take the log of the first."""
    with RunLog(project.store, "all") as first:
        recorded(project, "ab")
        assert collect(first.runs) == [] and {run.outcome for run in list_runs(project.store)} == {"running", "ok"}
    assert {run.outcome for run in list_runs(project.store)} == {"ok"}


@pytest.mark.parametrize(("error", "outcome"), [(KeyboardInterrupt(), "stopped"), (SystemExit(143), "stopped"),
                                                (ValueError("token=abc is wrong"), "error")])  # fmt: skip
def test_an_error_is_the_outcome(tmp_path: Path, error: BaseException, outcome: str) -> None:
    """An error leaves the block, and the log names it without credentials."""
    with pytest.raises(type(error)), RunLog(tmp_path, "all") as log:
        log.cached("stage", 1)
        raise error
    run = find_run(tmp_path, "last")
    assert run.outcome == outcome and "abc" not in run.message


def test_a_refused_run_leaves_no_log(project: Project) -> None:
    """A run that is refused before anything was planned, like for an unknown shard."""
    with pytest.raises(ValueError, match="no such thing"), RunLog(project.store, "all"):
        raise ValueError("no such thing")
    assert list_runs(project.store) == []


def test_a_full_disk_is_one_sentence(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """The run ends with it, also when the disk fills up in the middle."""
    def full(*_: object) -> int:
        raise OSError(28, "No space left on device")

    with pytest.raises(StoreError, match="history in runs/ could not be written"), RunLog(tmp_path, "all") as log:
        log.started("stage", "shard", Reason("first run"))
        monkeypatch.setattr(os, "write", full)
        wait_until(lambda: log._error is not None)
        log.started("stage", "other", Reason("first run"))


# -- tables --------------------------------------------------------------------------------------------------------------


def table(count: int, seed: int = 0) -> dict[str, dict[str, str]]:
    """Random keys of two stages; some shards have unusual names."""
    values = random.Random(seed)
    names = ["", 'quote"', "tab\there", "line\nbreak", "\u2028", *(f"clip {number}" for number in range(count))]
    return {stage: {name: f"{values.getrandbits(256):064x}" for name in names} for stage in ("one", "two\tthree")}


def test_tables_come_back(tmp_path: Path) -> None:
    """Tables of any size, in any order, with any names, are read as they were written."""
    for count in (0, 10, 5000):
        keys = table(count)
        digests = write_table(tmp_path, keys)
        shuffled = {stage: dict(sorted(keys[stage].items(), key=lambda item: item[1])) for stage in reversed(keys)}
        assert read_table(tmp_path, digests) == keys and write_table(tmp_path, shuffled) == digests
    assert read_table(tmp_path, write_table(tmp_path, {})) == {}


def test_a_change_of_one_shard_writes_one_piece(tmp_path: Path) -> None:
    """A second one is written where the new key begins or ends a piece."""
    keys = table(20_000)
    digests = write_table(tmp_path, keys)
    assert len(digests) > 10
    for seed, shard in enumerate(("clip 7", "clip 12345", "clip 19999")):
        keys["one"][shard] = f"{random.Random(seed).getrandbits(256):064x}"
        again = write_table(tmp_path, keys)
        assert len(set(again) - set(digests)) <= 2
        digests = again


def test_a_lost_table_is_one_sentence(tmp_path: Path) -> None:
    """A missing or damaged piece is never taken for the whole."""
    digests = write_table(tmp_path, table(10))
    place = next((tmp_path / "tables").iterdir())
    data = bytearray(place.read_bytes())
    data[len(data) // 2] ^= 1
    place.write_bytes(data)
    with pytest.raises(LostTableError, match="is damaged"):
        read_table(tmp_path, digests)
    place.unlink()
    with pytest.raises(LostTableError, match="is missing"):
        read_table(tmp_path, digests)


# -- find, compare, forget -------------------------------------------------------------------------------------------------


def test_runs_are_found_by_id(project: Project) -> None:
    """A run is named by a beginning of the id or of the name, or by `last~n`; anything else is one sentence."""
    with pytest.raises(UnknownRunError, match="no recorded run yet"):
        find_run(project.store, "last")
    for words in (("ab",), ("ab", "cd"), ("ab",)):
        recorded(project, *words)
    runs = list_runs(project.store)
    assert [find_run(project.store, word).id for word in ("last", "last~1", "last~2")] == [run.id for run in runs]
    assert all(find_run(project.store, run.id[:6]) == run == find_run(project.store, run.path.stem) for run in runs)
    for word, message in (("last~3", "has 3 recorded"), ("zz", "is unknown"), ("", "is unknown"), ("2", "more than one|unknown")):
        with pytest.raises(UnknownRunError, match=message):
            find_run(project.store, word)


def test_differences_name_every_part_of_the_key(project: Project) -> None:
    """Parameters with both values, code by definitions, inputs by arguments; new shards; outputs."""
    recorded(project, "ab")
    project.edit("toy/helper.py", '"!"', '"?"')
    recorded(project, "ab", "cd", params=shout.Params(backend="other"), jobs=1)
    b, a = list_runs(project.store)
    runner = project.runner()
    diffs = {diff.stage: diff for diff in compare_runs(a.keys(), b.keys(), runner.traces, project.store)}
    assert diffs["shout"].only_b == ["w1/w1.0", "w1/w1.1"] and not diffs["shout"].only_a
    parts = diffs["shout"].changed
    assert {part: len(shards) for part, shards in parts.items()} == {
        'parameters: backend "plain" -> "other"': 2, "code: ~toy.helper:MARK": 2}
    assert diffs["shout"].outputs == ["w0/w0.0", "w0/w0.1"] and "inputs: word" in diffs["pair"].changed
    assert compare_runs(a.keys(), a.keys(), runner.traces, project.store) == []
    back = {diff.stage: diff for diff in compare_runs(b.keys(), a.keys(), runner.traces, project.store)}
    assert back["shout"].only_a == ["w1/w1.0", "w1/w1.1"] and back.keys() == diffs.keys()


def test_old_runs_expire(project: Project) -> None:
    """Beyond a number or an age, with the tables of theirs alone; the last run stays."""
    for words in (("ab",), ("ab", "cd"), ("ab", "cd", "ef")):
        recorded(project, *words)
    assert list(expired(project.store)) == []
    newest, *others = run_paths(project.store)
    gone = list(expired(project.store, keep=1))
    assert gone[:2] == others and len(gone) == 4
    time.sleep(0.01)
    assert list(expired(project.store, days=0.0))[:2] == others
    for path in gone:
        path.unlink()
    assert find_run(project.store, "last").path == newest and find_run(project.store, "last").keys()


# -- credentials and resources -------------------------------------------------------------------------------------------


@pytest.mark.parametrize(("text", "shown"), [
    ("hand_inpaint.api_key=abc", "hand_inpaint.api_key=***"),
    ("see https://me:pw@host/x?X-Amz-Signature=abc&y=2", "see https://***@host/x?X-Amz-Signature=***&y=2"),
    ('{"accountKey": "abc", "a": 1}', '{"accountKey": "***", "a": 1}'),
    ("Authorization: Bearer abc.def", "Authorization: ***"),
    ("HF_TOKEN = 'abc def'", "HF_TOKEN = '***'"),
    ("chat.model=hf_abcdefghijklmnop", "chat.model=***"),
    ("sas_token=sv=1&sig=2", "sas_token=***"),
    ("mask_densify.key_frames=3", "mask_densify.key_frames=3"),
    ("chat.max_tokens=100", "chat.max_tokens=100"),
    ("monkey=1 keypoints: 21", "monkey=1 keypoints: 21"),
])  # fmt: skip
def test_credentials_are_hidden(text: str, shown: str) -> None:
    """Values of their names, passwords in URLs, and known kinds of tokens; other settings stay readable."""
    assert mask_text(text) == shown


def test_credentials_in_tables_are_hidden() -> None:
    """Values are hidden at any depth, by the name of the entry."""
    given = {"api_key": "a", "secret": ["b"], "sets": ["x.token=c", "x.radius=3"], "inner": {"password": 4, "n": 5}, "key": None}
    assert mask(given) == {"api_key": MASK, "secret": MASK, "sets": [f"x.token={MASK}", "x.radius=3"],
                           "inner": {"password": MASK, "n": 5}, "key": None}  # fmt: skip


def test_no_credential_is_in_a_log(project: Project) -> None:
    """Neither of the settings nor of a message of a failed task."""
    with RunLog(project.store, "all", {"sets": ["a.api_key=VERYSECRET"], "source": "s3://me:VERYSECRET@host/x"}) as log:
        log.planned("stage", "")
        log.finished("stage", "", "failed", 0.0, 0.0, "403 for https://host/x?sig=VERYSECRET")
    assert not [message for message in read_log(run_paths(project.store)[0]) if "VERYSECRET" in str(message)]


def test_resources_are_those_of_the_tree() -> None:
    """A child counts, with the memory that it holds."""
    before = tree_usage()
    code = "x = bytearray(64 << 20); print(flush=True); input()"
    child = subprocess.Popen([sys.executable, "-c", code], stdin=subprocess.PIPE, stdout=subprocess.PIPE)
    assert child.stdout is not None
    child.stdout.readline()
    during = tree_usage()
    child.communicate(b"\n")
    assert during.processes == before.processes + 1 and during.rss_mib > before.rss_mib + 50
    assert during.cpu_s >= before.cpu_s > 0


def test_the_graph_is_the_same_under_a_log(project: Project) -> None:
    """An observer changes no key."""
    plain = project.run("ab").outputs
    assert recorded(project, "ab").outputs == plain
    assert project.runner().plan(graph("ab"), "all")[0].status == "cached"
