"""Kinds of edit, each judged by running the code for its effect on the output and the fingerprint of a stage.

A case is a few modules in one text; `<<old|new>>` in it is the edit, also in the name of a module. `judge()` writes every case
before and after the edit, runs `stage.run` of both in their own processes, and takes the fingerprints of `stage:run` and of
`control:run`, which does not use the code. Where there is a module `outside`, `run` receives its VALUE, as a stage receives its
inputs.
"""

from __future__ import annotations

import json
import re
import subprocess
import sys
import textwrap
from collections import Counter
from dataclasses import dataclass, field
from pathlib import Path

from runner.fingerprint import fingerprint
from runner.modules import Modules
from runner.source import SourceError

FOLLOWED, REFUSED, SAME = "followed", "refused", "same"
EDIT = re.compile(r"<<(.*?)\|(.*?)>>", re.DOTALL)
CONTROL = {"control.py": "from other import g\ndef run(x=3):\n    return g(x)\n", "other.py": "def g(x):\n    return x + 100\n"}
RUN = """
import importlib, json, os, sys
import asyncio, contextlib, dataclasses, decimal, enum, pathlib, re, runpy, subprocess, typing, unittest.mock  # once for all
sys.dont_write_bytecode = True
for folder in json.load(sys.stdin):
    sys.stdout.flush()
    child = os.fork()
    if child == 0:
        os.chdir(folder)
        sys.path.insert(0, folder)
        try:
            given = [importlib.import_module("outside").VALUE] if os.path.exists(folder + "/outside.py") else []
            result = repr(importlib.import_module("stage").run(*given))
        except Exception as error:
            result = f"{type(error).__name__}: {error}"
        print(json.dumps(result.replace(folder, "")), flush=True)
        os._exit(0)
    os.waitpid(child, 0)
"""


@dataclass(frozen=True)
class Case:
    """One kind of edit, with the expected result `want`: followed, refused, or same."""

    name: str
    want: str
    text: str
    select: dict[str, object] = field(default_factory=dict)

    def files(self, side: int) -> dict[str, str]:
        """Modules before (1) and after (2) the edit."""
        parts = re.split(r"^ *=== (.+)\n", self.text, flags=re.MULTILINE)
        texts = {name: textwrap.dedent(text) for name, text in zip(parts[1::2], parts[2::2], strict=True)}

        def edited(text: str) -> str:
            return EDIT.sub(lambda match: match[side], text)

        return {edited(name): edited(text) for name, text in texts.items()}


@dataclass(frozen=True)
class Verdict:
    """Result of one case: 'right', 'over' (needless run), 'stale' (missing run) or 'refused'."""

    case: Case
    outcome: str
    outputs: tuple[str, str]
    message: str
    control: bool
    """True if the fingerprint of the control stage stays"""


def judge(folder: Path, cases: list[Case] | None = None) -> list[Verdict]:
    """Measure every case below an empty folder."""
    cases = CASES if cases is None else cases
    roots = [(folder / f"{number}" / "old", folder / f"{number}" / "new") for number in range(len(cases))]
    for case, pair in zip(cases, roots, strict=True):
        for side, root in enumerate(pair, 1):
            for name, text in {**CONTROL, **case.files(side)}.items():
                (root / name).parent.mkdir(parents=True, exist_ok=True)
                (root / name).write_text(text, encoding="utf-8")
    outputs = _outputs([root for pair in roots for root in pair])
    return [_verdict(*each) for each in zip(cases, roots, zip(outputs[::2], outputs[1::2], strict=True), strict=True)]


def counts(verdicts: list[Verdict]) -> dict[str, int]:
    """Count the outcomes."""
    found = Counter(verdict.outcome for verdict in verdicts)
    return {outcome: found[outcome] for outcome in ("right", "refused", "over", "stale")} | {
        "control": sum(not verdict.control for verdict in verdicts)}


def _outputs(roots: list[Path]) -> list[str]:
    done = subprocess.run([sys.executable, "-S", "-c", RUN], input=json.dumps([str(root) for root in roots]), capture_output=True,
                          text=True, check=True, cwd=roots[0])
    return [json.loads(line) for line in done.stdout.splitlines()]


def _verdict(case: Case, roots: tuple[Path, Path], outputs: tuple[str, str]) -> Verdict:
    control = [fingerprint(Modules(root), "control:run", {}).digest for root in roots]
    try:
        keys = [fingerprint(Modules(root), "stage:run", case.select).digest for root in roots]
    except SourceError as error:
        return Verdict(case, "refused", outputs, str(error), control[0] == control[1])
    changed, again = outputs[0] != outputs[1], keys[0] != keys[1]
    outcome = "right" if changed == again else "stale" if changed else "over"
    return Verdict(case, outcome, outputs, "", control[0] == control[1])




def _stage(result: str, *before: str) -> str:
    """Stage that returns an expression."""
    return "\n".join(("=== stage.py", *before, "def run(x=3):", f"    return {result}", ""))


F = _stage("f(x)", "from helper import f")
H = _stage("h.f(x)", "import helper as h")
ONE = "=== helper.py\ndef f(x):\n    return x + <<1|2>>\n"

