"""Plain English in sources, pages and commits: the rules of `tests/helpers/prose.py` hold everywhere."""

from __future__ import annotations

import subprocess
from pathlib import Path

import pytest

from tests.helpers import prose

ROOT = Path(__file__).resolve().parents[2]
ROOMS = ("afford", "stages", "schemas", "runner", "commands", "maps", "install", "benchmarks", "tests", "docs")
RULES = {ROOT / "tests" / "helpers" / "prose.py", Path(__file__).resolve()}
"""files that quote what the rules refuse"""
COMMITS = 60
SAVED = {
    "afford/extraction/quality_report.py": "told", "benchmarks/extraction.md": "told",  # row of a report
    "afford/grasping/env/task.py": "told", "benchmarks/bench_grasp.py": "told",  # field of GraspTask, block of a page
    "docs/decisions/017-small-sor3d-variant.md": "told",  # field of the model's config
    "afford/grasping/evaluate/comparisons.py": "nobody", "afford/grasping/judge.py": "told",  # row of a report, prompt
    "afford/recording/interactions.py": "said", "afford/recording/messages.py": "said",  # message of recordings
    "afford/surface/describe/prompt.py": "somebody", "afford/twohands/model/vlm.py": "somebody",  # prompts
    "tests/surface/test_describe_prompt.py": "somebody",
    "afford/surface/negative/score_report.py": "said", "afford/surface/score/train_scorer.py": "told",  # report, card
    "afford/twohands/train/job.py": "said",  # card
    "afford/twohands/benchmark/predictions_file.py": "told tells"}  # description of a column
"""file -> words in the text of an output, whose bytes stay, or in the name of a field"""


@pytest.mark.parametrize("room", [*ROOMS, "."])
def test_sources_and_pages_follow_the_rules(room: str) -> None:
    """Files of a room; those of the project's own folder for '.'."""
    every = (ROOT / room).glob("*") if room == "." else (ROOT / room).rglob("*")
    paths = [path for path in sorted(every) if path.suffix in (".py", ".md") and path.resolve() not in RULES]
    assert paths
    found = [(path.relative_to(ROOT).as_posix(), fault) for path in paths for fault in prose.in_file(path)]
    faults = [f"{path}:{fault.line}: {fault.reason}" for path, fault in found
              if not any(f"'{word}'" in fault.reason.lower() for word in SAVED.get(path, "").split())]  # fmt: skip
    assert not faults, "\n".join(faults)


@pytest.mark.parametrize("source", [
    '"""What a step brings."""', 'def f():\n    """Whether it holds."""', "x = 1  # nobody reads it",
    'raise ValueError("a file that is none")', "def test_never_is_never(): ...", "def test_model_told_twice(): ...",
    '"""Retry. The step is taken anew."""'])  # fmt: skip
def test_planted_fault_in_a_source_is_found(source: str) -> None:
    """One fault of each kind."""
    assert len(prose.in_python(source)) == 1


def test_planted_faults_in_a_page_are_found_outside_code_and_generated_blocks() -> None:
    """Line numbers are those of the page."""
    block = "<!-- results: written by benchmarks/x.py -->\nnobody\n<!-- end of results -->"
    page = f"# Model\n\n```sh\n# nobody\n```\n{block}\n\n## What it does\n\nThe model is told a task."
    assert [fault.line for fault in prose.in_markdown(page)] == [10, 12]


@pytest.mark.parametrize("subject", ["Lines of a paragraph", "docs: " + "x" * 70, "docs: Rewrap", "a word in its place"])
def test_planted_fault_in_a_commit_is_found(subject: str) -> None:
    """Form and length."""
    assert prose.in_commit(subject)


def test_commits_follow_the_form() -> None:
    """The newest commits of a clone; skipped without git."""
    command = ("git", "log", "--no-merges", f"-{COMMITS}", "--format=%s")
    done = subprocess.run(command, cwd=ROOT, capture_output=True, text=True)
    if done.returncode:
        pytest.skip("not a git checkout")
    assert not [(subject, faults) for subject in done.stdout.splitlines() if (faults := prose.in_commit(subject))]
