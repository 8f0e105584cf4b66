"""Fingerprints cover exactly the code that can run behind a stage; code that cannot be followed is refused."""

from __future__ import annotations

import os
from pathlib import Path

import pytest

from runner.fingerprint import changed, fingerprint
from runner.modules import Modules

ROOT = Path(__file__).resolve().parents[2]
Files = dict[str, str]


def closure(folder: Path, files: Files, **select: object) -> dict[str, str]:
    """Definitions behind stage:run, with the digest of all of them under ''."""
    for name, text in files.items():
        (folder / name).parent.mkdir(parents=True, exist_ok=True)
        (folder / name).write_text(text)
    found = fingerprint(Modules(folder), "stage:run", select)
    return {"": found.digest, **found.definitions}


HELPER = "K = 1\nOTHER = 1\ndef f(x):\n    return x * K\n"
HELPER += "class C:\n    size = 1\n    def m(self):\n        return g(self.size)\n"
HELPER += "def g(x, by=K):\n    return x + by\ndef unused():\n    return 5\n"
STAGE = "from helper import f\ndef run(x):\n    return f(x)\n"

COUNTS = {
    "a constant of a helper": ({"stage.py": STAGE, "helper.py": HELPER}, "helper.py", "K = 1", "K = 2"),
    "a module attribute": ({"stage.py": "import helper\ndef run(x):\n    return x + helper.K\n", "helper.py": HELPER},
                           "helper.py", "K = 1", "K = 2"),
    "an attribute of a module under another name": (
        {"stage.py": "import pack.helper as h\ndef run(x):\n    return h.f(x)\n", "pack/helper.py": HELPER},
        "pack/helper.py", "K = 1", "K = 2"),
    "a dotted module": ({"stage.py": "import pack.helper\ndef run(x):\n    return pack.helper.f(x)\n", "pack/__init__.py": "",
                         "pack/helper.py": HELPER}, "pack/helper.py", "K = 1", "K = 2"),
    "a global in a nested generator expression": (
        {"stage.py": "from helper import K\ndef run(x):\n    return sum(sum(K for _ in x) for _ in x)\n", "helper.py": HELPER},
        "helper.py", "K = 1", "K = 2"),
    "a global in a lambda": ({"stage.py": "import helper\ndef run(x):\n    return map(lambda y: y + helper.K, x)\n",
                              "helper.py": HELPER}, "helper.py", "K = 1", "K = 2"),
    "a nested function": ({"stage.py": "def run(x):\n    def inner():\n        return 1\n    return inner()\n"},
                          "stage.py", "return 1", "return 2"),
    "a method of a class": ({"stage.py": "from helper import C\ndef run(x):\n    return C().m()\n", "helper.py": HELPER},
                            "helper.py", "return g(self.size)", "return -g(self.size)"),
    "what a method uses": ({"stage.py": "from helper import C\ndef run(x):\n    return C().m()\n", "helper.py": HELPER},
                           "helper.py", "x + by", "x - by"),
    "a class that is only annotated": ({"stage.py": "from helper import C\ndef run(x: C):\n    return x.m()\n",
                                        "helper.py": HELPER}, "helper.py", "x + by", "x - by"),
    "a base class": ({"stage.py": "from helper import C\nclass D(C):\n    pass\ndef run(x):\n    return D().m()\n",
                      "helper.py": HELPER}, "helper.py", "size = 1", "size = 2"),
    "a default argument": ({"stage.py": "from helper import g\ndef run(x):\n    return g(x)\n", "helper.py": HELPER},
                           "helper.py", "by=K", "by=3"),
    "a constant behind a default argument": ({"stage.py": "from helper import g\ndef run(x):\n    return g(x)\n",
                                              "helper.py": HELPER}, "helper.py", "K = 1", "K = 2"),
    "an import inside a function": ({"stage.py": "def run(x):\n    from helper import f\n    return f(x)\n",
                                     "helper.py": HELPER}, "helper.py", "K = 1", "K = 2"),
    "a relative import": ({"stage.py": "from pack.a import f\ndef run(x):\n    return f(x)\n", "pack/__init__.py": "",
                           "pack/a.py": "from .b import f\n", "pack/b.py": HELPER}, "pack/b.py", "K = 1", "K = 2"),
    "a name passed on by a package": ({"stage.py": "import pack\ndef run(x):\n    return pack.f(x)\n",
                                       "pack/__init__.py": "from pack.b import f\n", "pack/b.py": HELPER},
                                      "pack/b.py", "K = 1", "K = 2"),
    "a decorator": ({"stage.py": "from helper import f\n@f\ndef run(x):\n    return x\n", "helper.py": HELPER},
                    "helper.py", "x * K", "x / K"),
    "a table filled by a statement": (
        {"stage.py": "from helper import T\ndef run(x):\n    return T[x]\n", "helper.py": "T = {}\nT['x'] = 1\n"},
        "helper.py", "= 1", "= 2"),
    "a table filled by a loop": (
        {"stage.py": "from helper import T\ndef run(x):\n    return T[x]\n",
         "helper.py": "T = {}\nfor i in range(3):\n    T[i] = 1\n"}, "helper.py", "range(3)", "range(4)"),
    "an augmented assignment": ({"stage.py": "from helper import T\ndef run(x):\n    return T\n",
                                 "helper.py": "T = 1\nT += 1\n"}, "helper.py", "+= 1", "+= 2"),
    "a function that registers itself": (
        {"stage.py": "from helper import T\ndef run(x):\n    return T[x](x)\n",
         "helper.py": "T = {}\ndef add(f):\n    T[f.__name__] = f\n    return f\n@add\ndef one(x):\n    return 1\n"},
        "helper.py", "return 1", "return 2"),
    "another module that fills the table": (
        {"stage.py": "import filler\nfrom helper import T\ndef run(x):\n    return T[x]\n", "helper.py": "T = {}\n",
         "filler.py": "import helper\nhelper.T['x'] = 1\n"}, "filler.py", "= 1", "= 2"),
    "a constant of a numba kernel": (
        {"stage.py": "def run(x):\n    from kernel import k\n    return k(x)\n",
         "kernel.py": "from numba import njit\nfrom helper import K\n@njit(cache=True)\ndef k(x):\n    return x * K\n",
         "helper.py": HELPER}, "helper.py", "K = 1", "K = 2"),
    "an option of a numba kernel": (
        {"stage.py": "def run(x):\n    from kernel import k\n    return k(x)\n",
         "kernel.py": "from numba import njit\n@njit(cache=True)\ndef k(x):\n    return x\n"}, "kernel.py", "cache=True",
        "fastmath=True"),
    "declared data": ({"stage.py": STAGE, "helper.py": HELPER + "DATA_FILES = ('map.csv',)\n", "map.csv": "a,b\n"},
                      "map.csv", "a,b", "a,c"),
    "a module used as a value": ({"stage.py": "import helper\ndef run(x):\n    return vars(helper)\n", "helper.py": HELPER},
                                 "helper.py", "return 5", "return 6"),
    "a schema's field": ({"stage.py": "from schemas.a import A\ndef run(x: A):\n    return x\n",
                          "schemas/a.py": "class A:\n    n: int = value('how many')\n"}, "schemas/a.py", "n: int", "n: float"),
    "a match statement": ({"stage.py": "from helper import C\ndef run(x):\n    match x:\n        case C(size=1):\n"
                           "            return 1\n", "helper.py": HELPER}, "helper.py", "size = 1", "size = 2"),
}