CALLS = [
    Case("a constant", FOLLOWED, F + "=== helper.py\nK = <<1|2>>\ndef f(x):\n    return x + K\n"),
    Case("a default of a parameter", FOLLOWED, F + "=== helper.py\ndef f(x, k=<<1|2>>):\n    return x + k\n"),
    Case("a default that is a constant elsewhere", FOLLOWED,
         F + "=== helper.py\nfrom third import K\ndef f(x, k=K):\n    return x + k\n=== third.py\nK = <<1|2>>\n"),
    Case("a generator", FOLLOWED, """
        === stage.py
        from helper import f
        def run(x=3):
            return sum(f(x))
        === helper.py
        K = <<1|2>>
        def f(x):
            yield x
            yield K
        """),
    Case("a lambda with a name", FOLLOWED, F + "=== helper.py\nf = lambda x: x + <<1|2>>\n"),
    Case("a function in a function", FOLLOWED, F + """
=== helper.py
from third import g
def f(x):
    def inner(y):
        return g(y)
    return inner(x)
=== third.py
def g(y):
    return y + <<1|2>>
"""),
    Case("a coroutine", FOLLOWED, """
        === stage.py
        import asyncio
        from helper import f
        def run(x=3):
            return asyncio.run(f(x))
        === helper.py
        async def f(x):
            return x + <<1|2>>
        """),
    Case("functools.partial", FOLLOWED, F + """
=== helper.py
from functools import partial
from third import K
def plain(x, k):
    return x + k
f = partial(plain, k=K)
=== third.py
K = <<1|2>>
"""),
    Case("a function wrapped under its own name", FOLLOWED, F + """
=== helper.py
from third import wrap
def f(x):
    return x
f = wrap(f)
=== third.py
def wrap(function):
    return lambda x: function(x) + <<1|2>>
"""),
    Case("the body of a decorator", FOLLOWED, F + """
=== helper.py
from third import more
@more
def f(x):
    return x
=== third.py
def more(function):
    def wrapped(x):
        return function(x) + <<1|2>>
    return wrapped
"""),
    Case("the argument of a decorator", FOLLOWED, F + """
=== helper.py
from third import more
@more(<<1|2>>)
def f(x):
    return x
=== third.py
def more(by):
    def outer(function):
        return lambda x: function(x) + by
    return outer
"""),
    Case("a constant in an f-string", FOLLOWED,
         _stage("f'{x}{h.K}'", "import helper as h") + "=== helper.py\nK = <<1|2>>\n"),
    Case("a dotted constant in a match", FOLLOWED, """
        === stage.py
        import helper as h
        def run(x=3):
            match x:
                case h.K:
                    return "that one"
            return "another"
        === helper.py
        K = <<3|4>>
        """),
    Case("the name of a function, as data", FOLLOWED, """
        === stage.py
        from helper import TABLE
        def run(x=3):
            return TABLE[0].__name__
        === helper.py
        def <<f|g>>(x):
            return x
        TABLE = [<<f|g>>]
        """),
]

CLASSES = [
    Case("an attribute of a class", FOLLOWED, """
        === stage.py
        from helper import C
        def run(x=3):
            return C().m(x)
        === helper.py
        class C:
            k = <<1|2>>
            def m(self, x):
                return x + self.k
        """),
    Case("a base class elsewhere", FOLLOWED, """
        === stage.py
        from helper import C
        def run(x=3):
            return C().m(x)
        === helper.py
        import third
        class C(third.Base):
            pass
        === third.py
        class Base:
            def m(self, x):
                return x + <<1|2>>
        """),
    Case("a mixin by super()", FOLLOWED, """
        === stage.py
        from helper import C
        def run(x=3):
            return C().m(x)
        === helper.py
        from third import Base, Mixin
        class C(Mixin, Base):
            pass
        === third.py
        class Base:
            def m(self, x):
                return x
        class Mixin:
            def m(self, x):
                return super().m(x) + <<1|2>>
        """),
    Case("a property of a metaclass", FOLLOWED, """
        === stage.py
        from helper import C
        def run(x=3):
            return C.k
        === helper.py
        from third import Meta
        class C(metaclass=Meta):
            pass
        === third.py
        class Meta(type):
            @property
            def k(cls):
                return <<1|2>>
        """),
    Case("a property", FOLLOWED, """
        === stage.py
        from helper import C
        def run(x=3):
            return C().k
        === helper.py
        class C:
            @property
            def k(self):
                return <<1|2>>
        """),
    Case("a descriptor", FOLLOWED, """
        === stage.py
        from helper import C
        def run(x=3):
            return C().k
        === helper.py
        from third import Descriptor
        class C:
            k = Descriptor()
        === third.py
        class Descriptor:
            def __get__(self, owner, kind=None):
                return <<1|2>>
        """),
    Case("a class that a decorator changes", FOLLOWED, """
        === stage.py
        from helper import C
        def run(x=3):
            return C.k
        === helper.py
        from third import with_k
        @with_k
        class C:
            pass
        === third.py
        def with_k(kind):
            kind.k = <<1|2>>
            return kind
        """),
    Case("a class made in a function", FOLLOWED, """
        === stage.py
        from helper import make
        def run(x=3):
            return make()().m(x)
        === helper.py
        def make():
            class C:
                def m(self, x):
                    return x + <<1|2>>
            return C
        """),
    Case("what a class derives from, for issubclass", FOLLOWED, """
        === stage.py
        from helper import C
        def run(x=3):
            return issubclass(C, int)
        === helper.py
        class C(<<int|str>>):
            pass
        """),
    Case("a default of a dataclass", FOLLOWED, """
        === stage.py
        from helper import D
        def run(x=3):
            return D().k
        === helper.py
        from dataclasses import dataclass
        @dataclass(frozen=True)
        class D:
            k: int = <<1|2>>
        """),
    Case("a default_factory", FOLLOWED, """
        === stage.py
        from helper import D
        def run(x=3):
            return D().k
        === helper.py
        from dataclasses import dataclass, field
        from third import make
        @dataclass(frozen=True)
        class D:
            k: int = field(default_factory=make)
        === third.py
        def make():
            return <<1|2>>
        """),
    Case("a value of an Enum", FOLLOWED, """
        === stage.py
        from helper import E
        def run(x=3):
            return E.A.value
        === helper.py
        from enum import Enum
        class E(Enum):
            A = <<1|2>>
        """),
    Case("a default of a NamedTuple", FOLLOWED, """
        === stage.py
        from helper import N
        def run(x=3):
            return N().k
        === helper.py
        from typing import NamedTuple
        class N(NamedTuple):
            k: int = <<1|2>>
        """),
    Case("a function that the body of a class hides by a field of its name", FOLLOWED, """
        === stage.py
        from helper import C
        def run(x=3):
            return C.first
        === helper.py
        from third import value
        class C:
            first = value()
            value = 0
        === third.py
        def value():
            return <<1|2>>
        """),
    Case("getattr(self, <computed>)", FOLLOWED, """
        === stage.py
        from helper import C
        def run(x=3):
            return C().go("one", x)
        === helper.py
        class C:
            def do_one(self, x):
                return x + <<1|2>>
            def go(self, what, x):
                return getattr(self, f"do_{what}")(x)
        """),
]

