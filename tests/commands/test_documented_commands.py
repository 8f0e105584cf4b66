"""Commands in README, CONTRIBUTING and docs: each is run where that is cheap, else parsed by the program that it calls.

Commands are the lines of fenced shell blocks, lines that begin with `$ `, and inline code that begins with a program of the
project. Inline code may mention a command without its arguments.
`make TARGET` runs as `make -n`, and the recipes that it prints are checked as well. Read-only verbs run on a small finished store.
`run` and similar verbs are parsed by the real parser, and the graph of their target is built with their settings. The tests marked
slow also plan every documented `run` with `--dry-run`.
"""

from __future__ import annotations

import importlib.util
import os
import re
import shlex
import subprocess
from collections.abc import Iterator, Sequence
from functools import cache
from pathlib import Path
from typing import Any, NamedTuple

import pytest
import typer

from commands.cli import app
from commands.errors import UsageError
from commands.settings import columns
from commands.target_graphs import graph_of_request, names_in_graph, resolve_stages, resolve_target
from pipeline import TARGETS
from tests.helpers.command import Made, call

ROOT = Path(__file__).resolve().parents[2]
PAGES = [ROOT / "README.md", ROOT / "CONTRIBUTING.md", *sorted((ROOT / "docs").rglob("*.md"))]
SHELLS = ("sh", "bash", "shell", "console")
FROM_MAKE = ("MAKEFLAGS", "MAKEOVERRIDES", "MFLAGS", "MAKELEVEL", "ARGS")
"""variables that `make test ARGS=...` passes to the tests"""
INLINE = re.compile(r"`((?:make|python|afford|pip|pipeline\.py) [^`]+)`")
ALIASES = (("afford",), ("pipeline.py",), ("python", "pipeline.py"), (".venv/bin/python", "pipeline.py"),
           ("python", "-m", "pipeline"))
PLACEHOLDERS = {"TARGET": "dataset", "STAGE": "mask_densify", "FORMAT": "coco"}
"""words of inline code that stand for a name"""
EXCEPTIONS = {
    "pip install --editable .": "installs packages; tests/commands/test_install.py builds the wheel",
    "pip check": "tests the environment, not the project",
    "make constraints": "needs the package index",
    "python pipeline.py run benchmark --set benchmark.predictions=LISA,VRB": "reads the folders of two other methods",
    "python pipeline.py run grasp --set human_motion.prior=artifacts/models/motion-prior": "reads what the line above it publishes",
    "python pipeline.py run grasp --set rl_grasp_refinement.engine=warp --set rl_grasp_refinement.device=cuda": "needs an extra",
}
"""commands that are neither run nor parsed -> reason"""
OTHER_PROGRAMS = {"aria2c": "downloads data sets", "export": "sets a variable of the shell", "cd": "changes the folder",
                  "mkdir": "creates a folder"}  # fmt: skip
"""programs outside the project, which are not checked -> their purpose"""
GRAPH_VERBS = ("run", "status", "explain", "graph", "stale")
"""verbs whose targets, stages and settings are resolved"""
READ_ONLY = ("check", "inspect", "lineage", "verify", "gc", "params", "fetch-list", "export", "runs", "du")
"""verbs that run on the small store"""


class Command(NamedTuple):
    """A command and its place: 'README.md:12'."""

    where: str
    words: tuple[str, ...]
    inline: bool = False


def commands_of(page: Path, text: str) -> Iterator[Command]:
    """Commands of a Markdown page, one for each part of a pipe or of `&&`."""
    fence: str | None = None
    line, start = "", 0
    for number, raw in enumerate(text.split("\n"), 1):
        opened = re.match(r"\s*```(\w*)", raw)
        if opened:
            fence, line = (opened[1], "") if fence is None else (None, "")
            continue
        if fence is None:
            for code in INLINE.findall(raw):
                yield from _split(f"{_name(page)}:{number}", code, inline=True)
            continue
        start = start if line else number
        line += raw.strip().removesuffix("\\")
        if raw.rstrip().endswith("\\"):
            continue
        is_command = fence in SHELLS or line.startswith("$ ") or re.match(r"(make|afford|pip|python) ", line)
        yield from _split(f"{_name(page)}:{start}", line.removeprefix("$ ")) if is_command else ()
        line = ""


def _name(page: Path) -> str:
    return page.relative_to(ROOT).as_posix() if page.is_absolute() else page.name


def _split(where: str, line: str, inline: bool = False) -> Iterator[Command]:
    words: list[str] = []
    for word in [*shlex.split(line, comments=True), "&&"]:
        if word in ("&&", "|", ";", ">", ">>"):
            if words:
                yield Command(where, tuple(PLACEHOLDERS.get(one, one) for one in words), inline)
            words = []
            if word in (">", ">>"):  # the rest is the name of a file
                return
        else:
            words.append(word)


@cache
def documented() -> tuple[Command, ...]:
    """Commands of all pages, each once."""
    found: dict[tuple[str, ...], Command] = {}
    for page in PAGES:
        for command in commands_of(page, page.read_text(encoding="utf-8")):
            if command.words not in found or found[command.words].inline:
                found[command.words] = command
    return tuple(found.values())


