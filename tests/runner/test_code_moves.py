"""Keys are independent of code locations: moved code runs nothing again, a name that refers to other code does."""

from __future__ import annotations

from pathlib import Path

import pytest

from runner import Graph, Runner, StoreError
from runner.fingerprint import changed
from tests.helpers.editable_project import EditableProject

ROOT = Path(__file__).resolve().parents[2]
MAIN = """
import sys
from pathlib import Path
from runner import Graph, Runner
from pkg.shout import Params, run
from pkg.values import Word
g = Graph()
word = g.leaf("w", Word("w", "ab"))
one = g.named("shout").add(run, word=word, params=Params())
g.target("all", g.named("sign").add(run, word=one, params=Params()))
runner = Runner(Path("store"), Path("."), "pkg.values:CODEC", jobs=0)
plans = [str(plan.reason) for plan in runner.plan(g, "all") if plan.status == "run"]
report = runner.run(g, "all")
assert report.ok, report.failures
print(sum(report.ran.values()), runner.load(report.outputs["sign"][0][1]).text, *plans, sep="|")
"""
SHOUT = """
from __future__ import annotations
from dataclasses import dataclass
from pkg.helper import end, loud
from pkg.values import Word
BACKENDS = {"up": "pkg.upper:up", "down": "pkg.lower:down"}

@dataclass(frozen=True)
class Params:
    backend: str = "up"

def run(word: Word, params: Params) -> Word:
    from pkg.mark import MARK
    from pkg.load import load
    return Word(word.name, load(BACKENDS[params.backend])(end(loud(word.text))) + MARK)
"""
FILES = {
    "main.py": MAIN, "pkg/__init__.py": "", "pkg/shout.py": SHOUT,
    "pkg/values.py": (ROOT / "tests/toy_domain/toy/values.py").read_text(),
    "pkg/helper.py": "def loud(text: str) -> str:\n    return text + '!'\n\n\n"
                       "def end(text: str) -> str:\n    return text + '.'\n",
    "pkg/mark.py": "MARK = '?'\n",
    "pkg/load.py": "import importlib\n\nDYNAMIC = ()\n\n\ndef load(entry):\n    module, name = entry.split(':')\n"
                     "    return getattr(importlib.import_module(module), name)\n",
    "pkg/upper.py": "def up(text: str) -> str:\n    return text.upper()\n",
    "pkg/lower.py": "def down(text: str) -> str:\n    return text.lower()\n"}


@pytest.fixture
def project(tmp_path: Path) -> EditableProject:
    """Project that ran once."""
    made = EditableProject.build(tmp_path, FILES)
    assert made.play()[:2] == (2, "AB!.?!.?".upper())
    return made


MOVES = {
    "a stage": [("pkg/shout.py", "pkg/deep/words/shout.py")],
    "a helper": [("pkg/helper.py", "pkg/text/helper.py")],
    "what a function imports": [("pkg/mark.py", "pkg/signs/mark.py")],
    "a backend": [("pkg/upper.py", "pkg/backends/other_name.py")],
    "the codec and the schemas": [("pkg/values.py", "pkg/nouns.py")],
    "a whole folder": [("pkg", "palace/of/words")],
    "everything, one after the other": [
        ("pkg/helper.py", "pkg/a/helper.py"), ("pkg/upper.py", "pkg/b/upper.py"), ("pkg/shout.py", "pkg/c/loud.py"),
        ("pkg/values.py", "pkg/d/values.py"), ("pkg", "castle")]}


@pytest.mark.parametrize("case", MOVES)
def test_code_that_moves_runs_nothing(case: str, project: EditableProject) -> None:
    """0 tasks run, and none is planned."""
    for old, new in MOVES[case]:
        project.move(old, new)
    assert project.play() == (0, "AB!.?!.?", [])


def test_a_module_that_is_split_in_two_runs_nothing(project: EditableProject) -> None:
    """Merging two modules runs nothing either."""
    loud, end = FILES["pkg/helper.py"].split("\n\n\n")
    (project.root / "pkg/helper.py").write_text(loud)
    (project.root / "pkg/ends.py").write_text(end)
    project.edit("pkg/shout.py", "from pkg.helper import end, loud", "from pkg.ends import end\nfrom pkg.helper import loud")
    assert project.play()[0] == 0
    (project.root / "pkg/ends.py").write_text(end + "\n" + FILES["pkg/mark.py"] + FILES["pkg/upper.py"])
    (project.root / "pkg/mark.py").unlink()
    (project.root / "pkg/upper.py").unlink()
    project.edit("pkg/shout.py", "pkg.mark", "pkg.ends")
    project.edit("pkg/shout.py", "pkg.upper", "pkg.ends")
    assert project.play() == (0, "AB!.?!.?", [])