IMPORTS = [
    Case("the first branch of if/else", FOLLOWED, F + """
=== helper.py
import sys
if sys.version_info > (3, 0):
    from fast import f
else:
    from slow import f
=== fast.py
def f(x):
    return x + <<1|2>>
=== slow.py
def f(x):
    return x
"""),
    Case("the last branch of if/else", FOLLOWED, F + """
=== helper.py
import sys
if sys.version_info < (3, 0):
    from fast import f
else:
    from slow import f
=== fast.py
def f(x):
    return x
=== slow.py
def f(x):
    return x + <<1|2>>
"""),
    Case("the condition of if/else", FOLLOWED, F + """
=== helper.py
FAST = <<True|False>>
if FAST:
    from fast import f
else:
    from slow import f
=== fast.py
def f(x):
    return x + 1
=== slow.py
def f(x):
    return x + 2
"""),
    Case("the first branch of if/else in a function", FOLLOWED, """
        === stage.py
        def run(x=3):
            if x:
                from fast import f
            else:
                from slow import f
            return f(x)
        === fast.py
        def f(x):
            return x + <<1|2>>
        === slow.py
        def f(x):
            return x
        """),
    Case("try: a module of ours, except: another", FOLLOWED, F + """
=== helper.py
try:
    from fast import f
except ImportError:
    from slow import f
=== fast.py
def f(x):
    return x + <<1|2>>
=== slow.py
def f(x):
    return x
"""),
    Case("try: a library that is missing, except: a module of ours", FOLLOWED, F + """
=== helper.py
try:
    from no_such_library import f
except ImportError:
    from slow import f
=== slow.py
def f(x):
    return x + <<1|2>>
"""),
    Case("try/except in a function", FOLLOWED, """
        === stage.py
        def run(x=3):
            try:
                from fast import f
            except ImportError:
                from slow import f
            return f(x)
        === fast.py
        def f(x):
            return x + <<1|2>>
        === slow.py
        def f(x):
            return x
        """),
    Case("two imports of one name", FOLLOWED, """
        === stage.py
        from slow import f
        def g(x, f=f):
            return f(x)
        from fast import f
        def run(x=3):
            return g(x) + f(x)
        === fast.py
        def f(x):
            return x
        === slow.py
        def f(x):
            return x + <<1|2>>
        """),
    Case("a definition under a condition", FOLLOWED, F + """
=== helper.py
import sys
if sys.version_info > (3, 0):
    def f(x):
        return x + <<1|2>>
else:
    def f(x):
        return x
"""),
    Case("another function of a library under the same name", FOLLOWED,
         F + "=== helper.py\nfrom math import <<sqrt|exp>> as g\ndef f(x):\n    return g(x)\n"),
    Case("two functions of ours that change names", FOLLOWED, """
        === stage.py
        from helper import one as <<a|b>>, two as <<b|a>>
        def run(x=3):
            return a(x) - b(x)
        === helper.py
        def one(x):
            return x
        def two(x):
            return 2 * x
        """),
    Case("passed on by a package", FOLLOWED, """
        === stage.py
        from pack import f
        def run(x=3):
            return f(x)
        === pack/__init__.py
        from pack.inner import f
        === pack/inner.py
        def f(x):
            return x + <<1|2>>
        """),
    Case("passed on under another name", FOLLOWED, """
        === stage.py
        import pack as p
        def run(x=3):
            return p.other(x)
        === pack/__init__.py
        from pack.inner import f as other
        === pack/inner.py
        def f(x):
            return x + <<1|2>>
        """),
    Case("a package that imports a module of its own", FOLLOWED, """
        === stage.py
        import pack
        def run(x=3):
            return pack.inner.f(x)
        === pack/__init__.py
        from pack import inner
        === pack/inner.py
        def f(x):
            return x + <<1|2>>
        """),
    Case("a chain of modules under other names", FOLLOWED, """
        === stage.py
        import pack.middle
        import pack as p
        def run(x=3):
            return p.middle.z.f(x)
        === pack/__init__.py
        === pack/middle.py
        import helper as z
        """ + ONE),
    Case("a dotted module", FOLLOWED, """
        === stage.py
        import pack.inner
        def run(x=3):
            return pack.inner.f(x)
        === pack/__init__.py
        === pack/inner.py
        def f(x):
            return x + <<1|2>>
        """),
    Case("from . import module", FOLLOWED, """
        === stage.py
        from pack.one import f
        def run(x=3):
            return f(x)
        === pack/__init__.py
        === pack/one.py
        from . import two
        def f(x):
            return two.g(x)
        === pack/two.py
        def g(x):
            return x + <<1|2>>
        """),
    Case("from .module import name", FOLLOWED, """
        === stage.py
        from pack.one import f
        def run(x=3):
            return f(x)
        === pack/__init__.py
        === pack/one.py
        from .two import f
        === pack/two.py
        def f(x):
            return x + <<1|2>>
        """),
    Case("from .. import module", FOLLOWED, """
        === stage.py
        from pack.deep.one import f
        def run(x=3):
            return f(x)
        === pack/__init__.py
        === pack/two.py
        def g(x):
            return x + <<1|2>>
        === pack/deep/__init__.py
        === pack/deep/one.py
        from .. import two
        def f(x):
            return two.g(x)
        """),
    Case("a package without __init__", FOLLOWED, """
        === stage.py
        from loose.inner import f
        def run(x=3):
            return f(x)
        === loose/inner.py
        def f(x):
            return x + <<1|2>>
        """),
    Case("an import in a function", FOLLOWED, "=== stage.py\ndef run(x=3):\n    from helper import f\n    return f(x)\n" + ONE),
    Case("an import in a condition of a function", FOLLOWED,
         "=== stage.py\ndef run(x=3):\n    if x:\n        import helper as h\n    return h.f(x)\n" + ONE),
    Case("__getattr__ of a module", FOLLOWED, """
        === stage.py
        import helper as h
        def run(x=3):
            return h.anything
        === helper.py
        from third import K
        def __getattr__(name):
            return K
        === third.py
        K = <<1|2>>
        """),
    Case("a value made by another module", FOLLOWED, """
        === stage.py
        def run(x=3):
            import third
            return third.VALUE.m(x)
        === third.py
        from helper import V
        VALUE = V()
        === helper.py
        class V:
            def m(self, x):
                return x + <<1|2>>
        """),
    Case("a program of ours, by its name on a command line", FOLLOWED, """
        === stage.py
        import subprocess, sys
        def run(x=3):
            command = [sys.executable, "-m", "helper", str(x)]
            return subprocess.run(command, capture_output=True, text=True).stdout
        === helper.py
        import sys
        if __name__ == "__main__":
            print(int(sys.argv[1]) + <<1|2>>)
        """),
    Case("a program of ours, by __name__ of its module", FOLLOWED, """
        === stage.py
        import subprocess, sys
        import helper
        def run(x=3):
            command = [sys.executable, "-m", helper.__name__, str(x)]
            return subprocess.run(command, capture_output=True, text=True).stdout
        === helper.py
        import sys
        def main(x):
            print(x + <<1|2>>)
        if __name__ == "__main__":
            main(int(sys.argv[1]))
        """),
    Case("a function that a string names", FOLLOWED, """
        === stage.py
        import importlib
        DYNAMIC = ()
        def run(x=3):
            module, _, name = "helper:f".partition(":")
            return getattr(importlib.import_module(module), name)(x)
        """ + ONE),
]

