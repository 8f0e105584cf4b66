"""Random small graphs of toy stages, and their code, of which every part can change."""

from __future__ import annotations

import importlib
import shutil
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from runner import Graph, GraphError

TOY = Path(__file__).parents[1].joinpath("toy_domain") / "toy"
WORDS = (("ab", "cd"), ("ab", "cd", "ef"), ("ab", "xd"), ("cd",), ())
MODULES = ("tag", "last", "mix", "split", "pair", "join", "picky")
FORMS = (*MODULES, "each", "collect", "partial", "pick", "gather", "list")
HELPER = '''"""Helper of several stages."""

from __future__ import annotations

{comment}MARK = "{mark}"


def marked(text: str) -> str:
    return text + MARK
'''
STAGE = '''"""Toy stage."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from {helper} import marked
from toy.log import note
from toy.values import Pair, Word

MARK = "{mark}"


@dataclass(frozen=True)
class Params:
    more: int = 0


{comment}
'''
BODIES = {
    "tag": '''def run(word: Word, params: Params) -> Word:
    note("tag", f"{word.text} {params.more} {MARK}")
    return Word(word.name, marked(word.text) + MARK + "+" * params.more)
''',
    "last": '''def run(word: Word) -> Word:
    note("last", f"{word.text} {MARK}")
    return Word("last", word.text[:1] + MARK)
''',
    "mix": '''def run(left: Word, right: Word) -> Word:
    note("mix", f"{left.text} {right.text} {MARK}")
    return Word(left.name, left.text[:2] + MARK + right.text[-2:])
''',
    "split": '''def run(word: Word, params: Params) -> tuple[Word, ...]:
    note("split", f"{word.text} {params.more} {MARK}")
    return tuple(Word(f"p{i}", word.text[i % 2 :] + MARK * i) for i in range(2 - params.more))
''',
    "pair": '''def run(word: Word) -> Pair:
    note("pair", f"{word.text} {MARK}")
    return Pair(Word(word.name, word.text[:1]), Word(word.name, word.text[1:] + MARK))
''',
    "join": '''def run(words: tuple[Word, ...], ctx: Any) -> Word:
    note("join", " ".join(word.text for word in words) + f" {MARK}")
    (ctx.scratch / "draft").write_text("draft")
    return Word("all", "-".join(word.text for word in words) + MARK)
''',
    "picky": '''def run(word: Word) -> Word:
    note("picky", f"{word.text} {MARK}")
    if "x" in word.text:
        raise ValueError("x is refused")
    return Word(word.name, marked(word.text))
'''}  # fmt: skip
"""module -> its function; `note` logs each execution"""


@dataclass(frozen=True)
class State:
    """Parts of a world that an edit changes."""

    marks: tuple[int, ...] = (0,) * len(MODULES)
    """constant of each module"""
    more: tuple[int, ...] = (0,) * 3
    """parameters of the lines that have some, in turns"""
    helper: int = 0
    words: int = 0
    comments: frozenset[int] = frozenset()
    moved: frozenset[int] = frozenset()
    """modules in another folder; the number behind the last one is the helper's"""


@dataclass(frozen=True)
class Line:
    """A line of a graph: its form, and numbers that choose its inputs and its variant."""

    form: str
    first: int
    second: int


def module_name(i: int, state: State) -> str:
    """Module of the stage with this number, or of the helper."""
    name = MODULES[i] if i < len(MODULES) else "shared"
    return f"toy.deep.of_{name}" if i in state.moved else f"toy.{name}_stage"


def write_code(root: Path, state: State) -> None:
    """Write the code of a state; a file whose text stays is not touched."""
    if not root.exists():
        shutil.copytree(TOY, root / "toy", ignore=shutil.ignore_patterns("__pycache__"))
        (root / "toy" / "deep").mkdir()
    wanted = {root / f"{module_name(i, state).replace('.', '/')}.py": _text(i, state) for i in range(len(MODULES) + 1)}
    for path in (*root.rglob("*_stage.py"), *root.rglob("of_*.py")):
        if path not in wanted:
            path.unlink()
    for path, text in wanted.items():
        if not path.exists() or path.read_text() != text:
            path.write_text(text)


