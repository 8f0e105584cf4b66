"""Parameters by backend: the block of a backend that is not selected is not in the key."""

from __future__ import annotations

from copy import deepcopy
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import pytest

from runner.canonical import canonical
from runner.fingerprint import fingerprint
from runner.keys import seed_of
from runner.modules import Modules
from runner.selection import Unselected, declarations, hide_unselected, unselected, without_blocks
from tests.helpers.editable_project import EditableProject

ROOT = Path(__file__).resolve().parents[2]
MAIN = """
import json
from pathlib import Path
from runner import Graph, Runner, keys
from pkg.stage import *
from pkg.values import Word
keys._versions.update(json.loads(Path("versions.json").read_text()))
g = Graph()
g.target("all", g.add(run, word=g.leaf("w", Word("w", "ab")), params=Params()))
runner = Runner(Path("store"), Path("."), "pkg.values:CODEC", jobs=JOBS)
plans = [str(plan.reason) for plan in runner.plan(g, "all") if plan.status == "run"]
report = runner.run(g, "all")
result = report.failures[0].message if report.failures else runner.load(report.outputs["stage"][0][1]).text
print(sum(report.ran.values()), result, *plans, sep="|")
"""
STAGE = """
from __future__ import annotations
from dataclasses import dataclass
from pkg.flow import Flow
from pkg.load import load
from pkg.sam2 import Sam2
from pkg.values import Word

BACKENDS = {"flow": "pkg.flow:mark", "sam-2": "pkg.sam2:mark"}
LIBRARIES = ("one",)
BACKEND_LIBRARIES = {"sam-2": ("two",), "flow": ("three",)}

@dataclass(frozen=True)
class Params:
    backend: str = "flow"
    flow: Flow = Flow()
    sam_2: Sam2 = Sam2()
    end: str = "."

def run(word: Word, params: Params) -> Word:
    block = getattr(params, params.backend.replace("-", "_"))
    return Word(word.name, load(BACKENDS[params.backend])(word.text, block) + params.end)
"""
BLOCK = """
from __future__ import annotations
from dataclasses import dataclass

@dataclass(frozen=True)
class {name}:
    sign: str = "{sign}"

    def twice(self) -> str:
        return self.sign * 2

def mark(text: str, params: {name}) -> str:
    return text + params.twice()
"""
FILES = {
    "main.py": MAIN.replace("JOBS", "0"), "versions.json": '{"one": "1", "two": "1", "three": "1"}', "pkg/__init__.py": "",
    "pkg/stage.py": STAGE, "pkg/flow.py": BLOCK.format(name="Flow", sign="~"),
    "pkg/sam2.py": BLOCK.format(name="Sam2", sign="#"),
    "pkg/values.py": (ROOT / "tests/toy_domain/toy/values.py").read_text(),
    "pkg/load.py": "import importlib\n\nDYNAMIC = ()\n\n\ndef load(entry):\n    module, name = entry.split(':')\n"
                     "    return getattr(importlib.import_module(module), name)\n"}


@pytest.fixture
def project(tmp_path: Path) -> EditableProject:
    """Project that ran once with the backend `flow`."""
    made = EditableProject.build(tmp_path, FILES)
    assert made.play()[:2] == (1, "ab~~.")
    return made


EDITS = {
    "a new field": ('    sign: str = ', '    size: int = 3\n    sign: str = '),
    "a default": ('"#"', '"+"'),
    "a method": ("self.sign * 2", "self.sign * 1 + self.sign"),
    "a docstring and a new class": ("class Sam2:", 'class Base:\n    pass\n\n@dataclass(frozen=True)\nclass Sam2(Base):'),
    "the backend itself": ("return text +", "return text + '' +")}


@pytest.mark.parametrize("case", EDITS)
def test_an_edit_of_a_block_runs_again_only_what_selects_it(case: str, project: EditableProject) -> None:
    """0 tasks for the unselected backend; for the selected one the task, with the changed name as the reason."""
    old, new = EDITS[case]
    project.edit("pkg/sam2.py", old, new)
    assert project.play() == (0, "ab~~.", [])
    project.edit("pkg/flow.py", old.replace("#", "~").replace("Sam2", "Flow"), new.replace("Sam2", "Flow"))
    ran, _, reasons = project.play()
    assert ran == 1 and reasons[0].startswith(("code changed: ", "parameter changed: flow."))


