"""Outputs that are made of less than there is do not take the place of whole ones: they get a name of their own, `<name>-part`.

A data set, a model or a report is a part when its run was limited to some clips, when something failed that it is made from, or, of
data sets, when the one that has the name was made of more videos or has more splits. A table that a run with a limit has not
finished is a part when the one that has the name has figures that it lacks. `--replace` gives a part the name of the whole.
"""

from __future__ import annotations

import json
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from commands.publish import FILES, publish, publish_file, shown, shows_file
from runner import Graph, Runner, RunReport

PART = "-part"
STATISTICS, METRICS = "statistics.json", "metrics.json"
RECORDS = "record_"
"""what the name of a stage begins with that records another one"""


@dataclass
class Publisher:
    """Publishes the outputs of one run; `why` says of which stages they are parts, `notes` what became of these."""

    runner: Runner
    why: dict[str, str] = field(default_factory=dict)
    replace: bool = False
    unfinished: bool = False
    notes: list[str] = field(default_factory=list)

    def folder(self, stage: str, digest: str, folder: Path) -> str:
        """Publish a folder, under the name of a part if it is one; its path. Errors as `publish`."""
        if self.replace or shown(self.runner, digest, folder):
            return str(publish(self.runner, digest, folder))
        why = self.why.get(stage) or self._smaller(digest, folder)
        if why:
            self.why[stage] = why
            self._note(folder.with_name(folder.name + PART), folder, why)
        return str(publish(self.runner, digest, folder.with_name(folder.name + PART) if why else folder))

    def file(self, stage: str, digest: str, path: Path) -> str:
        """The same of a recording, which is a part where what it shows is one."""
        why = self.why.get(stage) or self.why.get(stage.removeprefix(RECORDS))
        whole = self.replace or not why or shows_file(self.runner, digest, path)
        return str(publish_file(self.runner, digest, path if whole else path.with_stem(path.stem + PART)))

    def together(self, stages: Iterable[str], folder: Path) -> Path:
        """The folder for outputs that stand side by side; that of a part where one of them is a part."""
        why = "" if self.replace else next((self.why[stage] for stage in stages if stage in self.why), "")
        if why:
            self._note(folder.with_name(folder.name + PART), folder, why)
        return folder.with_name(folder.name + PART) if why else folder

    def _note(self, part: Path, whole: Path, why: str) -> None:
        stays = f"{whole} is left as it is, --replace puts the part there" if whole.exists() else f"--replace names it {whole.name}"
        self.notes.append(f"{part.name} is a part: {why}; {stays}")

    def _smaller(self, digest: str, folder: Path) -> str:
        """What the published folder has more of, in words; '' for nothing."""
        files = self.runner.files(digest)
        new, old = (_object(path) for path in (files.get(FILES + STATISTICS), folder / STATISTICS))
        for what, count in (("video(s)", _videos), ("split(s)", _splits)):
            if new and count(new) < count(old):
                return f"it has {count(new)} {what}, {folder.name} has {count(old)}"
        lacking = _object(folder / METRICS).keys() - _object(files.get(FILES + METRICS)).keys() if self.unfinished else ()
        return f"it is not finished and has {len(lacking)} figure(s) less than {folder.name}" if lacking else ""


def parts(graph: Graph, report: RunReport, clips: tuple[str, ...], refused: int) -> dict[str, str]:
    """Stage of the target -> why what it made is a part, for those of which it is true. `refused`: videos that the source has and
    that could not be read.
    """
    out: dict[str, str] = {}
    for stage in report.outputs:
        feeding = {node.name for node in graph.upstream(node for node in graph.nodes if node.name == stage)}
        failed = sum(failure.stage in feeding for failure in report.failures) + refused
        if clips:
            out[stage] = f"made of {', '.join(clips[:3])}{' ...' if len(clips) > 3 else ''} alone"
        elif failed:
            out[stage] = f"{failed} task(s) that it is made from failed"
    return out


def _object(path: Path | None) -> Mapping[str, Any]:
    """The object of a JSON file; an empty one where there is none that can be read: then nothing is known to be lost."""
    try:
        found = json.loads(path.read_bytes()) if path else {}
    except (OSError, ValueError):
        return {}
    return found if isinstance(found, dict) else {}


def _videos(statistics: Mapping[str, Any]) -> int:
    found = statistics.get("videos")
    return found if isinstance(found, int) else 0


def _splits(statistics: Mapping[str, Any]) -> int:
    found = statistics.get("splits")
    return len(found) if isinstance(found, dict) else 0