TABLES = [
    Case("the selected entry of a registry", FOLLOWED, """
        === stage.py
        from load import load
        BACKENDS = {"one": "one:f", "two": "two:f"}
        def run(x=3):
            return load(BACKENDS, "one")(x)
        === load.py
        import importlib
        DYNAMIC = ()
        def load(table, name):
            module, _, attribute = table[name].partition(":")
            return getattr(importlib.import_module(module), attribute)
        === one.py
        def f(x):
            return x + <<1|2>>
        === two.py
        def f(x):
            return x
        """, {"backend": "one"}),
    Case("an entry that is not selected", SAME, """
        === stage.py
        from load import load
        BACKENDS = {"one": "one:f", "two": "two:f"}
        def run(x=3):
            return load(BACKENDS, "one")(x)
        === load.py
        import importlib
        DYNAMIC = ()
        def load(table, name):
            module, _, attribute = table[name].partition(":")
            return getattr(importlib.import_module(module), attribute)
        === one.py
        def f(x):
            return x
        === two.py
        def f(x):
            return x + <<1|2>>
        """, {"backend": "one"}),
    Case("an entry that another module adds", FOLLOWED, """
        === stage.py
        import adds
        from table import BACKENDS, load
        def run(x=3):
            return load(BACKENDS["new"])(x)
        === table.py
        import importlib
        DYNAMIC = ()
        BACKENDS = {"one": "one:f"}
        def load(name):
            module, _, attribute = name.partition(":")
            return getattr(importlib.import_module(module), attribute)
        === adds.py
        import table
        table.BACKENDS["new"] = "helper:f"
        === one.py
        def f(x):
            return x
        """ + ONE, {"backend": "one"}),
    Case("an entry that a package passes on", FOLLOWED, """
        === stage.py
        from load import load
        BACKENDS = {"one": "pack:f"}
        def run(x=3):
            return load(BACKENDS, "one")(x)
        === load.py
        import importlib
        DYNAMIC = ()
        def load(table, name):
            module, _, attribute = table[name].partition(":")
            return getattr(importlib.import_module(module), attribute)
        === pack/__init__.py
        from helper import f
        """ + ONE),
    Case("a dict of functions", FOLLOWED, """
        === stage.py
        from helper import TABLE
        def run(x=3):
            return TABLE["a"](x)
        === helper.py
        def f(x):
            return x + <<1|2>>
        TABLE = {"a": f}
        """),
    Case("a decorator that registers, in a module that the package imports", FOLLOWED, """
        === stage.py
        from pack.table import TABLE
        def run(x=3):
            return TABLE["a"](x)
        === pack/__init__.py
        from pack import plug
        === pack/table.py
        TABLE = {}
        def register(name):
            def outer(function):
                TABLE[name] = function
                return function
            return outer
        === pack/plug.py
        from pack.table import register
        @register("a")
        def f(x):
            return x + <<1|2>>
        """),
    Case("a method that registers", FOLLOWED, """
        === stage.py
        import plug
        from helper import TABLE
        def run(x=3):
            return TABLE[0](None, x)
        === helper.py
        TABLE = []
        def register(function):
            TABLE.append(function)
            return function
        === plug.py
        from helper import register
        class C:
            @register
            def m(self, x):
                return x + <<1|2>>
        """),
    Case("an entry that an imported module sets", FOLLOWED, """
        === stage.py
        from pack.table import TABLE
        def run(x=3):
            return TABLE["a"](x)
        === pack/__init__.py
        from pack import plug
        === pack/table.py
        TABLE = {}
        === pack/plug.py
        from pack.table import TABLE
        def f(x):
            return x + <<1|2>>
        TABLE["a"] = f
        """),
    Case("functools.singledispatch, registered elsewhere", FOLLOWED, """
        === stage.py
        from helper import f
        import pack.plug
        def run(x=3):
            return f(x)
        === helper.py
        from functools import singledispatch
        @singledispatch
        def f(x):
            return x
        === pack/__init__.py
        === pack/plug.py
        from helper import f
        @f.register
        def _(x: int):
            return x + <<1|2>>
        """),
    Case("a list of hooks, filled by an import", FOLLOWED, """
        === stage.py
        from helper import HOOKS
        import pack.plug
        def run(x=3):
            return HOOKS[0](x)
        === helper.py
        HOOKS = []
        === pack/__init__.py
        === pack/plug.py
        from helper import HOOKS
        HOOKS += [lambda x: x + <<1|2>>]
        """),
    Case("a module that only a function imports, for its effect", FOLLOWED, """
        === stage.py
        from helper import TABLE, load
        def run(x=3):
            load()
            return TABLE["a"](x)
        === helper.py
        TABLE = {}
        def load():
            import pack.plug
        === pack/__init__.py
        === pack/plug.py
        from helper import TABLE
        TABLE["a"] = lambda x: x + <<1|2>>
        """),
    Case("__init_subclass__ of a base", FOLLOWED, """
        === stage.py
        from helper import TABLE
        import pack.plug
        def run(x=3):
            return TABLE["One"]().m(x)
        === helper.py
        TABLE = {}
        class Base:
            def __init_subclass__(cls, **more):
                TABLE[cls.__name__] = cls
        === pack/__init__.py
        === pack/plug.py
        from helper import Base
        class One(Base):
            def m(self, x):
                return x + <<1|2>>
        """),
    Case("a metaclass that registers", FOLLOWED, """
        === stage.py
        from helper import TABLE
        import plug
        def run(x=3):
            return TABLE["One"]().m(x)
        === helper.py
        TABLE = {}
        class Meta(type):
            def __init__(cls, name, bases, space):
                TABLE[name] = cls
        class Base(metaclass=Meta):
            pass
        === plug.py
        from helper import Base
        class One(Base):
            def m(self, x):
                return x + <<1|2>>
        """),
    Case("__set_name__ of a field", FOLLOWED, """
        === stage.py
        from helper import TABLE
        import plug
        def run(x=3):
            return TABLE["m"](x)
        === helper.py
        TABLE = {}
        class Registered:
            def __init__(self, function):
                self.function = function
            def __set_name__(self, owner, name):
                TABLE[name] = self.function
        === plug.py
        from helper import Registered
        class C:
            m = Registered(lambda x: x + <<1|2>>)
        """),
]

