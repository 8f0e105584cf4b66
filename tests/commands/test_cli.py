"""The verbs of the command line: output, usage errors, and JSON."""

from __future__ import annotations

import dataclasses
import io
import json
import re
import subprocess
import sys
import tomllib
from collections.abc import Iterator
from functools import reduce
from pathlib import Path
from typing import Any

import h5py
import pytest

from commands.backends import rows
from commands.backends import show as show_backends
from commands.params import show as show_params
from commands.publish import LISTED
from commands.settings import parameters_of
from maps.settings import SYSTEM_OF, SYSTEMS, Origin, Settings
from pipeline import TARGETS, build
from schemas.scene import SceneSpec
from stages.extraction import mask_densify
from tests.helpers.command import KEYS, PER_CLIP, PER_RUN, Made, call
from tests.helpers.tiny_source import VIDEOS

ROOT = Path(__file__).resolve().parents[2]
STAGES = {*PER_CLIP, *PER_RUN}


class Terminal(io.StringIO):
    """Stream that claims to be a terminal."""

    def isatty(self) -> bool:
        return True


@pytest.fixture
def mine(made: Made, tmp_path: Path) -> Made:
    """Copy of the source and the store."""
    return made.copy(tmp_path)


def test_a_python_without_the_libraries_gets_a_hint() -> None:
    bare = [sys.executable, "-S", "pipeline.py", "--help"]
    done = subprocess.run(bare, cwd=ROOT, capture_output=True, text=True)
    assert done.returncode == 1
    assert "Traceback" not in done.stderr and ".venv/bin/activate" in done.stderr


# -- usage errors ------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("words", "hint"),
    [
        (("run", "datset"), "did you mean 'dataset'"),
        (("run", "dataset", "--set", "mask_densfy.radius=1"), "did you mean 'mask_densify'"),
        (("run", "dataset", "--set", "mask_densify.radus=1"), "did you mean 'radius'"),
        (("run", "dataset", "--set", "mask_densify.radius=wide"), "expected int, got 'wide'"),
        (("run", "dataset", "--set", "radius"), "expected STAGE.PARAM=VALUE"),
        (("run", "dataset", "--params", "none.toml"), "none.toml"),
        (("run", "dataset", "--only", "mask_densfy"), "mask_densify"),
        (("run", "dataset", "--force", "mask_densfy"), "mask_densify"),
        (("run", "dataset", "--clip", "P96_1"), "P96_01"),
        (("run", "dataset", "--jobs", "-1"), "expected 0"),
        (("run", "dataset", "--jobs", "many"), "not a valid int"),
        (("run", "dataset", "--minutes", "5"), "dataset has no optional parts"),
        (("run", "dataset", "--minutes", "-5"), "not in the range"),
        (("run", "dataset", "--dri-run"), "--dry-run"),
        (("status", "datset"), "did you mean 'dataset'"),
        (("explain", "mask_densfy"), "did you mean 'mask_densify'"),
        (("explain", "--clip", "P96_1"), "P96_01"),
        (("graph", "datset"), "did you mean 'dataset'"),
    ],
)
def test_unknown_names_are_refused_with_the_nearest_name(words: tuple[str, ...], hint: str, made: Made) -> None:
    """Exit 2, one sentence, no traceback, and nothing runs."""
    before = made.traces
    store = [] if words[0] == "graph" else ["--store", made.store]
    refused = call(*words, "--source", made.source, *store)
    assert refused.code == 2 and hint in refused.words.replace("│ ", "")
    assert "Traceback" not in refused.err and made.traces == before


@pytest.mark.parametrize(
    ("words", "hint"),
    [
        (("params", "mask_densfy"), "did you mean 'mask_densify'"),
        (("export", "coko", "out"), "did you mean 'coco'"),
        (("rum",), "run"),
        (("lineage", "0000"), "matches 0 artifacts"),
    ],
)
def test_other_verbs_refuse_unknown_names(words: tuple[str, ...], hint: str, made: Made) -> None:
    """Exit 2 as well."""
    store = ["--store", made.store] if words[0] in ("lineage", "export") else []
    refused = call(*words, *store)
    assert refused.code == 2 and hint in refused.words.replace("│ ", "") and "Traceback" not in refused.err