@pytest.mark.parametrize("case", COUNTS)
def test_reachable_code_counts(case: str, tmp_path: Path) -> None:
    """Each edit changes the fingerprint, though the stage's own file is unchanged."""
    files, name, old, new = COUNTS[case]
    before = closure(tmp_path, files)
    assert old in files[name]
    assert closure(tmp_path, {name: files[name].replace(old, new)})[""] != before[""]
    assert closure(tmp_path, {name: files[name]}) == before, "undone, it is what it was"


DOES_NOT_COUNT = {
    "a comment": ("helper.py", "K = 1", "K = 1  # one"),
    "a docstring": ("helper.py", "    return x * K", '    """Docs."""\n    return x * K'),
    "formatting": ("helper.py", "return x * K", "return (x *\n        K)"),
    "an unused function": ("helper.py", "return 5", "return 6"),
    "an unused constant": ("helper.py", "OTHER = 1", "OTHER = 2"),
    "a new neighbour": ("helper.py", "K = 1", "K = 1\nNEW = print('x')"),
}


@pytest.mark.parametrize("case", DOES_NOT_COUNT)
def test_unreachable_code_does_not_count(case: str, tmp_path: Path) -> None:
    """Comments, docstrings, layout, and code that the stage does not reach."""
    name, old, new = DOES_NOT_COUNT[case]
    before = closure(tmp_path, {"stage.py": STAGE, "helper.py": HELPER})
    assert closure(tmp_path, {name: HELPER.replace(old, new, 1)}) == before