STATEMENTS = [
    Case("a loop that fills a table", FOLLOWED, """
        === stage.py
        from helper import T
        def run(x=3):
            return T[x]
        === helper.py
        from third import g
        T = {}
        for n in range(5):
            T[n] = g(n)
        === third.py
        def g(n):
            return n + <<1|2>>
        """),
    Case("an augmented assignment", FOLLOWED, """
        === stage.py
        from helper import K
        def run(x=3):
            return x + K
        === helper.py
        from third import J
        K = 1
        K += J
        === third.py
        J = <<1|2>>
        """),
    Case("append", FOLLOWED, """
        === stage.py
        from helper import L
        def run(x=3):
            return L[0]
        === helper.py
        L = []
        L.append(<<1|2>>)
        """),
    Case("a starred target", FOLLOWED, """
        === stage.py
        from helper import REST
        def run(x=3):
            return sum(REST)
        === helper.py
        FIRST, *REST = [1, 2, <<3|4>>]
        """),
    Case("a named expression", FOLLOWED, F + "=== helper.py\nif (K := <<1|2>>):\n    pass\ndef f(x):\n    return x + K\n"),
    Case("a with", FOLLOWED, F + """
=== helper.py
import contextlib
with contextlib.suppress(KeyError):
    K = <<1|2>>
def f(x):
    return x + K
"""),
    Case("a global that a function sets at import", FOLLOWED, F + """
=== helper.py
K = 0
def set_up():
    global K
    K = <<1|2>>
set_up()
def f(x):
    return x + K
"""),
    Case("a global that a function sets, called in an assignment", FOLLOWED, F + """
=== helper.py
K = 0
def set_up():
    global K
    K = <<1|2>>
    return K
ignored = set_up()
def f(x):
    return x + K
"""),
    Case("setdefault in an assignment, own table", FOLLOWED, F + """
=== helper.py
T = {}
ignored = T.setdefault("a", <<1|2>>)
def f(x):
    return x + T["a"]
"""),
    Case("a function that fills what it is given", FOLLOWED, F + """
=== helper.py
T = {}
def fill(table):
    table["a"] = <<1|2>>
    return len(table)
COUNT = fill(T)
def f(x):
    return x + T["a"]
"""),
    Case("a comprehension that appends", FOLLOWED, F + """
=== helper.py
L = []
ignored = [L.append(n) for n in (<<1|2>>,)]
def f(x):
    return x + L[0]
"""),
    Case("the order of a dict", FOLLOWED, """
        === stage.py
        from helper import D
        def run(x=3):
            return list(D)
        === helper.py
        D = {<<"a": 1, "b": 2|"b": 2, "a": 1>>}
        """),
    Case("1 and True", FOLLOWED, _stage("str(h.K)", "import helper as h") + "=== helper.py\nK = <<1|True>>\n"),
    Case("1 and 1.0", FOLLOWED, _stage("str(h.K)", "import helper as h") + "=== helper.py\nK = <<1|1.0>>\n"),
    Case("0.0 and -0.0", FOLLOWED, _stage("str(h.K)", "import helper as h") + "=== helper.py\nK = <<0.0|-0.0>>\n"),
    Case("declared data", FOLLOWED, """
        === stage.py
        from pathlib import Path
        DATA_FILES = ("table.txt",)
        def run(x=3):
            return Path(__file__).with_name("table.txt").read_text()
        === table.txt
        <<1|2>>
        """),
]