@pytest.mark.parametrize("what", ["nothing", "file", "empty"])
def test_an_invalid_source_is_refused(what: str, tmp_path: Path) -> None:
    """A missing folder, a file, an empty folder: exit 2, before the store is used."""
    source = tmp_path / "source"
    {"nothing": lambda: None, "file": source.touch, "empty": source.mkdir}[what]()
    refused = call("run", "dataset", "--source", source, "--store", tmp_path / "store")
    assert refused.code == 2 and f"error: --source {source}: " in refused.err and refused.err.count(str(source)) == 1


@pytest.mark.parametrize("target", ["dataset", "scenes", "recordings", "extraction-report"])
def test_an_unknown_rendered_clip_is_refused(target: str, tmp_path: Path) -> None:
    """The names are known before rendering: a plan refuses the clip as a run does."""
    first = "P91_01" if target == "extraction-report" else "P93_01"
    for words in ((), ("--dry-run",)):
        refused = call("run", target, "--clip", first, "--clip", first.replace("0", "O"), "--store", tmp_path, *words)
        assert refused.code == 2 and f"did you mean '{first}'" in refused.err and not list((tmp_path / "traces").rglob("*.json"))
    for clip in (first, *([] if target == "scenes" else [f"{first}_s02"])):  # a part of it
        assert call("run", target, "--clip", clip, "--dry-run", "--store", tmp_path).code == 0


def test_explain_names_the_known_clips(made: Made) -> None:
    """Tasks without a clip, and unknown shards, are not listed."""
    result = made.ask("explain", "--clip", "nope").err
    assert result.rstrip().endswith(f"Valid: {', '.join(sorted(VIDEOS))}")
    result = made.ask("explain", "--clip", "nope", "--set", "source_read.max_frames=50").err
    assert "Valid: P" in result and "*" not in result


READING_VERBS = [("verify",), ("gc",), ("du",), ("lineage", "0000"), ("status",), ("explain",), ("stale",), ("inspect", "abcd"),
                 ("runs",), ("runs", "diff", "last", "last"), ("runs", "timeline")]


@pytest.mark.parametrize("words", READING_VERBS, ids=" ".join)
@pytest.mark.parametrize("what", ["nothing", "file", "empty"])
def test_reading_verbs_refuse_a_folder_that_is_not_a_store(words: tuple[str, ...], what: str, tmp_path: Path) -> None:
    """Exit 2, one sentence, and nothing is created."""
    store = tmp_path / "store"
    {"nothing": lambda: None, "file": store.touch, "empty": store.mkdir}[what]()
    refused = call(*words, "--store", store)
    assert refused.code == 2 and refused.err.count("\n") == 1
    assert refused.err.startswith(f"error: --store {store}: {store} ")
    assert [path.name for path in tmp_path.rglob("*")] == ([] if what == "nothing" else ["store"])


@pytest.mark.parametrize("inside", ["", "deeper"])
def test_a_store_cannot_be_a_file(inside: str, tmp_path: Path) -> None:
    """A path inside a file is refused as well; exit 2, one sentence."""
    (tmp_path / "file").touch()
    for words in (("run", "dataset"), ("run", "dataset", "--dry-run"), ("export", "epic", tmp_path / "out")):
        refused = call(*words, "--store", tmp_path / "file" / inside)
        assert refused.code == 2 and "is a file; name a folder" in refused.err and refused.err.count("\n") == 1


def test_a_verb_alone_shows_help() -> None:
    """The program lists its verbs, and each verb has a help text."""
    verbs = ("run", "status", "explain", "stale", "graph", "runs", "lineage", "verify", "gc", "du", "inspect", "export", "params",
             "predict", "grasp", "demo")
    helped = call("--help")
    assert helped.code == 0 and all(verb in helped.out for verb in verbs)
    assert all(call(verb, "--help").code == 0 for verb in verbs)