def _text(i: int, state: State) -> str:
    comment = "# a comment\n" if i in state.comments else ""
    if i == len(MODULES):
        return HELPER.format(mark=f"h{state.helper}", comment=comment)
    head = STAGE.format(mark=f"{MODULES[i][0]}{state.marks[i]}", comment=comment, helper=module_name(len(MODULES), state))
    return head + BODIES[MODULES[i]]


def graph_of(lines: tuple[Line, ...], state: State) -> Graph:
    """Build a graph of the present code; a line that does not fit is left out. Its targets are `all` and `one`."""
    word = importlib.import_module("toy.values").Word
    build = _Build({name: importlib.import_module(module_name(i, state)) for i, name in enumerate(MODULES)}, state)
    leaf = build.g.leaf("words", tuple(word(f"w{i}", text) for i, text in enumerate(WORDS[state.words])))
    build.pools = {"word": [build.g.each(leaf)], "list": [leaf], "pair": []}
    made = [handle for i, line in enumerate(lines) for handle in build.added(i, line)]
    if not made:
        made = [build.g.named("only").add(build.modules["last"].run, word=build.pools["word"][0])]
    build.g.target("all", *made[-3:])
    build.g.target("one", made[len(made) // 2])
    return build.g


class _Build:
    """A graph while it is built, with the handles so far by kind of value."""

    def __init__(self, modules: dict[str, Any], state: State) -> None:
        self.g, self.modules, self.state = Graph(), modules, state
        self.pools: dict[str, list[Any]] = {}

    def added(self, i: int, line: Line) -> list[Any]:
        """Add a line; its handle, if it may be a target of a run."""
        try:
            kind, handle = self._call(line.form)(i, line)
        except (GraphError, LookupError):
            return []
        self.pools[kind].append(handle)
        return [handle] if line.form in MODULES or line.form in ("pick", "gather") else []

    def _call(self, form: str) -> Callable[[int, Line], tuple[str, Any]]:
        return getattr(self, f"_{form}", self._stage)  # type: ignore[no-any-return]

    def _chosen(self, kind: str, number: int) -> Any:
        """Return one of the newest handles of a kind; LookupError when there are none."""
        pool = self.pools[kind]
        return pool[-1 - number % len(pool)] if pool else pool[0]

    def _each(self, i: int, line: Line) -> tuple[str, Any]:
        return "word", self.g.each(self._chosen("list", line.first))

    def _collect(self, i: int, line: Line) -> tuple[str, Any]:
        return "list", self.g.collect(self._chosen("word", line.first))

    def _partial(self, i: int, line: Line) -> tuple[str, Any]:
        return "list", self.g.collect(self._chosen("word", line.first), partial=True)

    def _list(self, i: int, line: Line) -> tuple[str, Any]:
        return "list", self.g.finished(f"list{i}", (self._chosen("word", line.first), self._chosen("word", line.second)))

    def _pick(self, i: int, line: Line) -> tuple[str, Any]:
        field = "left" if line.second % 2 else "right"
        return "word", self.g.pick(self._chosen("pair", line.first), lambda pair: getattr(pair, field))

    def _gather(self, i: int, line: Line) -> tuple[str, Any]:
        words = self._chosen("word", line.first), self._chosen("word", line.second)
        return "word", self.g.named(f"gather{i}").add(self.modules["join"].run, words=words)

    def _mix(self, i: int, line: Line) -> tuple[str, Any]:
        left, right = self._chosen("word", line.first), self._chosen("word", line.second)
        return "word", self.g.named(f"mix{i}").add(self.modules["mix"].run, left=left, right=right)

    def _join(self, i: int, line: Line) -> tuple[str, Any]:
        return "word", self.g.named(f"join{i}").add(self.modules["join"].run, words=self._chosen("list", line.first))

    def _stage(self, i: int, line: Line) -> tuple[str, Any]:
        """Add a stage that takes one word."""
        module = self.modules[line.form]
        params = module.Params(self.state.more[line.second % len(self.state.more)])
        more = {"params": params} if line.form in ("tag", "split") else {}
        made = self.g.named(f"{line.form}{i}").add(module.run, word=self._chosen("word", line.first), **more)
        return {"split": "list", "pair": "pair"}.get(line.form, "word"), made
