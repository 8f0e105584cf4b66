"""Rules of plain English that a program can check, in Python sources and Markdown pages."""

from __future__ import annotations

import ast
import io
import re
import tokenize
from collections.abc import Iterator
from pathlib import Path
from typing import NamedTuple

from tests.helpers.statements import statements

CLAUSE = frozenset(re.findall(r"\S+", """
    what how whether where of all everything whoever whose when which who why as so not nothing nobody that if here there again
    once twice only never always none from to with without by at on in for and or but than like about between before after while
    since until they it one's also even still"""))
"""first words of a clause or a prepositional phrase; a docstring and a test name begin with a verb or a noun phrase"""
QUESTION = frozenset(("what", "how", "whether", "where", "whose", "when", "who", "why", "again", "nothing", "nobody", "never"))
"""first words that no heading has"""
PERSON = re.compile(r"\b(nobody|whoever|somebody|someone|anybody|told|said|tells)\b", re.I)
"""persons, and what only persons do"""
NEGATED = re.compile(r"\b(?:that|which|one that) (?:is|are|was|were) none\b")
UNIDIOMATIC = re.compile(r"\banew\b|\bgo(?:es)? on at will\b|\bagain to go on\b|\bwhat stands out\b", re.I)
PHRASES = ((PERSON, "a person for a program"), (NEGATED, "a negated noun"), (UNIDIOMATIC, "not idiomatic English"))
TEST_WORDS = re.compile(r"(?:^|_)(nobody|whoever|somebody|told|said|anew|is_none|none_is)(?:_|$)")
COMMIT = re.compile(r"[a-z0-9_.-]+: [^A-Z\s].*")
SUBJECT_CHARACTERS = 72
GENERATED = re.compile(r"<!-- ([\w -]+): written by .*?<!-- (?:end of |/)\1 -->", re.S)
"""a block that a script writes out of a report"""


class Fault(NamedTuple):
    """A place that breaks a rule."""

    line: int
    reason: str


def in_python(text: str) -> list[Fault]:
    """Faults of docstrings, comments, strings and test names in a source file."""
    faults = [fault for node in statements(ast.parse(text)) for fault in _of_definition(node)]
    if any(pattern.search(text) for pattern, _ in PHRASES):
        for token in tokenize.generate_tokens(io.StringIO(text).readline):
            if token.type in (tokenize.COMMENT, tokenize.STRING):
                faults += _of_phrases(token.string, token.start[0])
    return sorted(faults)


def in_markdown(text: str) -> list[Fault]:
    """Faults of text and headings outside code and outside the blocks that scripts write."""
    plain = GENERATED.sub(lambda block: "\n" * block.group().count("\n"), text)
    plain = re.sub(r"^```.*?^```", lambda block: "\n" * block.group().count("\n"), plain, flags=re.S | re.M)
    faults = list(_of_phrases(plain, 1))
    for number, line in enumerate(plain.splitlines(), 1):
        first = re.match(r"#+ (?:\d+\.? )?([\w']+)", line)
        if first and first.group(1).lower() in QUESTION:
            faults.append(Fault(number, f"the heading begins with {first.group(1)!r}"))
    return sorted(faults)


def in_commit(subject: str) -> list[str]:
    """Faults of the first line of a commit message."""
    form = [] if COMMIT.fullmatch(subject) else ["the form is `area: imperative`"]
    return form + ([] if len(subject) <= SUBJECT_CHARACTERS else [f"{len(subject)} characters, {SUBJECT_CHARACTERS} at most"])


def in_file(path: Path) -> list[Fault]:
    """Faults of a source file or a page."""
    text = path.read_text(encoding="utf-8")
    return in_python(text) if path.suffix == ".py" else in_markdown(text)


def _of_definition(node: ast.AST) -> Iterator[Fault]:
    if not isinstance(node, ast.Module | ast.ClassDef | ast.FunctionDef | ast.AsyncFunctionDef):
        return
    line = getattr(node, "lineno", 1)
    first = re.match(r"[\w'-]+", ast.get_docstring(node) or "")
    if first and first.group().lower() in CLAUSE:
        yield Fault(line, f"the docstring begins with {first.group()!r}")
    name = getattr(node, "name", "")
    if isinstance(node, ast.FunctionDef) and name.startswith("test_"):
        words = name.removeprefix("test_")
        if words.split("_")[0] in CLAUSE or TEST_WORDS.search(words):
            yield Fault(line, f"the test name {name} does not name the thing tested")


def _of_phrases(text: str, line: int) -> Iterator[Fault]:
    for pattern, reason in PHRASES:
        for found in pattern.finditer(text):
            yield Fault(line + text.count("\n", 0, found.start()), f"{reason}: {found.group()!r}")