def test_the_version_is_that_of_the_project() -> None:
    """One line."""
    result = call("--version")
    project = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]
    assert (result.code, result.out, result.err) == (0, f"afford {project['version']}\n", "")


def test_make_quotes_paths_and_writes_no_codes_of_terminals_into_a_pipe() -> None:
    """The list of targets is plain text; a store and a recording may have blanks in their names."""
    make = ["make", "--no-print-directory", "-C", str(ROOT)]
    listed = subprocess.run([*make, "help"], capture_output=True, text=True, check=True).stdout
    assert "\x1b" not in listed and re.search(r"^  dataset +build the data set", listed, re.MULTILINE)
    for target in ("dataset", "stage", "report", "train", "demo", "inspect"):
        words = ["STORE=a b", "RECORDING=c d", "STAGE=mask_densify", target]
        shown = subprocess.run([*make, "-n", "-o", ".venv/.ready", *words], capture_output=True, text=True, check=True).stdout
        assert ('"c d"' if target == "inspect" else '"a b"') in shown, target


# -- what the verbs say ------------------------------------------------------------------------------------------------


def test_run_prints_its_summary_in_the_last_line(made: Made) -> None:
    """The keys are the documented ones; all other output goes to stderr."""
    done = made.run("dataset")
    assert set(done.json) == KEYS and len(done.out.splitlines()) == 1
    assert isinstance(done.json["seconds"], float) and done.json["target"] == "dataset"
    for path in done.json["outputs"].values():
        assert Path(path).exists() and path in done.err


def test_status_counts_and_lists_failures(made: Made) -> None:
    """Counts per stage; all is cached after a run."""
    stages = made.ask("status", "--json").json["stages"]
    assert stages.keys() == STAGES and all(set(counts) == {"cached"} for counts in stages.values())
    assert "mask_densify 2" in made.ask("status").words
    changed = made.ask("status", "dataset", "--set", "mask_densify.radius=3", "--json").json["stages"]
    assert changed["mask_densify"] == {"run": 2} and changed["dataset_pack"] == {"pending": 1}


def test_explain_gives_a_reason_for_every_task(made: Made) -> None:
    """One stage or one clip can be selected."""
    tasks = made.ask("explain", "mask-densify", "--clip", VIDEOS[0], "--set", "mask_densify.radius=3", "--json").json["tasks"]
    assert [(task["stage"], task["clip"].split("/")[-1], task["status"]) for task in tasks] == [("mask_densify", VIDEOS[0], "run")]
    assert tasks[0]["reason"] == "parameter changed: radius 0 -> 3"
    assert "first run" in made.ask("explain", "dataset_pack").words


def test_the_help_names_every_target() -> None:
    """The order is that of the table, for every verb with a target."""
    *first, last = TARGETS
    for verb in ("run", "status", "graph"):
        assert f"{', '.join(first)} or {last}" in call(verb, "--help").words.replace("│ ", "")


@pytest.mark.parametrize("target", TARGETS)
def test_graph_shows_every_stage_and_its_inputs(target: str, tmp_path: Path) -> None:
    """Text and drawing."""
    text = call("graph", target)
    built = build(target, Origin("synthetic", specs=(SceneSpec("P91_01", "carry", "kitchen", seed=3),)), Settings())
    lines = {line.split()[0]: line for line in text.out.splitlines()}
    assert text.code == 0 and lines.keys() == {node.name for node in built.stages()}
    assert all((" <- " in lines[node.name]) == bool(node.inputs) for node in built.stages())
    drawn = call("graph", target, "--out", tmp_path / "graph.svg")
    assert drawn.code == 0 and "<svg" in (tmp_path / "graph.svg").read_text()


def test_graph_refuses_other_formats(tmp_path: Path) -> None:
    """The suffix selects the format."""
    refused = call("graph", "--out", tmp_path / "graph.docx")
    assert refused.code == 2 and ".svg or .png" in refused.err