CHANGES = {
    "two helpers swap what they do": ("pkg/helper.py", [("'!'", "'#'"), ("'.'", "'!'"), ("'#'", "'.'")], "AB.!?.!?",
                                      "~pkg.helper:end, ~pkg.helper:loud"),
    "two imports swap their names": ("pkg/shout.py", [("import end, loud", "import end as loud, loud as end")], "AB.!?.!?",
                                     "same definitions, reached through other names"),
    "a constant": ("pkg/mark.py", [("?", "+")], "AB!.+!.+", "~pkg.mark:MARK"),
    "the entry of a registry": ("pkg/shout.py", [("pkg.upper:up", "pkg.lower:down")], "ab!.?!.?",
                                "+pkg.lower:down, -pkg.upper:up"),
    "a default of a parameter": ("pkg/shout.py", [('= "up"', '= "down"')], "ab!.?!.?", "")}


@pytest.mark.parametrize("case", CHANGES)
def test_names_that_lead_elsewhere_run_again(case: str, project: EditableProject) -> None:
    """The output is that of the new code, and the reason names the definitions."""
    file, edits, text, reason = CHANGES[case]
    for old, new in edits:
        project.edit(file, old, new)
    ran, found, plans = project.play()
    assert (ran, found) == (2, text)
    assert plans[0] == (f"code changed: {reason}" if reason else 'parameter changed: backend "up" -> "down"')


def test_an_edit_after_a_move_is_named_at_its_new_place(project: EditableProject) -> None:
    """The move is not part of the reason."""
    project.move("pkg/helper.py", "pkg/text/helper.py")
    project.edit("pkg/text/helper.py", "'.'", "';'")
    assert project.play()[2][0] == "code changed: ~pkg.text.helper:end"


def test_another_name_on_the_map_runs_nothing(project: EditableProject) -> None:
    """The name is a label outside the key: two names of one function share outputs."""
    project.edit("main.py", 'g.named("shout")', 'g.named("call")')
    assert project.play() == (0, "AB!.?!.?", [])


def test_two_functions_that_are_the_same_share_what_they_made(project: EditableProject) -> None:
    """A copy of a stage in another module has the same key."""
    (project.root / "pkg/copy.py").write_text(FILES["pkg/shout.py"])
    project.edit("main.py", "from pkg.shout", "from pkg.copy")
    assert project.play()[0] == 0


@pytest.mark.parametrize(("old", "new", "names"), [
    ({"a:f": "1", "a:g": "2"}, {"b:f": "1", "c:g": "2"}, []),
    ({"a:f": "1", "a:g": "2"}, {"b:f": "3", "c:g": "2"}, ["~b:f"]),
    ({"a:f": "1", "b:f": "2"}, {"a:f": "2", "b:f": "1"}, []),
    ({"a:f": "1", "b:f": "1"}, {"c:f": "1"}, ["-b:f"]),
    ({"a:f": "1"}, {"b:f": "2", "c:f": "3"}, ["+b:f", "+c:f", "-a:f"]),
    ({"a:f": "1"}, {"a:f": "1", "b:g": "1"}, ["+b:g"])])
def test_changed_definitions_differ_from_moved_ones(old: dict[str, str], new: dict[str, str], names: list[str]) -> None:
    """Compared by bare name and digest; ambiguous definitions count as removed and added."""
    assert changed(old, new) == names


def test_a_store_of_a_former_version_is_refused(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """One sentence with advice, instead of computing everything again."""
    from toy import split
    from toy.values import Word

    monkeypatch.setenv("TOY_LOG", str(tmp_path / "log"))
    code, g = ROOT / "tests" / "toy_domain", Graph()
    g.target("all", g.add(split.run, word=g.leaf("w", Word("w", "ab")), params=split.Params()))
    with monkeypatch.context() as former:
        former.setattr("runner.store.FORMAT", "afford-store-2")
        assert Runner(tmp_path / "store", code, "toy.values:CODEC", jobs=0).run(g, "all").ok
    with pytest.raises(StoreError, match=r"another format \(expected afford-store-4, got afford-store-2\); delete it"):
        Runner(tmp_path / "store", code, "toy.values:CODEC", jobs=0)
    (tmp_path / "older" / "manifests").mkdir(parents=True)
    with pytest.raises(StoreError, match="got a previous one"):
        Runner(tmp_path / "older", code, "toy.values:CODEC", jobs=0)
