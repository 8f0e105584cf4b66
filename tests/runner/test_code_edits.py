"""Fingerprints under edits: measured by running the code, the fingerprint changes with the output, or the code is refused."""

from __future__ import annotations

import re
from collections import Counter
from pathlib import Path

import pytest

from runner.fingerprint import fingerprint
from runner.modules import Modules
from runner.source import SourceError
from tests.helpers.edited_code import CASES as EDITED
from tests.helpers.edited_code import FOLLOWED, REFUSED, SAME, Case, Verdict, counts, judge
from tests.helpers.moved_code import LED_ELSEWHERE, MOVED
from tests.helpers.stage_files import MODULES

ROOT = Path(__file__).resolve().parents[2]
STAGES = [f"{module}:run" for module in MODULES.values()]
RAISED = re.compile(r"^\w*(Error|Exception): ")
CASES = [*EDITED, *MOVED, *LED_ELSEWHERE]
PLACE = re.compile(r"^/.*/old/[\w/]+\.py:[1-9]\d*: .+")


@pytest.fixture(scope="module")
def verdicts(tmp_path_factory: pytest.TempPathFactory) -> dict[str, Verdict]:
    """Verdicts of all cases in `tests/helpers/edited_code.py`, measured together."""
    return {verdict.case.name: verdict for verdict in judge(tmp_path_factory.mktemp("edits"), CASES)}


def _names(want: str) -> list[str]:
    return [case.name for case in CASES if case.want == want]


@pytest.mark.parametrize("name", _names(FOLLOWED))
def test_edit_of_code_that_runs_changes_the_fingerprint(name: str, verdicts: dict[str, Verdict]) -> None:
    """The output changes, and so does the key; a stage that does not use the code keeps its key."""
    found = verdicts[name]
    assert found.outputs[0] != found.outputs[1] and not any(map(RAISED.match, found.outputs)), "the case must show what it says"
    assert (found.outcome, found.control) == ("right", True), found.message


@pytest.mark.parametrize("name", _names(REFUSED))
def test_code_that_cannot_be_followed_is_refused_with_file_and_line(name: str, verdicts: dict[str, Verdict]) -> None:
    """The edit would change the output unnoticed, so the code is refused in one sentence with advice."""
    found = verdicts[name]
    assert found.outputs[0] != found.outputs[1] and not any(map(RAISED.match, found.outputs)), "the case must show what it says"
    assert (found.outcome, found.control) == ("refused", True)
    assert PLACE.match(found.message) and ";" in found.message


@pytest.mark.parametrize("name", _names(SAME))
def test_edit_of_what_does_not_run_keeps_the_fingerprint(name: str, verdicts: dict[str, Verdict]) -> None:
    """Comments, docstrings, layout, and code that is loaded but not used."""
    found = verdicts[name]
    assert found.outputs[0] == found.outputs[1] and not RAISED.match(found.outputs[0]), "the case must show what it says"
    assert (found.outcome, found.control) == ("right", True), found.message


def test_counts_of_edits(verdicts: dict[str, Verdict]) -> None:
    """No case is stale or runs needlessly; the names of the cases are unique."""
    assert max(Counter(case.name for case in CASES).values()) == 1
    assert counts(list(verdicts.values())) == {
        "right": len(_names(FOLLOWED)) + len(_names(SAME)), "refused": len(_names(REFUSED)), "over": 0, "stale": 0, "control": 0}


def test_stages_have_fingerprints_and_the_cache_gives_the_same(tmp_path: Path) -> None:
    """No stage uses refused code, for any backend, and cached parses give the same fingerprints."""
    first = Modules(ROOT, tmp_path / "modules")
    read = {stage: fingerprint(first, stage, {}) for stage in STAGES}
    first.save()
    second = Modules(ROOT, tmp_path / "modules")
    assert {stage: fingerprint(second, stage, {}) for stage in STAGES} == read


@pytest.mark.parametrize("entry", ["afford.codecs:CODEC", "afford.codecs.structure:save", "afford.codecs.structure:load",
                                   "afford.codecs.kinds:digest", "afford.common.worker:prepare"])