def test_graph_makes_the_folder_that_it_draws_to(tmp_path: Path) -> None:
    """One sentence reports a folder that cannot be created."""
    assert call("graph", "--out", tmp_path / "new" / "deep" / "graph.svg").code == 0
    assert "<svg" in (tmp_path / "new" / "deep" / "graph.svg").read_text()
    (tmp_path / "file").touch()
    (tmp_path / "folder.svg").mkdir()
    for out in (tmp_path / "file" / "graph.svg", tmp_path / "folder.svg"):
        refused = call("graph", "--out", out)
        assert refused.code == 2 and f"--out {out}: the file cannot be written" in refused.err


def test_lineage_leads_to_the_files_from_outside(made: Made) -> None:
    """A published file, or a digest prefix, leads to the video."""
    recording = made.store / "recordings" / made.source.name / f"{VIDEOS[0]}.mcap"
    printed = made.ask("lineage", recording, source=False)
    assert printed.code == 0
    wanted = ("clip_record", "hand_inpaint", "source_read", "from outside", f"{VIDEOS[0]}.MP4")
    assert not [word for word in wanted if word not in printed.out], printed.out
    again = made.ask("lineage", made.ask("lineage", recording, "--json", source=False).json["digest"][:16], source=False)
    assert again.out == printed.out


def test_verify_finds_no_fault_in_an_intact_store(made: Made) -> None:
    """Exit 0; JSON with counts."""
    assert made.ask("verify", source=False).words.endswith("no problem found")
    found = made.ask("verify", "--json", source=False).json
    assert found["ok"] and found["blobs"] > 50 and found["damaged"] == found["missing"] == found["changed"] == []


def _leaves(params: Any) -> Iterator[str]:
    """Yield the names of all parameters, those of a block as BLOCK.NAME."""
    for field in dataclasses.fields(params):
        inner = getattr(params, field.name)
        is_block = dataclasses.is_dataclass(inner)
        yield from (f"{field.name}.{name}" for name in _leaves(inner)) if is_block else (field.name,)


def test_params_lists_every_parameter_with_type_default_and_meaning() -> None:
    """The default is the effective one, also where a target changes that of the stage."""
    rows = call("params", "--json").json
    wanted = {(system, stage, name) for stage, system in SYSTEM_OF.items() for name in _leaves(Settings().params(stage))}
    assert {(row["system"], row["stage"], row["name"]) for row in rows} == wanted
    assert all(row["type"] and row["doc"] for row in rows)
    for row in rows:
        in_force = reduce(getattr, row["name"].split("."), Settings().params(row["stage"]))
        assert row["default"] == json.loads(json.dumps(in_force)), (row["stage"], row["name"])
    assert Settings.grasping.motion_synthesise != type(Settings.grasping.motion_synthesise)()
    shown = re.findall(r"^mask_densify\.(\S+)", call("params", "mask-densify").out, re.MULTILINE)
    named = [row["name"] for row in rows if row["stage"] == "mask_densify"]
    blocks = {"flow", "sam2", "xmem"}
    assert [name for name in shown if name not in blocks] == named and blocks <= {*shown}


@pytest.mark.parametrize("terminal", [False, True])
def test_params_names_parameters_whole(terminal: bool, monkeypatch: pytest.MonkeyPatch) -> None:
    """Each parameter begins a line and has its meaning below it, in a pipe and on a narrow terminal."""
    result = Terminal() if terminal else io.StringIO()
    monkeypatch.setenv("COLUMNS", "80")
    monkeypatch.setattr(sys, "stdout", result)
    show_params(None, False)
    text = re.sub("\x1b\\[[0-9;]*m", "", result.getvalue())
    assert [line for line in text.splitlines() if line in SYSTEMS] == list(SYSTEMS)
    for stage in SYSTEM_OF:
        for field in dataclasses.fields(Settings().params(stage)):
            assert re.search(rf"^{stage}\.{field.name} ", text, re.MULTILINE), f"{stage}.{field.name}"
    docs = [one.doc for one in parameters_of(mask_densify.Params())]
    assert all(doc in " ".join(text.split()) for doc in docs) and not all(doc in text for doc in docs) and "…" not in text
    assert max(map(len, text.splitlines())) <= (80 if terminal else 100)


