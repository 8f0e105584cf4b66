"""Measured memory beside the declared: in the summary, and as a warning."""

from __future__ import annotations

import re
from pathlib import Path

import pytest

from commands.memory import StageMemory, memory_warnings, show_memory_warnings, stage_memory
from commands.session import open_runner
from commands.summary import Summary, show_summary
from runner import Graph, RunReport
from schemas.files import FileTree
from stages.extraction import mask_densify, narration_labelling
from tests.helpers.command import Made, call


def report(**mib: float) -> RunReport:
    """A report with the peak of each stage, twice as much as that of another shard."""
    peaks = {(stage, shard): peak / share for stage, peak in mib.items() for shard, share in (("a", 2), ("b", 1))}
    return RunReport("t", ran=dict.fromkeys(mib, 2), peak_mib=peaks)


def test_the_largest_shard_of_a_stage_counts_and_the_selected_backend_declares(tmp_path: Path) -> None:
    """Two names of one function, with other backends; a stage without measurement is left out."""
    graph = Graph()
    clip, frames = graph.leaf("clip", FileTree("clip", ())), graph.leaf("frames", FileTree("frames", ()))
    for name, backend in (("flow", "flow"), ("sam2", "sam2")):
        graph.named(name).add(mask_densify.run, clip=clip, frames=frames, params=mask_densify.Params(backend=backend))
    graph.add(narration_labelling.run, clip=clip, frames=frames, params=narration_labelling.Params())
    found = stage_memory(open_runner(tmp_path / "store"), graph, report(flow=1024.0, sam2=7168.0))
    file = "stages/extraction/mask_densify.py"
    assert found == {"flow": StageMemory(file, mask_densify.MEMORY_GIB, 1.0),
                     "sam2": StageMemory(file, mask_densify.BACKEND_MEMORY_GIB["sam2"], 7.0)}


@pytest.mark.parametrize(("declared", "measured", "lies"), [
    (1.0, 1.0, False), (1.0, 1.3, False), (1.0, 1.4, True), (0.1, 0.2, False), (0.1, 0.3, True), (8.0, 1.0, False)])
def test_a_stage_is_warned_of_when_it_needs_clearly_more(declared: float, measured: float, lies: bool) -> None:
    """A line says where to raise it; stages that did not run are not named again."""
    memory = {"s": StageMemory("stages/x/s.py", declared, measured)}
    expected = [f"s needed {measured:.1f} GiB and declares {declared:g}; raise MEMORY_GIB in stages/x/s.py, or lower --jobs"]
    assert list(memory_warnings(memory, ["s", "other"])) == (expected if lies else [])
    assert list(memory_warnings(memory, [])) == []


def test_the_summary_shows_both(capsys: pytest.CaptureFixture[str]) -> None:
    """Used and declared GiB of each stage; nothing for a stage without measurement."""
    memory = {"s": StageMemory("stages/x/s.py", 1.0, 2.345)}
    show_summary(Summary("t", {"s": 2, "other": 1}), report(s=2400.0), None, memory)
    show_memory_warnings(memory, ["s"])
    lines = [line.strip() for line in capsys.readouterr().err.splitlines()]
    assert lines[0].endswith("GiB used/declared") and lines[1].split()[-1] == "2.3/1" and "other" in lines[2]
    assert lines[-1].startswith("memory s needed 2.3 GiB")


def test_backends_show_declared_and_measured_memory(made: Made, monkeypatch: pytest.MonkeyPatch) -> None:
    """The measured memory comes from the store; a backend that never ran has none."""
    monkeypatch.setattr("commands.backends.STORE", made.store)
    monkeypatch.setattr("commands.session.STORE", made.store)
    flow, sam2 = (next(row for row in call("backends", "mask_densify", "--json").json if row["backend"] == name)
                  for name in ("flow", "sam2"))  # fmt: skip
    assert re.fullmatch(r"memory 2 GiB, measured \d\.\d", flow["resources"])
    assert sam2["resources"] == "memory 6 GiB; GPU by sam2.device"
