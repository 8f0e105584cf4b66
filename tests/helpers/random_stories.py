"""Random events between the runs of a random graph: edits, damage, deletions, kills, forced runs, runs at once.

A `World` holds the code, one store that lives through all events, and the state that an edit changes. After every event, the
outputs of a run are compared with those of a build in an empty store. Each step runs in a process of its own, which imports the
present code. A `Story` is a graph and its events; it follows from a seed, and one that fails can be made smaller.
"""

from __future__ import annotations

import importlib
import inspect
import os
import random
import shutil
import signal
import sys
import tempfile
from collections import Counter
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

from runner import Runner
from tests.helpers.flipped_stores import NoEndError, apart
from tests.helpers.random_graphs import FORMS, MODULES, WORDS, Line, State, graph_of, write_code

KILL_EVENTS = ("open", "os.rename", "os.remove", "os.mkdir", "os.link", "os.chmod", "os.rmdir", "os.listdir")
"""operations on files before which a process can be killed"""
EVENTS = ("constant", "helper", "comment", "move", "parameter", "inputs", "undo", "flip", "cut", "delete", "clear", "collect",
          "drop", "check", "forced", "part", "kill", "at_once")  # fmt: skip
"""methods of World"""
LINES, HISTORY = (3, 14), (4, 9)
"""numbers of lines and of events of a story"""


