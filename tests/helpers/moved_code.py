"""Moved code and names that refer to other code: kinds of edit for `tests/helpers/edited_code.py`.

Moving code with its imports adapted changes no fingerprint; a name that refers to something else does.
"""

from __future__ import annotations

from tests.helpers.edited_code import FOLLOWED, SAME, Case

F = "=== stage.py\nfrom <<helper|another>> import f\ndef run(x=3):\n    return f(x)\n"
TWO = "=== one.py\ndef f(x):\n    return x + 1\ndef g(x):\n    return x + 2\n=== two.py\ndef f(x):\n    return x * 2\n"
LOAD = "=== load.py\nimport importlib\nDYNAMIC = ()\ndef load(entry):\n    module, name = entry.split(':')\n" \
       "    return getattr(importlib.import_module(module), name)\n"

MOVED = [
    Case("a module with another name", SAME, F + "=== <<helper|another>>.py\nK = 1\ndef f(x):\n    return x + K\n"),
    Case("a module that goes into a folder", SAME, """
        === stage.py
        from <<helper|pack.deep.helper>> import f
        def run(x=3):
            return f(x)
        === <<helper|pack/deep/helper>>.py
        def f(x):
            return x + 1
        """),
    Case("a stage and its neighbour that go into a folder", SAME, """
        === stage.py
        from <<inner|pack.inner>> import run
        === <<inner|pack/inner>>.py
        from <<helper|.helper>> import f
        def run(x=3):
            return f(x)
        === <<helper|pack/helper>>.py
        def f(x):
            return x + 1
        """),
    Case("a relative import that becomes absolute", SAME, """
        === stage.py
        from pack.inner import f
        def run(x=3):
            return f(x)
        === pack/inner.py
        from <<.helper|pack.helper>> import g
        def f(x):
            return g(x)
        === pack/helper.py
        def g(x):
            return x + 1
        """),
    Case("a module used by its attributes that moves", SAME, """
        === stage.py
        from <<pack|pack.sub>> import helper
        def run(x=3):
            return helper.f(x) + helper.K
        === <<pack/helper|pack/sub/helper>>.py
        K = 1
        def f(x):
            return x + 1
        """),
    Case("a module under another name that moves", SAME, """
        === stage.py
        import <<helper|pack.helper>> as h
        def run(x=3):
            return h.f(x)
        === <<|pack/>>helper.py
        def f(x):
            return x + 1
        """),
    Case("an import in a function that follows a move", SAME, """
        === stage.py
        def run(x=3):
            from <<helper|pack.helper>> import f
            return f(x)
        === <<|pack/>>helper.py
        def f(x):
            return x + 1
        """),
    Case("an import in a method that follows a move", SAME, """
        === stage.py
        class C:
            def m(self, x):
                from <<helper|pack.helper>> import f as g
                return g(x)
        def run(x=3):
            return C().m(x)
        === <<|pack/>>helper.py
        def f(x):
            return x + 1
        """),
    Case("a module that is split in two", SAME, """
        === stage.py
        <<from helper import f, g|from helper import f
        from third import g>>
        def run(x=3):
            return f(x) + g(x)
        === helper.py
        <<K = 2|from third import K>>
        def f(x):
            return x + K
        <<def g(x):
            return x * K|>>
        === third.py
        <<|K = 2
        def g(x):
            return x * K>>
        """),
    Case("imports in a function of a module that is split in two", SAME, """
        === stage.py
        def run(x=3):
            <<from helper import f, g|from helper import f
            from third import g>>
            return f(x) + g(x)
        === helper.py
        def f(x):
            return x + 1
        <<def g(x):
            return x * 2|>>
        === third.py
        <<|def g(x):
            return x * 2>>
        """),
    Case("two modules that become one", SAME, """
        === stage.py
        from helper import f
        from <<third|helper>> import g
        def run(x=3):
            return f(x) + g(x)
        === helper.py
        <<from third import g|def g(x):
            return x * K
        K = 2>>
        def f(x):
            return g(x) + 1
        === third.py
        <<K = 2
        def g(x):
            return x * K|>>
        """),
    Case("a class and a function that need each other and move", SAME, """
        === stage.py
        from <<helper|pack.helper>> import f
        def run(x=3):
            return f(x)
        === <<|pack/>>helper.py
        class C:
            def m(self, x):
                return f(x - 1)
        def f(x):
            return C().m(x) if x else 0
        """),
    Case("a name that another module passes on", SAME, """
        === stage.py
        from <<pack|pack.helper>> import f
        def run(x=3):
            return f(x)
        === pack/__init__.py
        from pack.helper import f
        === pack/helper.py
        def f(x):
            return x + 1
        """),
    Case("an identical definition elsewhere", SAME, F + """
=== helper.py
def f(x):
    return x + 1
=== another.py
def f(x):
    return x + 1
"""),
    Case("the entry of a registry that moves", SAME, LOAD + """
=== stage.py
from load import load
BACKENDS = {"flow": "<<helper|pack.helper>>:f", "other": "<<two|three>>:f"}
def run(x=3):
    return load(BACKENDS["flow"])(x)
=== <<|pack/>>helper.py
def f(x):
    return x + 1
=== <<two|three>>.py
def f(x):
    return x + 2
"""),
    Case("a string that names code that moves", SAME, LOAD + """
=== stage.py
from load import load
def run(x=3):
    return load("<<helper|pack.helper>>:f")(x)
=== <<|pack/>>helper.py
def f(x):
    return x + 1
"""),
    Case("an annotation of a class that moves", SAME, """
        === stage.py
        from <<helper|pack.helper>> import C
        def run(x: C = 3):
            return x
        === <<|pack/>>helper.py
        class C:
            k = 1
        """),
    Case("either of two modules that move", SAME, """
        === stage.py
        try:
            from <<helper|pack.helper>> import f
        except ImportError:
            from <<third|pack.third>> import f
        def run(x=3):
            return f(x)
        === <<|pack/>>helper.py
        def f(x):
            return x + 1
        === <<|pack/>>third.py
        def f(x):
            return x + 2
        """),
    Case("a module that fills the table of another, and moves", SAME, """
        === stage.py
        import <<filler|pack.filler>>
        from helper import T
        def run(x=3):
            return T["x"]
        === helper.py
        T = {}
        === <<|pack/>>filler.py
        from helper import T
        T["x"] = 1
        """),
    Case("two modules that fill a table, and move", SAME, """
        === stage.py
        import <<one|pack.z>>, <<two|pack.y>>
        from helper import T
        def run(x=3):
            return sorted(T)
        === helper.py
        T = {}
        === <<one|pack/z>>.py
        from helper import T
        T["x"] = 1
        === <<two|pack/y>>.py
        from helper import T
        T["y"] = 2
        """),
    Case("a module that moves with its data", SAME, """
        === stage.py
        from <<helper|pack.helper>> import f
        def run(x=3):
            return f(x)
        === <<|pack/>>helper.py
        from pathlib import Path
        DATA_FILES = ("map.csv",)
        def f(x):
            return Path(__file__).with_name("map.csv").read_text()
        === <<|pack/>>map.csv
        a,b
        """),
    Case("a module that moves with what it may load", SAME, """
        === stage.py
        from <<helper|pack.helper>> import f
        def run(x=3):
            return f("one") + f("two")
        === <<|pack/>>helper.py
        import importlib
        DYNAMIC = ("<<|pack.>>one", "<<|pack.>>two")
        def f(x):
            return importlib.import_module(f"{HOME}{x}").K
        from <<home|pack.home>> import HOME
        === <<|pack/>>home.py
        import os
        HOME = "pack." if os.path.exists("pack") else ""
        === <<|pack/>>one.py
        K = 1
        === <<|pack/>>two.py
        K = 2
        """),
    Case("a program that moves", SAME, """
        === stage.py
        import subprocess, sys
        from <<|pack >>import helper
        def run(x=3):
            return subprocess.run([sys.executable, "-m", helper.__name__], capture_output=True, text=True, check=True).stdout
        === <<|pack/>>helper.py
        if __name__ == "__main__":
            print(1)
        """.replace("from <<|pack >>import", "<<import|from pack import>>")),
    Case("a string that only a library gets to see, of a module that moves", SAME, """
        === stage.py
        from <<helper|pack.helper>> import f
        def run(x=3):
            return f(x)
        === <<|pack/>>helper.py
        import copyreg
        copyreg.constructor(print)
        NAMES = ("<<|pack.>>helper:f",)
        def f(x):
            return x
        """),
]

