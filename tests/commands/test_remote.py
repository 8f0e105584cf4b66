"""The option --remote and the variable AFFORD_REMOTE: results of one store serve another."""

from __future__ import annotations

import json
import warnings
from pathlib import Path

import pytest

from runner import objects
from runner.remote import RemoteWarning
from tests.helpers.command import Made, call


def counts(out: str) -> tuple[int, int]:
    """(tasks that ran, tasks that were cached) of the last line of a run."""
    last = json.loads(out.splitlines()[-1])
    return sum(last["ran"].values()), sum(last["cached"].values())


def test_a_remote_serves_another_store(made: Made, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """One store computes, the other computes nothing and publishes the same outputs; status and explain agree."""
    words = ["run", "extraction-report", "--source", made.source, "--jobs", "0", "--json"]
    first = call(*words, "--store", tmp_path / "one", "--remote", tmp_path / "shared")
    assert first.code == 0, first.err
    status = call("status", "extraction-report", "--source", made.source, "--store", tmp_path / "one", "--json")
    assert '"run"' not in status.out
    monkeypatch.setenv("AFFORD_REMOTE", str(tmp_path / "shared"))
    second = call(*words, "--store", tmp_path / "two")
    assert second.code == 0 and counts(second.out) == (0, sum(counts(first.out)))
    one, two = (json.loads(run.out.splitlines()[-1])["outputs"] for run in (first, second))
    assert one.keys() == two.keys()
    for name in one:
        files = [sorted(path for path in Path(out[name]).rglob("*") if path.is_file()) for out in (one, two)]
        assert [path.read_bytes() for path in files[0]] == [path.read_bytes() for path in files[1]]
    explained = call("explain", "--target", "extraction-report", "--source", made.source, "--store", tmp_path / "two", "--json")
    assert explained.code == 0 and {task["status"] for task in explained.json["tasks"]} == {"cached"}


def test_bad_urls_are_usage_errors(tmp_path: Path) -> None:
    """One sentence, exit code 2, and no credential in it."""
    for url in ("ftp://host/x", "s3://KEY:hush-hush@bucket/x", str(tmp_path / "none" / "x")):
        run = call("run", "dataset", "--store", tmp_path / "store", "--remote", url)
        assert run.code == 2 and run.err.startswith("error: --remote: ") and run.err.count("\n") == 1
        assert "hush" not in run.err


def test_an_unreachable_remote_is_one_warning(made: Made, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """The status of the local store is shown."""
    monkeypatch.setattr(objects, "RETRY", {"max_retries": 0})
    for name, value in {"AWS_ACCESS_KEY_ID": "AKIDX", "AWS_SECRET_ACCESS_KEY": "hush-hush", "AWS_REGION": "us-east-1",
                        "AWS_ENDPOINT_URL": "http://127.0.0.1:9"}.items():  # fmt: skip
        monkeypatch.setenv(name, value)
    words = ["--source", made.source, "--store", made.copy(tmp_path).store, "--remote", "s3://bucket/x"]
    with pytest.warns(RemoteWarning) as caught:
        assert call("status", "dataset", *words).code == 0
    assert len(caught) == 1
    shown = warnings.formatwarning(caught[0].message, caught[0].category, "a.py", 1)
    assert shown.startswith("warning: the remote cannot be used") and "hush" not in shown and "AKIDX" not in shown