def test_codec_and_preparation_of_workers_have_a_fingerprint(entry: str) -> None:
    """Keys contain their code, because they determine bytes."""
    assert entry in fingerprint(Modules(ROOT), entry, {}).definitions


def test_a_program_that_a_stage_starts_is_part_of_its_code() -> None:
    """Training on several devices runs `afford.training.distributed` in its own processes."""
    found = fingerprint(Modules(ROOT), "stages.twohands.model_train:run", {}).definitions
    assert {"afford.training.distributed:main", "afford.training.distributed:__main__"} <= found.keys()


LINES = [
    ("an import that does not exist", "=== stage.py\nimport math\nfrom pack.gone import f\ndef run(x=3):\n    return f(x)\n"
     "=== pack/__init__.py\n", "stage.py:2: the import of 'pack.gone'"),
    ("an entry that does not exist", "=== stage.py\n\nBACKENDS = {'a': 'pack.gone:f'}\ndef run(x=3):\n    return BACKENDS\n"
     "=== pack/__init__.py\n", r"stage.py:2: BACKENDS\['a'\]: 'pack.gone' is not a module of this project"),
    ("an entry whose name does not exist", "=== stage.py\n\nBACKENDS = {'a': 'pack:gone'}\ndef run(x=3):\n    return BACKENDS\n"
     "=== pack/__init__.py\n", r"stage.py:2: BACKENDS\['a'\]: the module 'pack' has no 'gone'"),
    ("a stage that does not exist", "=== stage.py\n", "stage:run: the module 'stage' has no 'run'"),
    ("data that is not there", "=== stage.py\nDATA_FILES = ('gone.csv',)\ndef run(x=3):\n    return x\n",
     "stage.py:1: DATA_FILES names 'gone.csv'"),
    ("a module in DYNAMIC that is not there", "=== stage.py\nDYNAMIC = ('gone',)\ndef run(x=3):\n    return x\n",
     "stage.py:1: DYNAMIC: 'gone' is not a module of this project"),
    ("syntax", "=== stage.py\ndef run(x=3):\n    return (\n", "stage.py:2: "),
    ("a state set deep in a class", "=== stage.py\nimport numpy as np\n\nclass C:\n    k = 1\n    np.seterr(all='raise')\n"
     "def run(x=3):\n    return x\n", "stage.py:5: importing this module sets global state of 'numpy'"),
    ("a second line of a statement", "=== stage.py\ndef run(x=3):\n    y = x\n    return [\n        y,\n        eval('x')]\n",
     r"stage.py:5: eval\(\) cannot be followed"),
]


@pytest.mark.parametrize(("name", "text", "message"), LINES)
def test_errors_name_the_line(name: str, text: str, message: str, tmp_path: Path) -> None:
    """The line is that of the use, not of the enclosing definition."""
    for file, content in Case(name, REFUSED, text).files(1).items():
        (tmp_path / file).parent.mkdir(exist_ok=True)
        (tmp_path / file).write_text(content)
    with pytest.raises(SourceError, match=message):
        fingerprint(Modules(tmp_path), "stage:run", {})


def test_a_tuple_selects_several_entries(tmp_path: Path) -> None:
    """A parameter that lists names follows those entries; with an unknown name all entries count."""
    (tmp_path / "stage.py").write_text("METHODS = {'a': 'm:a', 'b': 'm:b', 'c': 'm:c'}\ndef run(x=3):\n    return METHODS\n")
    (tmp_path / "m.py").write_text("a = 1\nb = 2\nc = 3\n")
    modules = Modules(tmp_path)

    def reached(method: object) -> set[str]:
        return {name[2:] for name in fingerprint(modules, "stage:run", {"method": method}).definitions if name.startswith("m:")}

    assert [reached(chosen) for chosen in ("a", ("a", "c"), ("a", "gone"), (), 3)] == [
        {"a"}, {"a", "c"}, {"a", "b", "c"}, {"a", "b", "c"}, {"a", "b", "c"}]
