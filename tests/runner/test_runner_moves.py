"""Keys are free of locations: code that moves makes nothing again, a name that leads elsewhere does."""

from __future__ import annotations

from pathlib import Path

import pytest

from runner import Graph, Runner, StoreError
from runner.fingerprint import changed
from tests.helpers.house import House

ROOT = Path(__file__).resolve().parents[2]
MAIN = """
import sys
from pathlib import Path
from runner import Graph, Runner
from house.shout import Params, run
from house.values import Word
g = Graph()
word = g.leaf("w", Word("w", "ab"))
one = g.named("shout").add(run, word=word, params=Params())
g.target("all", g.named("sign").add(run, word=one, params=Params()))
runner = Runner(Path("store"), Path("."), "house.values:CODEC", jobs=0)
plans = [str(plan.reason) for plan in runner.plan(g, "all") if plan.status == "run"]
report = runner.run(g, "all")
assert report.ok, report.failures
print(sum(report.ran.values()), runner.load(report.outputs["sign"][0][1]).text, *plans, sep="|")
"""
SHOUT = """
from __future__ import annotations
from dataclasses import dataclass
from house.helper import end, loud
from house.values import Word
BACKENDS = {"up": "house.upper:up", "down": "house.lower:down"}

@dataclass(frozen=True)
class Params:
    backend: str = "up"

def run(word: Word, params: Params) -> Word:
    from house.mark import MARK
    from house.load import load
    return Word(word.name, load(BACKENDS[params.backend])(end(loud(word.text))) + MARK)
"""
FILES = {
    "main.py": MAIN, "house/__init__.py": "", "house/shout.py": SHOUT,
    "house/values.py": (ROOT / "tests/toy_domain/toy/values.py").read_text(),
    "house/helper.py": "def loud(text: str) -> str:\n    return text + '!'\n\n\n"
                       "def end(text: str) -> str:\n    return text + '.'\n",
    "house/mark.py": "MARK = '?'\n",
    "house/load.py": "import importlib\n\nDYNAMIC = ()\n\n\ndef load(entry):\n    module, name = entry.split(':')\n"
                     "    return getattr(importlib.import_module(module), name)\n",
    "house/upper.py": "def up(text: str) -> str:\n    return text.upper()\n",
    "house/lower.py": "def down(text: str) -> str:\n    return text.lower()\n"}


@pytest.fixture
def house(tmp_path: Path) -> House:
    """The project, run once."""
    made = House.build(tmp_path, FILES)
    assert made.play()[:2] == (2, "AB!.?!.?".upper())
    return made


MOVES = {
    "a stage": [("house/shout.py", "house/deep/words/shout.py")],
    "a helper": [("house/helper.py", "house/text/helper.py")],
    "what a function imports": [("house/mark.py", "house/signs/mark.py")],
    "a backend": [("house/upper.py", "house/backends/other_name.py")],
    "the codec and the schemas": [("house/values.py", "house/nouns.py")],
    "a whole folder": [("house", "palace/of/words")],
    "everything, one after the other": [
        ("house/helper.py", "house/a/helper.py"), ("house/upper.py", "house/b/upper.py"), ("house/shout.py", "house/c/loud.py"),
        ("house/values.py", "house/d/values.py"), ("house", "castle")]}


@pytest.mark.parametrize("case", MOVES)
def test_code_that_moves_runs_nothing(case: str, house: House) -> None:
    """0 tasks, and nothing is planned."""
    for old, new in MOVES[case]:
        house.move(old, new)
    assert house.play() == (0, "AB!.?!.?", [])


def test_a_module_that_is_split_in_two_runs_nothing(house: House) -> None:
    """So do two modules that become one."""
    loud, end = FILES["house/helper.py"].split("\n\n\n")
    (house.root / "house/helper.py").write_text(loud)
    (house.root / "house/ends.py").write_text(end)
    house.edit("house/shout.py", "from house.helper import end, loud", "from house.ends import end\nfrom house.helper import loud")
    assert house.play()[0] == 0
    (house.root / "house/ends.py").write_text(end + "\n" + FILES["house/mark.py"] + FILES["house/upper.py"])
    (house.root / "house/mark.py").unlink()
    (house.root / "house/upper.py").unlink()
    house.edit("house/shout.py", "house.mark", "house.ends")
    house.edit("house/shout.py", "house.upper", "house.ends")
    assert house.play() == (0, "AB!.?!.?", [])