@dataclass
class World:
    """Code, store and state of one random test."""

    folder: Path
    lines: tuple[Line, ...]
    state: State = field(default_factory=State)
    former: list[State] = field(default_factory=list)
    damaged: bool = False
    """files were deleted or spoilt since the last run that ended"""
    clean: dict[State, Any] = field(default_factory=dict)
    """outputs of builds in empty stores"""

    @property
    def code(self) -> Path:
        return self.folder / "code"

    @property
    def store(self) -> Path:
        return self.folder / "store"

    @property
    def log(self) -> Path:
        return self.folder / "log"

    def happen(self, event: str, number: int) -> None:
        """Let an event happen; `number` chooses what it concerns."""
        getattr(self, event)(number)

    # -- edits -----------------------------------------------------------------------------------------------------------

    def _become(self, **changes: Any) -> None:
        self.former.append(self.state)
        self.state = replace(self.state, **changes)
        write_code(self.code, self.state)

    def constant(self, number: int) -> None:
        """Change the constant of a stage."""
        self._become(marks=_stepped(self.state.marks, number))

    def helper(self, number: int) -> None:
        """Change the constant of the helper."""
        self._become(helper=number % 3)

    def comment(self, number: int) -> None:
        """Add or remove a comment."""
        self._become(comments=self.state.comments ^ {number % (len(MODULES) + 1)})

    def move(self, number: int) -> None:
        """Move a module to another folder, or back."""
        self._become(moved=self.state.moved ^ {number % (len(MODULES) + 1)})

    def parameter(self, number: int) -> None:
        """Change a parameter."""
        self._become(more=_stepped(self.state.more, number))

    def inputs(self, number: int) -> None:
        """Change the inputs."""
        self._become(words=number % len(WORDS))

    def undo(self, number: int) -> None:
        """Return to the former state."""
        if self.former:
            self.state = self.former.pop()
            write_code(self.code, self.state)

    # -- damage ----------------------------------------------------------------------------------------------------------

    def flip(self, number: int) -> None:
        """Flip a bit in a file of the store."""
        self._spoil(number, lambda data, at: data[:at] + bytes([data[at] ^ (1 << number % 8)]) + data[at + 1 :])

    def cut(self, number: int) -> None:
        """Cut a file of the store."""
        self._spoil(number, lambda data, at: data[:at])

    def delete(self, number: int) -> None:
        """Delete a few files of the store."""
        files = self._files()
        for path in random.Random(number).sample(files, min(len(files), 1 + number % 5)):
            path.unlink()
        self.damaged = True

    def clear(self, number: int) -> None:
        """Delete a whole folder of the store."""
        folders = sorted(path for path in self.store.iterdir() if path.is_dir())
        shutil.rmtree(folders[number % len(folders)])
        self.damaged = True

    def _spoil(self, number: int, how: Callable[[bytes, int], bytes]) -> None:
        """Change a file, and keep its time."""
        rng = random.Random(number)
        path = rng.choice([path for path in self._files() if path.stat().st_size])
        before, data = path.stat(), path.read_bytes()
        path.chmod(0o644)
        path.write_bytes(how(data, rng.randrange(len(data))))
        path.chmod(before.st_mode & 0o7777)
        os.utime(path, ns=(before.st_atime_ns, before.st_mtime_ns))
        self.damaged = True

    def _files(self) -> list[Path]:
        """Files of the store, in an order that does not depend on random names where sizes differ."""
        found = [path for path in self.store.rglob("*") if path.is_file()]
        return sorted(found, key=lambda path: (path.relative_to(self.store).parts[0], path.stat().st_size, path.as_posix()))

    # -- verbs and runs --------------------------------------------------------------------------------------------------

    def collect(self, number: int) -> None:
        """Collect garbage."""
        apart(self._collect, number)

    def drop(self, number: int) -> None:
        """Collect garbage, and drop the outputs of a stage; where `gc` cannot drop, collect only."""
        apart(self._collect, number, drop=True)

    def check(self, number: int) -> None:
        """Verify the store; damaged files are moved aside."""
        apart(self._verify)

    def forced(self, number: int) -> None:
        """Run with a stage forced."""
        apart(self._run, force=number)

    def part(self, number: int) -> None:
        """Run another target, or one shard."""
        apart(self._run, target="one" if number % 2 else "all", shard=number % 3 == 0)

    def kill(self, number: int) -> None:
        """Kill a run with much to do before one of its operations on files; what it had finished does not run again."""
        self._renew()
        jobs = 2 if number % 7 == 0 else 0
        try:
            apart(self._run, die_at=number % 200, jobs=jobs)
        except NoEndError as error:
            if "ended with -9" not in str(error):
                raise
        before = self._logged()
        apart(self._run)
        again = before + self._logged() - self._clean()["log"]
        assert self.damaged or sum(again.values()) <= max(jobs, 1), f"finished tasks ran again after a kill: {again}"

    def at_once(self, number: int) -> None:
        """Run twice at the same time, with much to do; every task runs once."""
        self._renew()
        with ThreadPoolExecutor(2) as threads:
            reports = list(threads.map(lambda _: apart(self._run), range(2)))
        twice = self._logged() - self._clean()["log"]
        assert reports[0]["failed"] == reports[1]["failed"], f"failures of runs at once: {reports}"
        assert self.damaged or not twice, f"executed by both of two runs at once: {twice}"

    def _renew(self) -> None:
        """Change all constants, so that every task has to run, and clear the log."""
        self._become(marks=(3 + len(self.clean),) * len(MODULES))
        self._logged()

    def _logged(self) -> Counter[str]:
        """Return the log of executions but for those that may fail, and clear it."""
        found = self.log.read_text().split("\n")[:-1] if self.log.exists() else []
        self.log.unlink(missing_ok=True)
        return Counter(line for line in found if not line.startswith("picky"))

    # -- the law ---------------------------------------------------------------------------------------------------------

    def settle(self) -> None:
        """Run, compare with a clean build, and run again; AssertionError where the law does not hold."""
        found = apart(self._run)
        expected = self._clean()
        for name in ("failed", "values", "outputs"):
            assert found[name] == expected[name], f"{name} {found[name]}; of a clean build: {expected[name]}"
        self._logged()
        again = apart(self._run)
        executed = self._logged()
        assert not again["ran"] and not executed, f"a second run executes {again['ran']}: {executed}"
        assert again["values"] == expected["values"], "a second run has other values"
        self.damaged = False

    def _clean(self) -> Any:
        """Result of a run of the present state in an empty store."""
        if self.state not in self.clean:
            fresh = self.folder / "fresh"
            self._logged()
            self.clean[self.state] = apart(self._run, store=fresh) | {"log": self._logged()}
            shutil.rmtree(fresh)
        return self.clean[self.state]

    # -- steps, each in a process of its own -----------------------------------------------------------------------------

    def _runner(self, store: Path | None = None, jobs: int = 0) -> Runner:
        sys.dont_write_bytecode = True
        os.environ |= {"TOY_LOG": str(self.log), "PYTHONDONTWRITEBYTECODE": "1"}
        sys.path.insert(0, str(self.code))
        importlib.invalidate_caches()
        for name in [name for name in sys.modules if name.partition(".")[0] == "toy"]:
            del sys.modules[name]
        return Runner(store or self.store, self.code, "toy.values:CODEC", None, jobs=jobs)

    def _run(self, *, store: Path | None = None, jobs: int = 0, target: str = "all", force: int | None = None, shard: bool = False,
             die_at: int | None = None) -> dict[str, Any]:  # fmt: skip
        runner = self._runner(store, jobs)
        graph = graph_of(self.lines, self.state)
        if die_at is not None:
            die_before(die_at, str(self.store))
        names = [node.name for node in graph.stages()]
        more = {} if force is None else {"force": [names[force % len(names)]]}
        report = runner.run(graph, target, shards=["w0"] if shard and WORDS[self.state.words] else None, **more)
        values = {name: [repr(runner.load(digest)) for _, digest in made] for name, made in report.outputs.items()}
        failed = sorted((one.stage, one.shard, one.message) for one in report.failures)
        return {"ran": dict(report.ran), "failed": failed, "outputs": report.outputs, "values": values}

    def _collect(self, number: int, drop: bool = False) -> None:
        runner = self._runner()
        stages = [node.name for node in graph_of(self.lines, self.state).stages()]
        can_drop = "drop" in inspect.signature(runner.gc).parameters
        runner.gc(**({"drop": [stages[number % len(stages)]]} if drop and can_drop else {}))

    def _verify(self) -> None:
        self._runner().verify()