def test_a_new_value_of_a_block_runs_again_only_what_selects_it(project: EditableProject) -> None:
    """The reason names the parameter as 'block.name'."""
    project.edit("pkg/stage.py", "= Sam2()", "= Sam2('&')")
    assert project.play() == (0, "ab~~.", [])
    project.edit("pkg/stage.py", "= Flow()", "= Flow('&')")
    assert project.play() == (1, "ab&&.", ['parameter changed: flow.sign "~" -> "&"'])


def test_a_library_of_a_backend_runs_again_only_what_selects_it(project: EditableProject) -> None:
    """LIBRARIES count always, BACKEND_LIBRARIES for the selected entry."""
    project.edit("versions.json", '"two": "1"', '"two": "2"')
    assert project.play()[0] == 0
    project.edit("versions.json", '"three": "1"', '"three": "2"')
    assert project.play()[2] == ['library version changed: three "1" -> "2"']
    project.edit("versions.json", '"one": "1"', '"one": "2"')
    assert project.play()[2] == ['library version changed: one "1" -> "2"']


def test_a_new_backend_with_a_block_runs_nothing(project: EditableProject) -> None:
    """The position of its field among the others does not count either."""
    project.edit("pkg/stage.py", '"sam-2": "pkg.sam2:mark"}', '"sam-2": "pkg.sam2:mark", "new": "pkg.new:mark"}')
    project.edit("pkg/stage.py", "    flow: Flow = Flow()", "    new: New = New()\n    flow: Flow = Flow()")
    project.edit("pkg/stage.py", "from pkg.load", "from pkg.new import New\nfrom pkg.load")
    (project.root / "pkg/new.py").write_text(BLOCK.format(name="New", sign="%"))
    assert project.play() == (0, "ab~~.", [])


def test_another_backend_has_another_key_and_its_own_block(project: EditableProject) -> None:
    """Switching back runs nothing."""
    project.edit("pkg/stage.py", 'backend: str = "flow"', 'backend: str = "sam-2"')
    ran, text, reasons = project.play()
    assert (ran, text) == (1, "ab##.") and reasons[0].startswith('parameter changed: backend "flow" -> "sam-2", flow.sign "~" -> (')
    project.edit("pkg/stage.py", 'backend: str = "sam-2"', 'backend: str = "flow"')
    assert project.play()[0] == 0


@pytest.mark.parametrize("jobs", [0, 1])
def test_a_stage_cannot_read_a_block_that_is_not_selected(jobs: int, tmp_path: Path) -> None:
    """The block is not in the key, so the output must not depend on it."""
    project = EditableProject.build(tmp_path, FILES | {"main.py": MAIN.replace("JOBS", str(jobs))})
    project.edit("pkg/stage.py", "+ params.end", "+ params.sam_2.sign")
    assert project.play()[1].startswith("params.sam_2.sign belongs to a backend that is not selected, and is not in the "
                                        "key; read only")


@dataclass(frozen=True)
class Block:
    size: int = 1


@dataclass(frozen=True)
class Params:
    backend: str = "a"
    a: Block = Block()
    b: Block = Block(2)
    n: int = 3

    def __post_init__(self) -> None:
        assert self.b.size > 0


def test_an_unselected_block_is_not_in_the_parameters(tmp_path: Path) -> None:
    """The tree for key and seed, and the stage's Params, lack the block; a field that is not a block stays."""
    params = Params()
    tree = without_blocks(canonical(params), params, {"b", "n", "gone"})
    assert tree == {"of": "Params", "fields": {"backend": "a", "a": {"of": "Block", "fields": {"size": 1}}, "n": 3}}
    assert seed_of(tree, {}) == seed_of(without_blocks(canonical(Params(b=Block(5))), params, {"b"}), {})
    given = deepcopy(hide_unselected(params, {"b", "n"}))
    assert (given.a, given.n, repr(given.b)) == (Block(), 3, "<b is not selected>")
    with pytest.raises(ValueError, match=r"params\.b\.size belongs to a backend"):
        given.b.size  # noqa: B018
    assert hide_unselected(params, {"n"}) is params and isinstance(given.b, Unselected)


def test_parameters_without_blocks_are_unchanged() -> None:
    """Seeds of stages without blocks are unchanged as well."""
    params = Block()
    assert without_blocks(canonical(params), params, {"size"}) == canonical(params) and hide_unselected(params, {"size"}) is params