# -- checks ------------------------------------------------------------------------------------------------------------


def fault(words: Sequence[str], inline: bool = False) -> str:
    """Reason why a command cannot work, '' if there is none."""
    if " ".join(words) in EXCEPTIONS or words[0] in OTHER_PROGRAMS:
        return ""
    if words[0] == "make":
        return _fault_of_make(words)
    if tuple(words) in ((".", ".venv/bin/activate"), ("source", ".venv/bin/activate")):
        return "" if "VENV   := .venv\n" in (ROOT / "Makefile").read_text() else "the Makefile creates another environment"
    rest = next((words[len(alias):] for alias in ALIASES if tuple(words[: len(alias)]) == alias), None)
    if rest is not None:
        return _fault_of_pipeline(rest, inline)
    return _fault_of_python(words) if words[0] in ("python", "python3") else f"unknown program {words[0]!r}"


def _fault_of_make(words: Sequence[str]) -> str:
    """Run `make -n`, and check the recipes that it prints."""
    known = set(re.findall(r"^(\w+)\s*[?:]?=", (ROOT / "Makefile").read_text(), re.MULTILINE))
    unknown = [word for word in words[1:] if "=" in word and word.partition("=")[0] not in known]
    if unknown:
        return f"the Makefile reads no {unknown[0].partition('=')[0]}"
    ready = [f"-o.venv/.ready{extra}" for extra in ("", "-film", "-gpu", "-ray", "-dev")]
    environment = {name: value for name, value in os.environ.items() if name not in FROM_MAKE}
    done = subprocess.run(["make", "-n", *ready, *words[1:]], cwd=ROOT, env=environment, capture_output=True, text=True)
    if done.returncode:
        return done.stderr.strip().splitlines()[-1]
    recipes = [line for line in done.stdout.splitlines() if line.startswith(".venv/bin/python pipeline")]
    return next(filter(None, (fault(shlex.split(line)) for line in recipes)), "")


def _fault_of_python(words: Sequence[str]) -> str:
    if words[1] == "-m":
        found = importlib.util.find_spec(words[2])
        return "" if found and found.origin and "__main__" in Path(found.origin).read_text() else f"{words[2]} is not a program"
    return "" if (ROOT / words[1]).is_file() else f"no file {words[1]}"


@cache
def _cli() -> Any:
    return typer.main.get_command(app)


def parsed(words: Sequence[str]) -> dict[str, Any]:
    """Arguments of a verb, by the real parser; the parser's error for a wrong call."""
    verb = _cli().commands.get(words[0])
    if verb is None:
        raise UsageError(f"no verb {words[0]!r}")
    return dict(verb.make_context(words[0], list(words[1:])).params)


def _fault_of_pipeline(words: Sequence[str], inline: bool) -> str:
    if not words or words[0].startswith("-") or words[-1] == "--help" or words[0].isupper():
        return ""
    try:
        given = parsed(words)
        if words[0] in GRAPH_VERBS:
            _resolve(words[0], given)
        elif words[0] in ("params", "backends") and call(*words[:2]).code:
            return call(*words[:2]).words
    except UsageError as error:
        return str(error)
    except Exception as error:  # of the parser, which typer brings with it
        if not hasattr(error, "format_message"):
            raise
        incomplete = type(error).__name__ in ("MissingParameter", "BadOptionUsage")
        return "" if inline and incomplete else str(error.format_message())
    return ""


def _resolve(verb: str, given: dict[str, Any]) -> None:
    """Resolve target, settings and stages. UsageError when one does not exist, or the target does not use a setting."""
    word, sets = given.get("target"), given.get("set_") or []
    only = given.get("only") or given.get("stage")
    if verb == "status" and word and word.replace("_", "-") not in TARGETS:
        word, only = None, word
    target, chosen = resolve_target(word, only), columns(sets, None)
    used = [] if given.get("source") else sets  # a source changes the graph, and needs its files
    graph, names, _, _ = graph_of_request(target, None, (), used, chosen, lambda path: "")
    for stage in ([only] if only else []) + list(given.get("force") or []):
        resolve_stages([stage], target, graph)
        assert names or names_in_graph(stage, graph)


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.relative_to(ROOT).as_posix())
def test_documented_commands_are_valid(page: Path) -> None:
    """Each command of the page, with its line."""
    own = [one for one in documented() if one.where.rpartition(":")[0] == _name(page)]
    faults = {f"{one.where}: {' '.join(one.words)}": fault(one.words, one.inline) for one in own}
    assert {where: reason for where, reason in faults.items() if reason} == {}


def test_the_pages_hold_commands_of_every_kind() -> None:
    """Otherwise the collection finds too little."""
    firsts = {one.words[:3] for one in documented()}
    assert {("make", "dataset"), ("python", "pipeline.py", "verify"), (".", ".venv/bin/activate")} <= firsts
    assert len(documented()) > 60 and not EXCEPTIONS.keys() - {" ".join(one.words) for one in documented()}