K_IN_HELPER = "=== helper.py\nK = 0\ndef f(x):\n    return x + K\n"
T_IN_HELPER = "=== helper.py\nT = {}\ndef f(x):\n    return x + T['a']\n"
P = _stage("h.f(x)", "import patch", "import helper as h")
EFFECTS = [
    Case("a function in place of another", FOLLOWED, P + """
=== helper.py
def f(x):
    return x
=== patch.py
import helper
def g(x):
    return x + <<1|2>>
helper.f = g
"""),
    Case("setattr of a module", FOLLOWED, P + """
=== helper.py
def f(x):
    return x
=== patch.py
import helper
def g(x):
    return x + <<1|2>>
setattr(helper, "f", g)
"""),
    Case("a function that patches, called at import", FOLLOWED, P + K_IN_HELPER + """
=== patch.py
import helper
V = <<1|2>>
def patch():
    helper.K = V
patch()
"""),
    Case("a function that patches by a local name", FOLLOWED, P + K_IN_HELPER + """
=== patch.py
import helper
def patch():
    module = helper
    module.K = <<1|2>>
ignored = patch()
"""),
    Case("a function that patches what it imports", FOLLOWED, P + K_IN_HELPER + """
=== patch.py
def patch():
    import helper as h
    h.K = <<1|2>>
ignored = patch()
"""),
    Case("a function that patches the module it is given", FOLLOWED, P + K_IN_HELPER + """
=== patch.py
import helper
def patch(module):
    module.K = <<1|2>>
ignored = patch(helper)
"""),
    Case("an attribute of a class elsewhere", FOLLOWED, P + """
=== helper.py
class C:
    k = 0
def f(x):
    return x + C.k
=== patch.py
from helper import C
C.k = <<1|2>>
"""),
    Case("the __init__ of a package", FOLLOWED, """
        === stage.py
        from pack.inner import f
        def run(x=3):
            return f(x)
        === pack/__init__.py
        import helper
        helper.K = <<1|2>>
        === pack/inner.py
        from helper import f
        """ + K_IN_HELPER),
    Case("a module of a package, imported for its effect", FOLLOWED, """
        === stage.py
        import pack.patch
        from helper import f
        def run(x=3):
            return f(x)
        === pack/__init__.py
        === pack/patch.py
        import helper
        helper.K = <<1|2>>
        """ + K_IN_HELPER),
    Case("by another name of the module", FOLLOWED, P + K_IN_HELPER + "=== patch.py\nimport helper\nm = helper\nm.K = <<1|2>>\n"),
    Case("by another name of an object, with a method of ours", FOLLOWED, P + """
=== helper.py
class Table:
    def __init__(self):
        self.t = {}
    def add(self, name, value):
        self.t[name] = value
TABLE = Table()
def f(x):
    return x + TABLE.t["a"]
=== patch.py
from helper import TABLE as TAKEN
mine = TAKEN
mine.add("a", <<1|2>>)
"""),
    Case("a method of ours, in an assignment", FOLLOWED, P + """
=== helper.py
class Table:
    def __init__(self):
        self.t = {}
    def get(self, name, value):
        return self.t.setdefault(name, value)
TABLE = Table()
def f(x):
    return x + TABLE.t["a"]
=== patch.py
from helper import TABLE
found = TABLE.get("a", <<1|2>>)
"""),
    Case("what a function of ours returns", FOLLOWED, P + """
=== helper.py
T = {}
def table():
    return T
def f(x):
    return x + T["a"]
=== patch.py
import helper
ignored = helper.table().update(a=<<1|2>>)
"""),
    Case("in the body of a class", FOLLOWED,
         P + T_IN_HELPER + "=== patch.py\nfrom helper import T\nclass C:\n    T['a'] = <<1|2>>\n"),
    Case("in an assignment", FOLLOWED, P + T_IN_HELPER + "=== patch.py\nfrom helper import T\n_ = T.setdefault('a', <<1|2>>)\n"),
    Case("in a default", FOLLOWED,
         P + T_IN_HELPER + "=== patch.py\nfrom helper import T\ndef unused(x=T.setdefault('a', <<1|2>>)):\n    return x\n"),
    Case("in a comprehension", FOLLOWED,
         P + T_IN_HELPER + "=== patch.py\nfrom helper import T\n_ = [t.update(a=<<1|2>>) for t in (T,)]\n"),
    Case("in a lambda that is called", FOLLOWED, P + T_IN_HELPER + """
=== patch.py
from helper import T
def now(action):
    return action()
_ = now(lambda: T.update(a=<<1|2>>))
"""),
    Case("by dict.update", FOLLOWED, P + T_IN_HELPER + "=== patch.py\nfrom helper import T\n_ = dict.update(T, a=<<1|2>>)\n"),
    Case("by map", FOLLOWED, P + T_IN_HELPER + """
=== patch.py
from helper import T
def put(value):
    T["a"] = value
_ = list(map(put, [<<1|2>>]))
"""),
    Case("by making an object of ours", FOLLOWED, P + T_IN_HELPER + """
=== patch.py
from helper import T
class Entry:
    def __init__(self, value):
        T["a"] = value
ENTRY = Entry(<<1|2>>)
"""),
    Case("by a loop over functions of ours", FOLLOWED, P + T_IN_HELPER + """
=== patch.py
from helper import T
def put(value):
    T["a"] = value
for value in (<<1|2>>,):
    put(value)
"""),
    Case("by a lambda that is called where it stands", FOLLOWED,
         P + T_IN_HELPER + "=== patch.py\nfrom helper import T\n_ = (lambda: T.update(a=<<1|2>>))()\n"),
    Case("by a method of a new object", FOLLOWED, P + T_IN_HELPER + """
=== patch.py
from helper import T
class Putter:
    def put(self, value):
        T["a"] = value
_ = Putter().put(<<1|2>>)
"""),
    Case("by a method of an object with a name", FOLLOWED, P + T_IN_HELPER + """
=== patch.py
from helper import T
class Putter:
    def put(self, value):
        T["a"] = value
PUTTER = Putter()
_ = PUTTER.put(<<1|2>>)
"""),
    Case("by a with over an object of ours", FOLLOWED, P + T_IN_HELPER + """
=== patch.py
from helper import T
class Putter:
    def __enter__(self):
        T["a"] = <<1|2>>
    def __exit__(self, *error):
        pass
with Putter():
    pass
"""),
    Case("by a generator that is walked", FOLLOWED, P + T_IN_HELPER + """
=== patch.py
from helper import T
def put():
    yield T.update(a=<<1|2>>)
_ = list(put())
"""),
    Case("by a loop over another name of the module", FOLLOWED, P + K_IN_HELPER + """
=== patch.py
import helper
m = helper
for each in (m,):
    each.K = <<1|2>>
"""),
    Case("by a module that a function returns", FOLLOWED, P + K_IN_HELPER + """
=== patch.py
def module():
    import helper
    return helper
module().K = <<1|2>>
"""),
    Case("by a table of modules", FOLLOWED, P + K_IN_HELPER + """
=== patch.py
import helper
MODULES = {"h": helper}
MODULES["h"].K = <<1|2>>
"""),
    Case("by functools.partial", FOLLOWED, P + T_IN_HELPER + """
=== patch.py
from functools import partial
from helper import T
def put(value):
    T["a"] = value
_ = partial(put, <<1|2>>)()
"""),
    Case("by functools.reduce", FOLLOWED, P + T_IN_HELPER + """
=== patch.py
from functools import reduce
from helper import T
_ = reduce(lambda sum, n: T.update(a=n), [<<1|2>>], None)
"""),
    Case("by a key of sorted", FOLLOWED, P + T_IN_HELPER + """
=== patch.py
from helper import T
def put(value):
    T["a"] = value
    return 0
_ = sorted([<<1|2>>], key=put)
"""),
    Case("by a name that is bound under a condition", FOLLOWED, P + K_IN_HELPER + """
=== patch.py
import sys, helper
if sys.version_info > (3, 0):
    m = helper
m.K = <<1|2>>
"""),
    Case("by object.__setattr__", FOLLOWED, P + """
=== helper.py
class C:
    k = 0
ONE = C()
def f(x):
    return x + ONE.k
=== patch.py
import helper
_ = object.__setattr__(helper.ONE, "k", <<1|2>>)
"""),
]