def test_a_local_variable_is_not_a_constant_of_the_module(tmp_path: Path) -> None:
    """K is an argument here, by Python's scopes."""
    stage = "K = 1\ndef run(K):\n    return [K for K in range(K)]\n"
    assert "stage:K" not in closure(tmp_path, {"stage.py": stage})


def test_doc_lines_of_schemas_do_not_count(tmp_path: Path) -> None:
    """The last positional argument of a field and its encoding do not affect its meaning."""
    text = "class A:\n    n: int = value('how many', encoding='raw', unit='m')\n"
    files = {"stage.py": "from schemas.a import A\ndef run(x: A):\n    return x\n", "schemas/a.py": text}
    before = closure(tmp_path, files)
    assert closure(tmp_path, {"schemas/a.py": text.replace("how many", "count").replace("raw", "zstd")}) == before
    assert closure(tmp_path, {"schemas/a.py": text.replace("'m'", "'mm'")}) != before


REGISTRY = {
    "stage.py": "from load import load\nBACKENDS = {'a': 'one:f', 'b': 'two:f'}\n"
                "def run(x, params):\n    return load(BACKENDS, x)(x)\n",
    "load.py": "import importlib\nDYNAMIC = ()\ndef load(table, name):\n    return importlib.import_module(table[name])\n",
    "one.py": "def f(x):\n    return 1\n", "two.py": "def f(x):\n    return 2\n"}


def test_the_selected_backend_alone_is_followed(tmp_path: Path) -> None:
    """The entry in the parameter `backend` counts, the others do not; without such a field all count."""
    before = closure(tmp_path, REGISTRY, backend="a")
    everything = closure(tmp_path, REGISTRY)
    (tmp_path / "two.py").write_text("def f(x):\n    return 3\n")
    assert closure(tmp_path, {}, backend="a") == before
    assert closure(tmp_path, {}, backend="b")[""] != closure(tmp_path, REGISTRY, backend="b")[""]
    assert closure(tmp_path, {"two.py": "def f(x):\n    return 3\n"})[""] != everything[""]


def test_a_new_backend_does_not_disturb_the_others(tmp_path: Path) -> None:
    """Adding an entry to the registry keeps the fingerprints of the others."""
    before = closure(tmp_path, REGISTRY, backend="a")
    (tmp_path / "stage.py").write_text(REGISTRY["stage.py"].replace("'b':", "'c': 'two:f', 'b':"))
    assert closure(tmp_path, {}, backend="a") == before


