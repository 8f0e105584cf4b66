"""Code that changes between its reading and its run: no output is stored under the key of other code."""

from __future__ import annotations

import os
import subprocess
import sys
import time
from pathlib import Path

import pytest
from toy_project import Project, graph, text

from runner.keys import CodeFingerprints
from runner.modules import Modules

ROOT = Path(__file__).resolve().parents[2]


@pytest.fixture
def project(tmp_path: Path) -> Project:
    return Project.make(tmp_path)


def test_an_edit_between_plan_and_run_is_no_poison(project: Project) -> None:
    """A long-lived runner reads the code again. After an undo the first code runs, and the second's output is not used."""
    runner = project.runner(1)
    runner.plan(graph("ab"), "all")
    project.edit("toy/helper.py", '"!"', '"?"')
    assert text(project, runner.run(graph("ab"), "all")) == "A A"
    edited = project.runner().load(runner.run(graph("ab"), "all").outputs["shout"][0][1])
    project.edit("toy/helper.py", '"?"', '"!"')
    undone = project.run("ab", jobs=1)
    assert edited.text == "AB0?" and project.runner().load(undone.outputs["shout"][0][1]).text == "AB0!"


def test_an_edit_of_the_same_size_with_its_time_kept_runs_again(project: Project, monkeypatch: pytest.MonkeyPatch) -> None:
    """Neither the runner's stamp nor Python's compiled code is accepted as current."""
    monkeypatch.delenv("PYTHONDONTWRITEBYTECODE", raising=False)  # workers keep compiled code
    path = project.root / "toy" / "helper.py"
    first = project.run("ab", jobs=1)
    assert list(path.parent.glob("__pycache__/helper.*.pyc")), "else there is nothing to be taken for current"
    before = path.stat()
    with path.open("r+") as stream:  # the inode stays
        changed = stream.read().replace('"!"', '"?"')
        stream.seek(0)
        stream.write(changed)
    os.utime(path, ns=(before.st_atime_ns, before.st_mtime_ns))
    second = project.run("ab", jobs=1)
    words = [project.runner().load(report.outputs["shout"][0][1]).text for report in (first, second)]
    assert words == ["AB0!", "AB0?"]


def test_code_edited_after_this_process_imported_it_is_refused_in_this_process(tmp_path: Path) -> None:
    """The imported code runs without worker processes, and its output must not have the key of the new code."""
    (tmp_path / "late").mkdir()
    (tmp_path / "late" / "one.py").write_text("from late.values import Word\nMARK = 1\ndef run(word: Word) -> Word:\n"
                                              "    return Word(word.name, word.text + str(MARK))\n")
    (tmp_path / "late" / "values.py").write_text((ROOT / "tests/toy_domain/toy/values.py").read_text())
    script = f"""
import sys; sys.path[:0] = [{str(tmp_path)!r}, {str(ROOT)!r}]
from pathlib import Path
from runner import Graph, Runner
from late import one
from late.values import Word
def graph():
    g = Graph(); g.target("all", g.add(one.run, word=g.leaf("w", Word("w", "x")))); return g
runner = Runner(Path({str(tmp_path / 'store')!r}), Path({str(tmp_path)!r}), "late.values:CODEC", jobs=0)
runner.plan(graph(), "all")
path = Path(one.__file__); path.write_text(path.read_text().replace("MARK = 1", "MARK = 2"))
report = runner.run(graph(), "all")
print(report.ok, report.failures[0].message if report.failures else "")
"""
    done = subprocess.run([sys.executable, "-c", script], capture_output=True, text=True, check=True)
    assert done.stdout.startswith("False") and "was edited after this process imported it" in done.stdout


def test_code_edited_after_its_import_is_refused_although_its_fingerprint_was_cached(tmp_path: Path) -> None:
    """An earlier process has computed the fingerprint, so that this one does not read the file before the edit."""
    (tmp_path / "late").mkdir()
    one = tmp_path / "late" / "one.py"
    one.write_text("from late.values import Word\nMARK = 1\ndef run(word: Word) -> Word:\n"
                   "    return Word(word.name, word.text + str(MARK))\n")
    (tmp_path / "late" / "values.py").write_text((ROOT / "tests/toy_domain/toy/values.py").read_text())
    script = f"""
import sys; sys.path[:0] = [{str(tmp_path)!r}, {str(ROOT)!r}]
from pathlib import Path
from runner import Graph, Runner
from late import one
from late.values import Word
def graph():
    g = Graph(); g.target("all", g.add(one.run, word=g.leaf("w", Word("w", "x")))); return g
runner = Runner(Path({str(tmp_path / 'store')!r}), Path({str(tmp_path)!r}), "late.values:CODEC", jobs=0)
assert runner.run(graph(), "all").ok
if sys.argv[1:]:
    path = Path(one.__file__); path.write_text(path.read_text().replace("MARK = 1", "MARK = 2"))
report = runner.run(graph(), "all")
print(report.ok, report.failures[0].message if report.failures else "")
"""
    time.sleep(0.1)  # younger files are not remembered
    for words in ([], ["edit"]):
        done = subprocess.run([sys.executable, "-c", script, *words], capture_output=True, text=True, check=True)
    assert (tmp_path / "store" / ".cache" / "specs.json").exists()
    assert done.stdout.startswith("False") and "was edited after this process imported it" in done.stdout


def test_a_cached_fingerprint_ends_with_the_code(project: Project) -> None:
    """A changed constant, and a module that hides another, are noticed; an unchanged project is not parsed again."""
    time.sleep(0.1)
    project.run("ab", jobs=1)
    runner = project.runner(1)
    assert runner.run(graph("ab"), "all").ran == {} and "toy.shout" not in runner.modules._modules
    project.edit("toy/helper.py", '"!"', '"?"')
    assert project.run("ab", jobs=1).ran == {"shout": 2, "pair": 2}


def test_an_edit_of_the_codec_runs_everything_again(project: Project) -> None:
    """The codec determines bytes."""
    project.run("ab", jobs=1)
    project.edit("toy/values.py", "json.dumps([value.name, value.text])", "json.dumps([value.name, value.text], indent=1)")
    plans = project.runner().plan(graph("ab"), "all")
    reasons = {str(plan.reason) for plan in plans if plan.stage == "split"}
    assert reasons == {"code changed: ~toy.values:ToyCodec"}


def test_codec_and_preparation_are_in_the_keys_of_what_they_touch() -> None:
    """The preparation is in the key of each stage; the video codec only in that of stages with frames."""
    from stages.extraction import affordance_intersect, frame_decode
    from stages.synthetic import object_plan

    codes = CodeFingerprints(Modules(ROOT), "afford.codecs:CODEC", "afford.common.worker:prepare")
    found = {stage.__name__.rpartition(".")[2]: codes.of(f"{stage.__name__}:run", stage.Params()).definitions
             for stage in (affordance_intersect, frame_decode, object_plan)}  # fmt: skip
    everywhere = {"afford.common.worker:prepare", "afford.codecs.structure:save", "afford.codecs.kinds:digest"}
    assert all(everywhere <= definitions.keys() for definitions in found.values())
    assert "afford.codecs.video:write_video" in found["frame_decode"]
    assert "afford.codecs.video:write_video" not in found["object_plan"]
    assert not any(name.startswith("schemas.hand:") for name in found["object_plan"]), "a codec brings no other schemas"