MODULES = [
    Case("getattr(module, 'name')", FOLLOWED, _stage("getattr(h, 'f')(x)", "import helper as h") + ONE),
    Case("vars(module)", FOLLOWED, _stage("vars(h)['f'](x)", "import helper as h") + ONE),
    Case("vars(module), of a name that it imports", FOLLOWED,
         _stage("vars(h)['f'](x)", "import passes as h") + "=== passes.py\nfrom helper import f\n" + ONE),
    Case("operator.attrgetter", FOLLOWED,
         _stage("attrgetter('f')(h)(x)", "from operator import attrgetter", "import helper as h") + ONE),
    Case("another name of getattr", FOLLOWED,
         "=== stage.py\nimport helper as h\ndef run(x=3):\n    g = getattr\n    return g(h, chr(102))(x)\n" + ONE),
    Case("getattr(module, <computed>)", REFUSED,
         _stage("getattr(h, chr(102))(x)", "import helper as h") + ONE),
    Case("a package as a value", REFUSED, """
        === stage.py
        import pack
        import pack.inner
        def run(x=3):
            return vars(pack)["inner"].f(x)
        === pack/__init__.py
        === pack/inner.py
        def f(x):
            return x + <<1|2>>
        """),
    Case("module.__dict__", REFUSED, _stage("h.__dict__['f'](x)", "import helper as h") + ONE),
    Case("sys.modules", REFUSED, _stage("sys.modules['helper'].f(x)", "import sys", "import helper") + ONE),
    Case("sys.modules.get", REFUSED,
         _stage("sys.modules.get('helper').f(x)", "import sys", "import helper") + ONE),
    Case("modules of sys", REFUSED,
         _stage("modules['helper'].f(x)", "from sys import modules", "import helper") + ONE),
    Case("sys.path", REFUSED, """
        === stage.py
        import sys
        sys.path.append(".")
        def run(x=3):
            import helper
            return helper.f(x)
        """ + ONE),
    Case("from module import *", REFUSED, _stage("f(x)", "from helper import *") + ONE),
    Case("a module and a package of one name", REFUSED, """
        === stage.py
        from both import f
        def run(x=3):
            return f(x)
        === both.py
        def f(x):
            return x
        === both/__init__.py
        def f(x):
            return x + <<1|2>>
        """),
    Case("importlib.import_module", REFUSED,
         _stage("importlib.import_module('helper').f(x)", "import importlib") + ONE),
    Case("import_module under another name", REFUSED,
         _stage("im('helper').f(x)", "from importlib import import_module as im") + ONE),
    Case("importlib under another name", REFUSED,
         _stage("il.import_module('helper').f(x)", "import importlib as il") + ONE),
    Case("importlib as a value", REFUSED,
         "=== stage.py\nimport importlib\ndef run(x=3):\n    il = importlib\n    return il.import_module('helper').f(x)\n" + ONE),
    Case("importlib.reload", REFUSED,
         _stage("importlib.reload(helper).f(x)", "import importlib, helper") + ONE),
    Case("spec_from_file_location", REFUSED, """
        === stage.py
        import importlib.util
        def run(x=3):
            spec = importlib.util.spec_from_file_location("any", "helper.py")
            module = importlib.util.module_from_spec(spec)
            spec.loader.exec_module(module)
            return module.f(x)
        """ + ONE),
    Case("runpy", REFUSED, _stage("runpy.run_module('helper')['f'](x)", "import runpy") + ONE),
    Case("pkgutil.resolve_name", REFUSED,
         _stage("resolve_name('helper').f(x)", "from pkgutil import resolve_name") + ONE),
    Case("__import__", REFUSED, _stage("__import__('helper').f(x)") + ONE),
    Case("builtins.__import__", REFUSED, _stage("builtins.__import__('helper').f(x)", "import builtins") + ONE),
    Case("eval", REFUSED, _stage("eval('f(x)')", "from helper import f") + ONE),
    Case("exec of a file", REFUSED, """
        === stage.py
        def run(x=3):
            names = {}
            exec(open("helper.py").read(), names)
            return names["f"](x)
        """ + ONE),
    Case("globals()", REFUSED, _stage("globals()['f'](x)", "from helper import f") + ONE),
    Case("locals()", REFUSED, "=== stage.py\ndef run(x=3):\n    from helper import f\n    return locals()['f'](x)\n" + ONE),
    Case("vars()", REFUSED, "=== stage.py\ndef run(x=3):\n    from helper import f\n    return vars()['f'](x)\n" + ONE),
    Case("function.__globals__", REFUSED, """
        === stage.py
        from helper import g
        def run(x=3):
            return g.__globals__["f"](x)
        """ + ONE + "def g(x):\n    return x\n"),
    Case("unittest.mock.patch", REFUSED, """
        === stage.py
        from unittest import mock
        from helper import f
        def run(x=3):
            with mock.patch("helper.K", 1):
                return f(x)
        === helper.py
        K = 0
        def f(x):
            return x + K + <<1|2>>
        """),
    Case("__subclasses__", REFUSED, """
        === stage.py
        from helper import Base
        import plug
        def run(x=3):
            return Base.__subclasses__()[0]().m(x)
        === helper.py
        class Base:
            pass
        === plug.py
        from helper import Base
        class One(Base):
            def m(self, x):
                return x + <<1|2>>
        """),
    Case("a script of ours in a process", REFUSED, """
        === stage.py
        import subprocess, sys
        from pathlib import Path
        def run(x=3):
            script = Path(__file__).with_name("script.py")
            return subprocess.run([sys.executable, script, str(x)], capture_output=True, text=True).stdout
        === script.py
        import sys
        print(int(sys.argv[1]) + <<1|2>>)
        """),
    Case("data that is not declared", REFUSED, """
        === stage.py
        from pathlib import Path
        def run(x=3):
            return Path(__file__).with_name("table.txt").read_text()
        === table.txt
        <<1|2>>
        """),
    Case("data beside another module", REFUSED, """
        === stage.py
        from pathlib import Path
        import helper
        def run(x=3):
            return Path(helper.__file__).with_name("table.txt").read_text()
        === helper.py
        === table.txt
        <<1|2>>
        """),
    Case("a docstring of a function, as data", REFUSED,
         F.replace("f(x)", "f.__doc__") + '=== helper.py\ndef f(x):\n    """<<one|two>>"""\n    return x\n'),
    Case("a docstring of a module, as data", REFUSED, H.replace("h.f(x)", "h.__doc__") + '=== helper.py\n"""<<one|two>>"""\n'),
    Case("the own docstring, as data", REFUSED, '=== stage.py\n"""<<one|two>>"""\ndef run(x=3):\n    return __doc__\n'),
    Case("a docstring by getattr, as data", REFUSED,
         F.replace("f(x)", "getattr(f, '__doc__')") + '=== helper.py\ndef f(x):\n    """<<one|two>>"""\n    return x\n'),
    Case("a state of a library, set at import", REFUSED, """
        === stage.py
        import plug
        def run(x=3):
            from decimal import Decimal
            return str(Decimal(1) / Decimal(7))
        === plug.py
        import decimal
        decimal.getcontext().prec = <<5|6>>
        """),
    Case("a state of a library, set in an assignment at import", REFUSED, """
        === stage.py
        import plug
        def run(x=3):
            from decimal import Decimal
            return str(Decimal(1) / Decimal(7))
        === plug.py
        from decimal import Context, setcontext
        old = setcontext(Context(prec=<<5|6>>))
        """),
    Case("a state of a library, set by a function at import", FOLLOWED, """
        === stage.py
        import plug
        def run(x=3):
            from decimal import Decimal
            return str(Decimal(1) / Decimal(7))
        === plug.py
        import decimal
        def less():
            decimal.getcontext().prec = <<5|6>>
        old = less()
        """),
]