def _stepped(values: tuple[int, ...], number: int) -> tuple[int, ...]:
    """Increment one of the values, modulo 3."""
    at = number % len(values)
    return tuple((value + 1) % 3 if i == at else value for i, value in enumerate(values))


def die_before(count: int, folder: str) -> None:
    """Kill this process before one of its next operations on files in a folder."""
    left = [count]

    def hook(event: str, args: tuple[Any, ...]) -> None:
        if event in KILL_EVENTS and args and str(args[0]).startswith(folder):
            left[0] -= 1
            if left[0] < 0:
                os.kill(os.getpid(), signal.SIGKILL)

    sys.addaudithook(hook)


@dataclass(frozen=True)
class Story:
    """A graph, and events between its runs."""

    lines: tuple[Line, ...]
    events: tuple[tuple[str, int], ...]

    @classmethod
    def of(cls, seed: int) -> Story:
        """Draw a story."""
        rng = random.Random(seed)
        forms = [rng.choice(FORMS) for _ in range(rng.randint(*LINES))]
        forms[:0] = rng.choice(([], ["split", "each"], ["pair", "pick"], ["split", "each", "collect", "join"]))
        lines = tuple(Line(form, rng.randrange(3), rng.randrange(1000)) for form in forms)
        return cls(lines, tuple((rng.choice(EVENTS), rng.randrange(1000)) for _ in range(rng.randint(*HISTORY))))

    def fault(self) -> str:
        """Live the story in a folder of its own; '' where the law holds after every event."""
        at = "the first run"
        with tempfile.TemporaryDirectory() as name:
            world = World(Path(name), self.lines)
            write_code(world.code, world.state)
            try:
                world.settle()
                for event, number in self.events:
                    at = f"{event} {number}"
                    world.happen(event, number)
                    world.settle()
            except (AssertionError, NoEndError, RuntimeError) as error:
                return f"after {at}: {error}"
        return ""

    def smaller(self) -> Story:
        """Leave out events and lines while the story still fails."""
        story = self
        for event in reversed(self.events):
            fewer = replace(story, events=tuple(one for one in story.events if one is not event))
            story = fewer if fewer.fault() else story
        for line in reversed(self.lines):
            fewer = replace(story, lines=tuple(one for one in story.lines if one is not line))
            story = fewer if fewer.fault() else story
        return story