@pytest.mark.parametrize("terminal", [False, True])
def test_backends_are_printed_in_blocks_without_cuts(terminal: bool, monkeypatch: pytest.MonkeyPatch) -> None:
    """The parameter comes first, then description, requirements and reason."""
    result = Terminal() if terminal else io.StringIO()
    monkeypatch.setenv("COLUMNS", "80")
    monkeypatch.setattr(sys, "stdout", result)
    show_backends(None, (), None, False, None)
    text = re.sub("\x1b\\[[0-9;]*m", "", result.getvalue())
    assert max(map(len, text.splitlines())) <= (80 if terminal else 100) and "…" not in text
    words = " ".join(text.split())
    for row in rows(Settings()):
        assert f"{row.parameter} = {row.backend} " in text and row.about in words and row.why_not in words


def test_a_dry_run_has_one_row_for_the_tasks_of_a_stage(made: Made) -> None:
    """The row has their number and the full reason; a single task is named by its clip."""
    shown = made.ask("run", "dataset", "--dry-run", "--set", "mask_densify.radius=3").out.splitlines()
    lines = [" ".join(line.split()) for line in shown]
    assert {"mask_densify run 2 parameter changed: radius 0 -> 3", "hand_inpaint pending 2 upstream pending",
            "dataset_pack pending 1 upstream pending"} <= set(lines)  # fmt: skip
    assert len({line.split()[0] for line in lines[1:-1]}) == len(lines) - 2
    one = made.ask("run", "dataset", "--dry-run", "--clip", VIDEOS[0], "--set", "mask_densify.radius=3").words
    assert f"mask_densify run {VIDEOS[0]}/{VIDEOS[0]} parameter changed: radius 0 -> 3" in one


def test_inspect_summarises_what_run_published(made: Made) -> None:
    """The folder of recordings, strictly; its list names those of clips."""
    folder = made.store / "recordings" / made.source.name
    assert (folder / LISTED).read_text().split() == [f"{video}.mcap" for video in VIDEOS]
    assert call("inspect", folder, "--strict").code == 0
    printed = call("inspect", folder, "--json")
    assert printed.code == 0 and all(video in printed.out for video in VIDEOS)
    assert call("inspect", folder / f"{VIDEOS[0]}.mcap", folder / f"{VIDEOS[1]}.mcap", "--diff").code == 1


# -- export ------------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("format", ["2hands", "coco", "webdataset"])
def test_the_data_set_can_be_exported(format: str, made: Made, tmp_path: Path) -> None:
    """One run per format; a folder with files in it is left alone."""
    out = tmp_path / "out"
    done = made.ask("export", format, out)
    assert done.code == 0 and any(path.is_file() for path in out.rglob("*"))
    if format == "2hands":
        assert all(h5py.File(path).keys() for path in out.rglob("*.h5"))
    refused = made.ask("export", format, out)
    assert refused.code == 2 and "the folder is not empty" in refused.err


def test_a_missing_data_set_cannot_be_exported(made: Made, tmp_path: Path) -> None:
    """The error says how to make it."""
    refused = call("export", "coco", tmp_path / "out", "--store", made.store)
    assert refused.code == 2 and "make dataset" in refused.err and not (tmp_path / "out").exists()


def test_a_file_of_parameters_counts_as_parameters(mine: Made, tmp_path: Path) -> None:
    """TOML or JSON, one table per stage; `--set` wins."""
    (tmp_path / "p.json").write_text(json.dumps({"narration_labelling": {"policy": "all"}}))
    plan = mine.run("dataset", "--dry-run", "--params", str(tmp_path / "p.json")).json["tasks"]
    assert {task["stage"] for task in plan if task["status"] == "run"} == {"narration_labelling"}
    back = mine.run("dataset", "--dry-run", "--params", str(tmp_path / "p.json"), "--set", "narration_labelling.policy=last")
    assert {task["status"] for task in back.json["tasks"]} == {"cached"}