VALUES = [
    Case("a method of an input, by its hint", FOLLOWED, """
        === stage.py
        from __future__ import annotations
        from helper import V
        def run(value: V):
            return value.m(3)
        === helper.py
        class V:
            def m(self, x):
                return x + <<1|2>>
        === outside.py
        from helper import V
        VALUE = V()
        """),
    Case("a method of an element of an input, by its hint", FOLLOWED, """
        === stage.py
        from __future__ import annotations
        from helper import V
        def run(values: tuple[V, ...]):
            return [value.m(3) for value in values]
        === helper.py
        class V:
            def m(self, x):
                return x + <<1|2>>
        === outside.py
        from helper import V
        VALUE = (V(), V())
        """),
    Case("a method of an input, by a hint for type checkers", FOLLOWED, """
        === stage.py
        from __future__ import annotations
        from typing import TYPE_CHECKING
        if TYPE_CHECKING:
            from helper import V
        def run(value: V):
            return value.m(3)
        === helper.py
        class V:
            def m(self, x):
                return x + <<1|2>>
        === outside.py
        from helper import V
        VALUE = V()
        """),
    Case("a method of an input of type Any", REFUSED, """
        === stage.py
        from typing import Any
        def run(value: Any):
            return value.m(3)
        === helper.py
        class V:
            def m(self, x):
                return x + <<1|2>>
        === outside.py
        from helper import V
        VALUE = V()
        """),
    Case("a method of an input without a type", REFUSED, """
        === stage.py
        def run(value):
            return value.m(3)
        === helper.py
        class V:
            def m(self, x):
                return x + <<1|2>>
        === outside.py
        from helper import V
        VALUE = V()
        """),
]

NOTHING = [
    Case("a comment, a docstring and layout", SAME,
         F + '=== helper.py\ndef f(x):\n    """<<One.|Two.>>"""\n    return <<x + 1|(x +  # one\n            1)>>\n'),
    Case("the docstring of a module", SAME, F + '=== helper.py\n"""<<One.|Two.>>"""\ndef f(x):\n    return x\n'),
    Case("text under a constant", SAME, F + '=== helper.py\nK = 1\n"""<<one|two>>"""\ndef f(x):\n    return x + K\n'),
    Case("an unused function", SAME, F + "=== helper.py\ndef f(x):\n    return x\ndef unused(x):\n    return x + <<1|2>>\n"),
    Case("an unused constant that a library makes", SAME,
         F + "=== helper.py\nimport re\nUNUSED = re.compile('<<a|b>>')\ndef f(x):\n    return x\n"),
    Case("an unused constant that a function of ours makes", SAME, F + """
=== helper.py
def make(n):
    made = []
    made.append(n)
    return made
UNUSED = make(<<1|2>>)
def f(x):
    return x
"""),
    Case("an unused constant of a dataclass of ours", SAME, F + """
=== helper.py
from dataclasses import dataclass
from third import LIMITS
@dataclass(frozen=True)
class Range:
    low: float
    high: float
    def __post_init__(self):
        if not self.low < self.high:
            raise ValueError(self.low)
UNUSED = Range(LIMITS[0], <<1|2>>)
def f(x):
    return x
=== third.py
LIMITS = (0,)
"""),
    Case("an unused table of functions of ours", SAME, F + """
=== helper.py
from third import put
UNUSED = {"a": (put, <<1|2>>)}
def f(x):
    return x
=== third.py
T = {}
def put(value):
    T["a"] = value
"""),
    Case("an unused class of a module that is loaded", SAME, F + """
=== helper.py
from third import Base
class Unused(Base):
    k: int = <<1|2>>
def f(x):
    return x
=== third.py
class Base:
    def __init__(self, table):
        table["a"] = self
"""),
    Case("what only a type checker imports", SAME, """
        === stage.py
        from __future__ import annotations
        from typing import TYPE_CHECKING
        if TYPE_CHECKING:
            from <<typing|collections.abc>> import Sequence
        def run(x: Sequence = 3):
            return x
        """),
    Case("what runs only as a program", SAME, F + """
=== helper.py
def f(x):
    return x
if __name__ == "__main__":
    print(f(<<1|2>>))
"""),
    Case("what a library resolves by a string", SAME, F + """
=== helper.py
import copyreg
copyreg.constructor(print)
NAMES = ("third:unused",)
def f(x):
    return x
=== third.py
def unused():
    return <<1|2>>
"""),
]

CASES = [*CALLS, *CLASSES, *IMPORTS, *TABLES, *STATEMENTS, *EFFECTS, *MODULES, *VALUES, *NOTHING]