@pytest.mark.parametrize(("line", "reason"), [
    ("make datasett", "No rule to make target 'datasett'"),
    ("make dataset SOURC=DIR", "the Makefile reads no SOURC"),
    ("make ablation ARGS='--minuts 60'", "--minuts"),
    ("python pipeline.py rum dataset", "no verb 'rum'"),
    ("python pipeline.py run datset", "did you mean 'dataset'"),
    ("python pipeline.py run dataset --sett x.y=1", "--sett"),
    ("python pipeline.py run dataset --set mask_densify.radus=1", "did you mean 'radius'"),
    ("python pipeline.py run dataset --set model_train.steps=1", "dataset does not use model_train"),
    ("python pipeline.py run dataset --only model_train", "it belongs to train"),
    ("afford explain mask_densfy", "did you mean 'mask_densify'"),
    ("python benchmarks/bench_nothing.py", "no file benchmarks/bench_nothing.py"),
    ("python -m afford.nothing", "afford.nothing is not a program"),
    ("pipline.py run", "unknown program 'pipline.py'"),
])  # fmt: skip
def test_a_planted_fault_in_a_page_is_found(line: str, reason: str) -> None:
    """The fault is in a block, in a line with a prompt, or, for programs of the project, inline."""
    texts = [f"```sh\n{line}\n```", f"```\n$ {line}   # comment\n```", f"Run `{line}`."]
    for text in texts if INLINE.match(f"`{line}`") else texts[:2]:
        faults = [fault(one.words, one.inline) for one in commands_of(Path("page.md"), text)]
        assert len(faults) == 1 and reason in faults[0], text


def test_commands_are_split_and_joined() -> None:
    """Pipes, redirections and `&&` split; a backslash joins lines."""
    text = "```sh\na --x 1 \\\n  --y 2 > out.txt  # comment\nb | c && d\n```\n```python\npython x\n```\n"
    assert [one.words for one in commands_of(Path("page.md"), text)] == [
        ("a", "--x", "1", "--y", "2"), ("b",), ("c",), ("d",), ("python", "x")]


# -- runs --------------------------------------------------------------------------------------------------------------


def test_documented_read_only_commands_run(made: Made, tmp_path: Path) -> None:
    """The exit code is 0 on a small finished store in place of the user's."""
    recordings = made.store / "recordings" / made.source.name
    one, other = sorted(recordings.glob("P*.mcap"))[:2]
    names = {"DIR": made.source, "EPIC-KITCHENS": made.source, "my-video": made.source, "artifacts/recordings": recordings.parent,
             "...": one, "artifacts/recordings/<source>/<clip>.mcap": one, "A.mcap": one, "B.mcap": other, "OUT": tmp_path / "out",
             "artifacts/datasets/synthetic": made.store / "datasets" / made.source.name, "54988922675c": "mask_densify"}
    ran = set()
    mine = made.copy(tmp_path / "mine")
    assert all(mine.run("dataset", "--force", "sample_assemble").code == 0 for _ in range(2))  # two runs to compare and to draw
    for command in documented():
        words = next((command.words[len(alias):] for alias in ALIASES if command.words[: len(alias)] == alias), ())
        if not words or words[0] not in READ_ONLY or command.inline or "--rerun" in words:
            continue
        given = [names.get(word, recordings if word.startswith("artifacts/recordings/") else word) for word in words]
        given = [tmp_path / word if isinstance(word, str) and re.search(r"\.(png|svg|rrd|json)$", word) else word for word in given]
        if words[0] == "inspect" and given[1] == "mask_densify":
            given[1] = made.ask("lineage", "mask_densify", "--json", source=False).json["digest"][:12]
        if words[0] == "export":
            given[2] = tmp_path / f"out-{len(ran)}"
        needs_store = words[0] in ("inspect", "lineage", "verify", "gc", "export", "runs", "du")
        store = mine.store if words[0] in ("runs", "gc") else made.store
        source = ["--source", made.source] if words[0] == "export" else []
        done = call(*given, *source, *(["--store", store] if needs_store else []))
        differs = words[0] == "inspect" and "--diff" in words
        assert done.code == int(differs), f"{command.where}: {' '.join(map(str, given))}: {done.words}"
        ran.add(words[0])
    assert ran == set(READ_ONLY)


@pytest.mark.slow
def test_documented_runs_can_be_planned(tmp_path: Path) -> None:
    """Commands without a source are planned with `--dry-run` on an empty store."""
    for command in documented():
        words = next((command.words[len(alias):] for alias in ALIASES if command.words[: len(alias)] == alias), ())
        needs_files = "--source" in words or any("=DIR" in word for word in words) or " ".join(command.words) in EXCEPTIONS
        if words[:1] == ("run",) and not needs_files:
            done = call(*(word for word in words if word != "--dry-run"), "--dry-run", "--store", tmp_path / "store")
            assert done.code == 0, f"{command.where}: {' '.join(words)}: {done.words}"