DECLARED = """
BACKENDS = {"a": "m:f", "b": "m:f"}
LIBRARIES = ("one",)
THREADS = 2
BACKEND_LIBRARIES = {"b": ("two",)}
BACKEND_THREADS = {"b": 1}
BACKEND_MEMORY_GIB = {"a": 4, "b": 3.5}
BACKEND_MACHINE = {"b": "b.bf16"}
GPUS = 2
BACKEND_GPUS = {"b": ("device", "devices")}
BACKEND_GPU_SHARED = {"b": True}
BACKEND_SCRATCH_GIB = {"a": 20}
BACKEND_TIMEOUT_S = {"b": 60}
def run(x=3):
    return BACKENDS
"""


@pytest.mark.parametrize(("select", "found"), [
    ({"backend": "a"}, [["one"], 2, 4.0, [], [2], False, 20.0, 3600.0]),
    ({"backend": "b"}, [["one", "two"], 1, 3.5, ["b.bf16"], [["device", "devices"]], True, 0.0, 60.0]),
    ({"backend": ("a", "b")}, [["one", "two"], 2, 4.0, ["b.bf16"], [2, ["device", "devices"]], False, 20.0, 3600.0]),
    (None, [["one", "two"], 2, 4.0, ["b.bf16"], [2, ["device", "devices"]], False, 20.0, 3600.0])])
def test_declarations_of_the_selected_backends(select: dict[str, object] | None, found: list[Any], tmp_path: Path) -> None:
    """Declarations of an entry replace those of the stage, libraries are added, and the largest of several counts."""
    (tmp_path / "stage.py").write_text(DECLARED)
    (tmp_path / "m.py").write_text("def f():\n    return 1\n")
    assert list(declarations(Modules(tmp_path), "stage", select).values()) == found


@pytest.mark.parametrize(("old", "new", "message"), [
    ('{"b": ("two",)}', '{"c": ("two",)}', r"BACKEND_LIBRARIES: expected entries of the registry \(a, b\)"),
    ('{"b": ("two",)}', '{"b": "two"}', r"got LIBRARIES = 'two'"),
    ('BACKEND_THREADS = {"b": 1}', "BACKEND_THREADS = 4", "BACKEND_THREADS: expected entries of the registry"),
    ("BACKEND_MACHINE", "REFINE_MACHINE", "REFINE_MACHINE belongs to no registry"),
    ("THREADS = 2", "THREADS = True", "got THREADS = True"), ("THREADS = 2", "THREADS = 0", "got THREADS = 0"),
    ("GPUS = 2", "GPUS = ('device',)", r"got GPUS = \['device'\]"), ("GPUS = 2", "GPUS = True", "got GPUS = True"),
    ("THREADS = 2", "GPU_SHARED = 1", "got GPU_SHARED = 1"), ("THREADS = 2", "SCRATCH_GIB = -1", "got SCRATCH_GIB = -1"),
    ('"b": 60', '"b": 0', "got TIMEOUT_S = 0")])
def test_declarations_that_are_wrong_are_refused(old: str, new: str, message: str, tmp_path: Path) -> None:
    """The error shows the expected form."""
    (tmp_path / "stage.py").write_text(DECLARED.replace(old, new))
    with pytest.raises(ValueError, match=message):
        declarations(Modules(tmp_path), "stage", {"backend": "b"})


def test_registries_that_a_stage_imports_select_too(tmp_path: Path) -> None:
    """One of two registries with the same entry selects it."""
    (tmp_path / "stage.py").write_text("from m import BACKENDS\nREFINES = {'b': 'm:f', 'c-1': 'm:f'}\n"
                                       "def run(x=3):\n    return x\n")
    (tmp_path / "m.py").write_text("BACKENDS = {'a': 'm:f', 'b': 'm:f'}\ndef f():\n    return 1\n")
    modules = Modules(tmp_path)
    assert unselected(modules, "stage", {"backend": "a", "refine": "b"}) == {"c_1"}
    assert unselected(modules, "stage", {"backend": "a"}) == {"b"}
    assert unselected(modules, "stage", {}) == unselected(modules, "gone", {"backend": "a"}) == frozenset()


def test_a_plural_in_ies_selects_too() -> None:
    """`policy` selects from POLICIES: the fingerprint omits the code of the other entries."""
    found = fingerprint(Modules(ROOT), "stages.extraction.narration_labelling:run", {"policy": "last"}).definitions
    names = {name.partition(":")[2] for name in found if name.startswith("afford.extraction.labels:")}
    assert "last" in names and not names & {"shortest", "all_narrations"}
