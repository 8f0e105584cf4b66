"""Classification of code outside the project: functions without side effects, global state, untraceable access."""

from __future__ import annotations

import re
from collections.abc import Callable

VALUES = frozenset((
    "abc", "base64", "collections", "cv2", "dataclasses", "datetime", "decimal", "enum", "fractions", "functools", "hashlib",
    "itertools", "json", "math", "numbers", "numpy", "operator.attrgetter", "operator.itemgetter", "pathlib", "pyarrow", "re",
    "scipy", "statistics", "string", "struct", "textwrap", "torch", "types", "typing", "typing_extensions", "uuid"))
"""packages whose functions only return values, except those with a name in `SETS`"""
SETS = re.compile("add|append|configure|copyto|disable|enable|extend|fill|filterwarnings|import|init|insert|"
                  "install|load|manual_seed|patch|place|push|put|rc|reduce|register|remove|seed|set|"
                  "shuffle|simplefilter|singledispatch|unregister|use")
"""prefixes of names of functions with side effects"""
KEPT = re.compile("get|current|default|root")
"""prefixes of names of functions that return an object which the library keeps"""
STATE = re.compile(r"set(?!diff|xor)\w*|seed|manual_seed\w*|filterwarnings|simplefilter")
"""names of functions that set global state of the process"""

COMPUTED = ("importlib.import_module", "builtins.__import__", "builtins.eval", "builtins.exec", "builtins.globals",
            "builtins.locals", "importlib.__import__", "pkgutil.resolve_name")
"""functions that may load anything; a module that uses one must list the loaded modules in DYNAMIC"""
IMPORT = 'use a literal registry, or list the modules that it may load in DYNAMIC = ("module", ...) of that module'
PLAIN = "import the used name with a plain import"
FILES = 'name the files in DATA_FILES = ("file beside the module", ...) and read them by Path(__file__)'
NEVER = {
    **dict.fromkeys(("importlib.util.spec_from_file_location", "importlib.util.spec_from_loader", "importlib.util.module_from_spec",
                     "importlib.util.LazyLoader", "importlib.machinery", "importlib.reload", "importlib.metadata.entry_points",
                     "runpy", "imp", "zipimport", "code", "pkgutil.iter_modules", "pkgutil.walk_packages",
                     "sys.modules", "sys.path", "sys.meta_path", "sys.path_hooks", "sys._getframe", "inspect.getmodule",
                     "inspect.currentframe", "inspect.stack", "pydoc.locate", "gymnasium.make", "gymnasium.make_vec",
                     "gc.get_objects", "gc.get_referrers", "unittest.mock"), PLAIN),
    **dict.fromkeys(("importlib", "builtins", "builtins.__builtins__"), "import only the function that is used"),
    **dict.fromkeys(("inspect.getsource", "inspect.getsourcelines", "inspect.getdoc", "inspect.getcomments"),
                    "keep text that is data in a constant"),
    **dict.fromkeys(("importlib.resources", "pkgutil.get_data", "inspect.getfile", "inspect.getsourcefile"), FILES)}
"""names that are always refused -> advice"""
ROOTS = frozenset(name.partition(".")[0] for name in (*COMPUTED, *NEVER))
UNSEEN = {"__doc__": "docstrings do not count as code; keep text that is data in a constant",
          "__subclasses__": "list the classes in a tuple or a registry", "exec_module": PLAIN, "load_module": PLAIN}
"""attributes that are refused on any object -> advice"""


def harmless(entry: str) -> bool:
    """Return True for a call, 'package.function()', or a change of its result, 'package.function!', without side effects."""
    function, returned, _ = entry.partition("!")
    parts = function.removesuffix("()").split(".")
    if not (parts[0] in VALUES or ".".join(parts[:2]) in VALUES) or any(SETS.match(part) for part in parts[1:]):
        return False
    return "!()" not in entry and not KEPT.match(parts[-1]) if returned else entry.endswith("()")


def sets_state(entry: str) -> bool:
    """Return True when an import that uses 'package.object' or 'package.function()' sets global state of the process."""
    parts = entry.replace("!", "").removesuffix("()").split(".")
    return not entry.endswith("()") or any(STATE.fullmatch(part) for part in parts[1:])


def refusal(dotted: str, ours: Callable[[str], bool]) -> tuple[str, str] | None:
    """(reason, advice) for a name outside the project whose use cannot be traced; None for an acceptable name."""
    if dotted.partition(".")[0] not in ROOTS:
        return None
    parts = dotted.split(".")
    for count in range(len(parts), 0, -1):
        name = ".".join(parts[:count])
        if name in COMPUTED:
            return f"{name.removeprefix('builtins.')}()", IMPORT
        if name in NEVER and (count > 1 or len(parts) == 1 or name not in ("importlib", "builtins")) and not _of_others(
                parts, count, ours):
            return name, NEVER[name]
    return None


def _of_others(parts: list[str], count: int, ours: Callable[[str], bool]) -> bool:
    """Return True for `sys.modules["name"]` of a module outside the project."""
    key = parts[count] if parts[:count] == ["sys", "modules"] and len(parts) > count else ""
    return key.startswith("[") and not ours(key[1:-1])