LED_ELSEWHERE = [
    Case("two functions that swap what they do", FOLLOWED, """
        === stage.py
        from helper import f, g
        def run(x=3):
            return f(x) - g(x)
        === helper.py
        def f(x):
            return x <<+ 1|* 5>>
        def g(x):
            return x <<* 5|+ 1>>
        """),
    Case("two imports that swap their names", FOLLOWED, TWO + """
=== stage.py
from one import <<f as a, g as b|g as a, f as b>>
def run(x=3):
    return a(x) - b(x)
"""),
    Case("another module under the same name", FOLLOWED, TWO + """
=== stage.py
from <<one|two>> import f as h
def run(x=3):
    return h(x)
"""),
    Case("another module under the same name, in a function", FOLLOWED, TWO + """
=== stage.py
def run(x=3):
    from <<one|two>> import f
    return f(x)
"""),
    Case("two imports in a function that swap their names", FOLLOWED, TWO + """
=== stage.py
def run(x=3):
    from one import <<f as a, g as b|g as a, f as b>>
    return a(x) - b(x)
"""),
    Case("one of three names in a function", FOLLOWED, TWO + """
=== stage.py
def run(x=3):
    from one import f as a
    from <<one|two>> import f as b
    from two import f as c
    return [a(x), b(x), c(x)]
"""),
    Case("a library's function under the same name, in a function", FOLLOWED, """
        === stage.py
        def run(x=3):
            from math import <<floor|ceil>> as f
            return f(x / 2)
        """),
    Case("which of two modules comes first", FOLLOWED, TWO + """
=== stage.py
try:
    from <<one|two>> import f
except ImportError:
    from <<two|one>> import f
def run(x=3):
    return f(x)
"""),
    Case("an entry of a registry that leads elsewhere", FOLLOWED, TWO + LOAD + """
=== stage.py
from load import load
BACKENDS = {"a": "<<one|two>>:f"}
def run(x=3):
    return load(BACKENDS["a"])(x)
"""),
    Case("two entries of a registry that swap", FOLLOWED, TWO + LOAD + """
=== stage.py
from load import load
BACKENDS = {"a": "<<one|two>>:f", "b": "<<two|one>>:f"}
def run(x=3):
    return load(BACKENDS["a"])(x) - load(BACKENDS["b"])(x)
"""),
    Case("a string that names other code", FOLLOWED, TWO + LOAD + """
=== stage.py
from load import load
def run(x=3):
    return load("<<one|two>>:f")(x)
"""),
    Case("two strings that swap", FOLLOWED, TWO + LOAD + """
=== stage.py
from load import load
def run(x=3):
    return load("<<one|two>>:f")(x) - load("<<two|one>>:f")(x)
"""),
    Case("a string that names no code", FOLLOWED, "=== stage.py\ndef run(x=3):\n    return '<<a:b|b:b>>'\n"),
    Case("two modules that a module may load swap", FOLLOWED, """
        === stage.py
        import importlib
        DYNAMIC = ("one", "two")
        def run(x=3):
            return [importlib.import_module(name).K for name in ("one", "two")]
        === one.py
        K = <<1|2>>
        === two.py
        K = <<2|1>>
        """),
    Case("the data of two modules swaps", FOLLOWED, """
        === stage.py
        from one.read import f
        from two.read import g
        def run(x=3):
            return [f(), g()]
        === one/read.py
        from pathlib import Path
        DATA_FILES = ("map.csv",)
        def f():
            return Path(__file__).with_name("map.csv").read_text()
        === one/map.csv
        <<a|b>>
        === two/read.py
        from pathlib import Path
        DATA_FILES = ("map.csv",)
        def g():
            return Path(__file__).with_name("map.csv").read_text()
        === two/map.csv
        <<b|a>>
        """),
    Case("the name of a module that is used", FOLLOWED, F + "=== <<helper|another>>.py\ndef f(x):\n    return __name__\n"),
    Case("the name of the module of a class", FOLLOWED, F + """
=== <<helper|another>>.py
class C:
    pass
def f(x):
    return C().__module__
"""),
    Case("the name of a module that a string asks for", FOLLOWED, F + """
=== <<helper|another>>.py
class C:
    pass
def f(x):
    return getattr(C(), "__module__")
"""),
    Case("the name of a module that is passed on", FOLLOWED, """
        === stage.py
        import <<helper|another>> as h
        def named(module):
            return module.__name__
        def run(x=3):
            return named(h)
        === <<helper|another>>.py
        K = 1
        """),
    Case("a name of a module in what is pickled", FOLLOWED, """
        === stage.py
        import pickle
        from <<helper|another>> import C
        def run(x=3):
            return pickle.dumps(C())
        === <<helper|another>>.py
        class C:
            pass
        """),
    Case("which of two equal tables is filled", FOLLOWED, """
        === stage.py
        import filler
        from one import T
        from two import U
        def run(x=3):
            return [dict(T), dict(U.T)]
        === one.py
        T = {}
        === two.py
        from three import T
        class U:
            T = T
        === three.py
        T = {}
        === filler.py
        from <<one|three>> import T
        T["x"] = 1
        """),
    Case("which of two equal errors is caught", FOLLOWED, """
        === stage.py
        from one import Bad
        from <<one|two>> import Bad as Caught
        def run(x=3):
            try:
                raise Bad
            except Caught:
                return 1
            except Exception:
                return 2
        === one.py
        class Bad(Exception):
            pass
        === two.py
        class Bad(Exception):
            pass
        """),
    Case("a cycle of two functions whose ends swap", FOLLOWED, """
        === stage.py
        from helper import f
        def run(x=3):
            return f(x)
        === helper.py
        def f(x):
            return <<g|f>>(x - 1) + 1 if x > 0 else 0
        def g(x):
            return <<f|g>>(x - 1) + 2 if x > 0 else 0
        """),
]