CHANGES = {
    "two helpers swap what they do": ("house/helper.py", [("'!'", "'#'"), ("'.'", "'!'"), ("'#'", "'.'")], "AB.!?.!?",
                                      "~house.helper:end, ~house.helper:loud"),
    "two imports swap their names": ("house/shout.py", [("import end, loud", "import end as loud, loud as end")], "AB.!?.!?",
                                     "the same definitions, reached by other names"),
    "a constant": ("house/mark.py", [("?", "+")], "AB!.+!.+", "~house.mark:MARK"),
    "the entry of a registry": ("house/shout.py", [("house.upper:up", "house.lower:down")], "ab!.?!.?",
                                "+house.lower:down, -house.upper:up"),
    "a default of a parameter": ("house/shout.py", [('= "up"', '= "down"')], "ab!.?!.?", "")}


@pytest.mark.parametrize("case", CHANGES)
def test_names_that_lead_elsewhere_run_again(case: str, house: House) -> None:
    """The output is that of the new code, and the reason names the definitions."""
    file, edits, text, reason = CHANGES[case]
    for old, new in edits:
        house.edit(file, old, new)
    ran, found, plans = house.play()
    assert (ran, found) == (2, text)
    assert plans[0] == (f"code changed: {reason}" if reason else 'parameter changed: backend "up" -> "down"')


def test_an_edit_after_a_move_is_named_at_its_new_place(house: House) -> None:
    """The move is no part of the reason."""
    house.move("house/helper.py", "house/text/helper.py")
    house.edit("house/text/helper.py", "'.'", "';'")
    assert house.play()[2][0] == "code changed: ~house.text.helper:end"


def test_another_name_on_the_map_runs_nothing(house: House) -> None:
    """The name is a label outside the key: two names for one function share what they made."""
    house.edit("main.py", 'g.named("shout")', 'g.named("call")')
    assert house.play() == (0, "AB!.?!.?", [])


def test_two_functions_that_are_the_same_share_what_they_made(house: House) -> None:
    """A copy of a stage in another module is the stage again."""
    (house.root / "house/copy.py").write_text(FILES["house/shout.py"])
    house.edit("main.py", "from house.shout", "from house.copy")
    assert house.play()[0] == 0


@pytest.mark.parametrize(("old", "new", "names"), [
    ({"a:f": "1", "a:g": "2"}, {"b:f": "1", "c:g": "2"}, []),
    ({"a:f": "1", "a:g": "2"}, {"b:f": "3", "c:g": "2"}, ["~b:f"]),
    ({"a:f": "1", "b:f": "2"}, {"a:f": "2", "b:f": "1"}, []),
    ({"a:f": "1", "b:f": "1"}, {"c:f": "1"}, ["-b:f"]),
    ({"a:f": "1"}, {"b:f": "2", "c:f": "3"}, ["+b:f", "+c:f", "-a:f"]),
    ({"a:f": "1"}, {"a:f": "1", "b:g": "1"}, ["+b:g"])])
def test_changes_of_definitions_are_told_from_moves(old: dict[str, str], new: dict[str, str], names: list[str]) -> None:
    """By the bare name and the digest; what cannot be told apart came and went."""
    assert changed(old, new) == names


def test_a_store_of_a_former_version_is_refused(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """In one sentence that says what to do, instead of making all of it again."""
    from toy import split
    from toy.values import Word

    monkeypatch.setenv("TOY_LOG", str(tmp_path / "log"))
    code, g = ROOT / "tests" / "toy_domain", Graph()
    g.target("all", g.add(split.run, word=g.leaf("w", Word("w", "ab")), params=split.Params()))
    with monkeypatch.context() as former:
        former.setattr("runner.files.FORMAT", "afford-store-2")
        former.setattr("runner.runner.FORMAT", "afford-store-2")
        assert Runner(tmp_path / "store", code, "toy.values:CODEC", jobs=0).run(g, "all").ok
    with pytest.raises(StoreError, match=r"former version \(expected afford-store-3, got afford-store-2\).*; delete it, or choose"):
        Runner(tmp_path / "store", code, "toy.values:CODEC", jobs=0)
