"""What is known of code that is not ours: which functions of it only make values, which set states of a whole process, and
which reach our code by a way that nobody can follow.
"""

from __future__ import annotations

import re
from collections.abc import Callable

VALUES = frozenset((
    "abc", "base64", "collections", "cv2", "dataclasses", "datetime", "decimal", "enum", "fractions", "functools", "hashlib",
    "itertools", "json", "math", "numbers", "numpy", "operator.attrgetter", "operator.itemgetter", "pathlib", "pyarrow", "re",
    "scipy", "statistics", "string", "struct", "textwrap", "torch", "types", "typing", "typing_extensions", "uuid"))
"""packages whose functions make values, but for those whose name says otherwise (`SETS`)"""
SETS = re.compile("add|append|configure|copyto|disable|enable|extend|fill|filterwarnings|import|init|insert|"
                  "install|load|manual_seed|patch|place|push|put|rc|reduce|register|remove|seed|set|"
                  "shuffle|simplefilter|singledispatch|unregister|use")
"""how names start of what does not only make a value"""
KEPT = re.compile("get|current|default|root")
"""how names start of what returns an object that a library keeps"""
STATE = re.compile(r"set(?!diff|xor)\w*|seed|manual_seed\w*|filterwarnings|simplefilter")
"""names of what sets a state of a whole process"""

COMPUTED = ("importlib.import_module", "builtins.__import__", "builtins.eval", "builtins.exec", "builtins.globals",
            "builtins.locals", "importlib.__import__", "pkgutil.resolve_name")
"""what may load anything; a module may use it when it names in DYNAMIC what that is"""
IMPORT = 'use a literal registry, or name what it may load in DYNAMIC = ("module", ...) of that module'
PLAIN = "write a plain import of what it uses"
FILES = 'name the files in DATA_FILES = ("file beside the module", ...) and read them by Path(__file__)'
NEVER = {
    **dict.fromkeys(("importlib.util.spec_from_file_location", "importlib.util.spec_from_loader", "importlib.util.module_from_spec",
                     "importlib.util.LazyLoader", "importlib.machinery", "importlib.reload", "importlib.metadata.entry_points",
                     "runpy", "imp", "zipimport", "code", "pkgutil.iter_modules", "pkgutil.walk_packages",
                     "sys.modules", "sys.path", "sys.meta_path", "sys.path_hooks", "sys._getframe", "inspect.getmodule",
                     "inspect.currentframe", "inspect.stack", "pydoc.locate", "gymnasium.make", "gymnasium.make_vec",
                     "gc.get_objects", "gc.get_referrers", "unittest.mock"), PLAIN),
    **dict.fromkeys(("importlib", "builtins", "builtins.__builtins__"), "name the one function of it that is used"),
    **dict.fromkeys(("inspect.getsource", "inspect.getsourcelines", "inspect.getdoc", "inspect.getcomments"),
                    "keep text that is data in a constant"),
    **dict.fromkeys(("importlib.resources", "pkgutil.get_data", "inspect.getfile", "inspect.getsourcefile"), FILES)}
"""what is refused wherever it stands -> what to do instead"""
ROOTS = frozenset(name.partition(".")[0] for name in (*COMPUTED, *NEVER))
UNSEEN = {"__doc__": "docstrings do not count as code; keep text that is data in a constant",
          "__subclasses__": "list the classes in a tuple or a registry", "exec_module": PLAIN, "load_module": PLAIN}
"""attributes of any object that are refused -> what to do instead"""


def harmless(entry: str) -> bool:
    """Whether a call, 'package.function()', or a change of what it returned, 'package.function!', leaves all else as it was."""
    function, returned, _ = entry.partition("!")
    parts = function.removesuffix("()").split(".")
    if not (parts[0] in VALUES or ".".join(parts[:2]) in VALUES) or any(SETS.match(part) for part in parts[1:]):
        return False
    return "!()" not in entry and not KEPT.match(parts[-1]) if returned else entry.endswith("()")


def sets_state(entry: str) -> bool:
    """Whether what happens when a module is imported, 'package.object' or 'package.function()', sets a state of the process."""
    parts = entry.replace("!", "").removesuffix("()").split(".")
    return not entry.endswith("()") or any(STATE.fullmatch(part) for part in parts[1:])


def refusal(dotted: str, ours: Callable[[str], bool]) -> tuple[str, str] | None:
    """(what cannot be followed, what to do instead) for a name of a package that is not ours; None when there is no objection."""
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
    """`sys.modules["name"]` of a module that is not ours."""
    key = parts[count] if parts[:count] == ["sys", "modules"] and len(parts) > count else ""
    return key.startswith("[") and not ours(key[1:-1])