@pytest.mark.parametrize(("files", "message"), [
    ({"stage.py": "import importlib\ndef run(x):\n    return importlib.import_module(x)\n"}, r"import_module\(\) cannot be"),
    ({"stage.py": "from importlib import import_module\ndef run(x):\n    return import_module(x)\n"}, "cannot be followed"),
    ({"stage.py": "def run(x):\n    return __import__(x)\n"}, "cannot be followed"),
    ({"stage.py": "def run(x):\n    return eval(x)\n"}, "cannot be followed"),
    ({"stage.py": "import helper\ndef run(x):\n    return getattr(helper, x)\n", "helper.py": HELPER}, "getattr"),
    ({"stage.py": "from helper import *\ndef run(x):\n    return f(x)\n", "helper.py": HELPER}, "hides the used names"),
    ({"stage.py": STAGE, "helper.py": HELPER + "DATA_FILES = ('gone.csv',)\n"}, "gone.csv"),
    ({"stage.py": "from pack.gone import f\ndef run(x):\n    return f(x)\n", "pack/__init__.py": ""}, "names no module of this"),
    ({"stage.py": "BACKENDS = {'a': 'pack.no:f'}\ndef run(x):\n    return BACKENDS\n", "pack/__init__.py": ""}, "'pack.no'"),
    ({"stage.py": "def run(x):\n    return (\n"}, "stage.py:2: "),
])
def test_untraceable_code_is_refused(files: Files, message: str, tmp_path: Path) -> None:
    """Dynamic code is an error at build time, never a silent gap."""
    with pytest.raises(ValueError, match=message):
        closure(tmp_path, files)


def test_declared_dynamic_code_is_followed(tmp_path: Path) -> None:
    """DYNAMIC lists the targets of a computed import."""
    stage = "import importlib\nDYNAMIC = ('helper',)\ndef run(x):\n    return importlib.import_module(x)\n"
    before = closure(tmp_path, {"stage.py": stage, "helper.py": HELPER})
    assert closure(tmp_path, {"helper.py": HELPER.replace("return 5", "return 6")})[""] != before[""]


def test_a_literal_attribute_name_is_followed(tmp_path: Path) -> None:
    """getattr with a constant is an attribute."""
    stage = "import helper\ndef run(x):\n    return getattr(helper, 'f')(x)\n"
    found = closure(tmp_path, {"stage.py": stage, "helper.py": HELPER})
    assert "helper:f" in found and "helper:unused" not in found


def test_third_party_packages_are_listed(tmp_path: Path) -> None:
    """Run-time imports from outside the project, without the standard library and imports for type checkers."""
    stage = ("import os\nimport numpy as np\nfrom typing import TYPE_CHECKING\nif TYPE_CHECKING:\n    import torch\n"
             "def run(x: torch.Tensor):\n    import cv2\n    return np.sum(cv2.blur(os.sep, x))\n")
    (tmp_path / "stage.py").write_text(stage)
    assert fingerprint(Modules(tmp_path), "stage:run", {}).third_party == {"numpy", "cv2"}


def test_a_change_is_named(tmp_path: Path) -> None:
    """Edited, added and removed definitions are distinguished."""
    before = closure(tmp_path, {"stage.py": STAGE, "helper.py": HELPER})
    text = HELPER.replace("K = 1", "K = 2").replace("return x * K", "return x * K * NEW") + "NEW = 1\n"
    after = closure(tmp_path, {"helper.py": text})
    assert changed(before, after)[1:] == ["~helper:K", "~helper:f", "+helper:NEW"]


def test_parsing_is_remembered_and_forgotten_with_the_file(tmp_path: Path) -> None:
    """The cache gives the same result, and a change of the file is noticed."""
    closure(tmp_path, {"stage.py": STAGE, "helper.py": HELPER})
    for name in ("stage.py", "helper.py"):
        os.utime(tmp_path / name, ns=(10**18, 10**18))
    answers = []
    for text in (HELPER, HELPER, HELPER.replace("K = 1", "K = 2")):
        if (tmp_path / "helper.py").read_text() != text:
            (tmp_path / "helper.py").write_text(text)
        modules = Modules(tmp_path, tmp_path / "cache.json")
        answers.append(fingerprint(modules, "stage:run", {}).digest)
        modules.save()
    assert answers[0] == answers[1] != answers[2]


def test_the_digest_of_code_is_this_digest(tmp_path: Path) -> None:
    """Pinned: other versions of Python must give the same normal form."""
    found = closure(tmp_path, {"stage.py": STAGE, "helper.py": HELPER})
    assert found[""] == "b818ed8ddd04494f7b1dc4212f00629aeda8769db70b39b758ea4c764e2d2b50"
