"""Stages by name or by file in the targets that have them, and settings that a target does not use."""

from __future__ import annotations

from pathlib import Path

import pytest

from commands.only import recorders
from commands.origin import origin
from commands.target_graphs import first_target_with, names_in_graph, resolve_target, track_reads
from maps.settings import SYSTEM_OF, Settings
from pipeline import TARGETS, build
from tests.commands.test_outputs import usual
from tests.helpers.command import RECORDED, Made, call
from tests.helpers.tiny_source import VIDEOS

CARD = {"frame_decode": "dataset", "mask_densify": "dataset", "hand_inpaint": "dataset", "object_completion": "dataset",
        "affordance_intersect": "dataset", "narration_labelling": "dataset", "dataset_pack": "dataset",
        "negative_affordance_projection": "negative-affordance", "rl_grasp_refinement": "grasp"}  # fmt: skip
"""the nine stages of the card -> the target that is chosen"""
CALLED = {"rl_grasp_refinement": {"teacher_0", "no_negative_0"}}
"""names on the map where they are others"""


@pytest.fixture(scope="module")
def unused(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A store in which nothing has run; plans share the parsed code in it."""
    store = tmp_path_factory.mktemp("unused") / "store"
    call("run", "dataset", "--dry-run", "--store", store)
    return store


@pytest.mark.parametrize("stage", CARD)
def test_a_plan_of_one_stage_names_it_and_what_it_needs(stage: str, unused: Path) -> None:
    """The plan on an empty store, without a target, has the stage and everything that it needs."""
    result = call("run", "--only", stage.replace("_", "-"), "--dry-run", "--store", unused, "--json")
    assert result.code == 0 and result.json["target"] == CARD[stage]
    planned = {task["stage"] for task in result.json["tasks"]}
    graph = usual(CARD[stage])
    nodes = [node for node in graph.stages() if node.name in CALLED.get(stage, {stage})]
    assert {node.name for node in nodes} == CALLED.get(stage, {stage}) <= planned
    needed = {node.name for node in graph.upstream(nodes) if node.sort == "stage"}
    assert needed <= planned and planned - needed == {one.name for node in nodes for one in recorders(graph, node)}


@pytest.mark.parametrize("stage", CARD)
def test_stages_of_the_card_are_explained(stage: str, unused: Path) -> None:
    """`explain` and `status` find the target; `lineage` says how to run a stage that never ran."""
    result = call("explain", stage, "--store", unused, "--json")
    assert result.code == 0, result.err
    assert result.json["target"] == CARD[stage]
    assert {task["stage"] for task in result.json["tasks"]} == CALLED.get(stage, {stage})
    counts = call("status", stage, "--store", unused, "--json").json
    assert (counts["target"], set(counts["stages"])) == (CARD[stage], CALLED.get(stage, {stage}))
    never = call("lineage", stage, "--store", unused)
    assert never.code == 2 and f"run --only {stage}" in never.err and never.err.count("\n") == 1


@pytest.mark.parametrize("words", [("run", "--only"), ("run", "--dry-run", "--only"), ("explain",), ("status",), ("lineage",)])
def test_an_unknown_stage_is_refused_with_the_nearest_name(words: tuple[str, ...], made: Made) -> None:
    """Exit 2 and one sentence."""
    refused = call(*words, "mask_densfy", "--store", made.store)
    assert refused.code == 2 and refused.err.count("\n") == 1 and "mask_densfy" in refused.err
    assert "did you mean 'mask_densify'" in refused.err


def test_names_on_a_map_come_before_those_of_files() -> None:
    """A stage of the name; else all of the file; the first target that has it."""
    assert [first_target_with(word) for word in ("hand_retarget", "motion_retarget", "grasp_evaluate", "train_pack")] == [
        "grasp", "motions", "grasp", "train"]
    assert names_in_graph("mask_densify", usual("extraction-report")) == ["mask_densify"]
    assert names_in_graph("rl-grasp-refinement", usual("grasp")) == ["teacher_0", "no_negative_0"]
    assert resolve_target(None) == "dataset" and resolve_target("negative_affordance") == "negative-affordance"


def test_recordings_of_a_stage_are_its_own_or_those_that_show_it() -> None:
    """A stage that reads its output and publishes a recording counts; stages further down do not."""
    graph = usual("negative-affordance")
    node = {one.name: one for one in graph.stages()}
    assert [one.name for one in recorders(graph, node["negative_affordance_projection"])] == ["object_record"]
    assert [one.name for one in recorders(graph, node["scorer_train"])] == ["record_scorer_train"]
    assert recorders(graph, node["lesson_masks"]) == []
    data = usual("dataset")
    for stage in RECORDED:
        found = next(one for one in data.stages() if one.name == stage)
        assert [one.name for one in recorders(data, found)] == [f"record_{stage}"]


# -- runs --------------------------------------------------------------------------------------------------------------


def test_a_stage_that_never_ran_brings_what_it_needs(made: Made, tmp_path: Path) -> None:
    """Its inputs are computed and its output is recorded, without a target; a second run does nothing."""
    words = ("run", "--only", "narration_labelling", "--source", made.source, "--store", tmp_path, "--jobs", "0", "--json")
    first, again = call(*words), call(*words)
    assert first.code == again.code == 0
    assert first.json["ran"] == dict.fromkeys(
        ("source_read", "clip_footage", "frame_decode", "narration_labelling", "record_narration_labelling"), 2)
    folder = tmp_path / "recordings" / made.source.name / "narration_labelling"
    assert first.json["outputs"] == again.json["outputs"] == {"recordings": str(folder)} and str(folder) in first.err
    assert {path.name for path in folder.iterdir()} == {f"{video}.mcap" for video in VIDEOS} and again.json["ran"] == {}


def test_a_plan_of_one_stage_on_its_last_inputs_shows_that_stage(made: Made) -> None:
    """The plan has the stage and its recorder, and no stage before them."""
    result = made.ask("run", "--only", "mask_densify", "--dry-run", "--json", "--set", "mask_densify.radius=3").json["tasks"]
    assert {(task["stage"], task["status"]) for task in result} == {("mask_densify", "run"), ("record_mask_densify", "pending")}


def test_a_stage_of_another_source_is_not_run(made: Made, tmp_path: Path) -> None:
    """Results of other videos do not count as last inputs of this source."""
    from tests.helpers.tiny_source import write_source

    mine = made.copy(tmp_path)
    other = write_source(tmp_path / "other", ("P96_09",))
    words = ("--only", "frame_decode", "--source", other, "--store", mine.store, "--jobs", "0", "--no-record", "--json")
    result = call("run", *words)
    assert result.code == 0 and result.json["ran"] == {"source_read": 1, "clip_footage": 1, "frame_decode": 1}
    assert "stale" not in result.words


def test_a_stage_that_collects_clips_does_not_take_those_of_another_source(made: Made, tmp_path: Path) -> None:
    """A stage that runs once has no clip's name to tell sources apart; its last inputs count where the source is the same."""
    from tests.helpers.tiny_source import write_source

    mine = made.copy(tmp_path)
    other = write_source(tmp_path / "other", ("P96_09",))
    words = ("run", "--only", "dataset_pack", "--store", mine.store, "--jobs", "0", "--no-record", "--json")
    edited = call(*words, "--source", made.source, "--set", "dataset_pack.sheet_samples=3", "--set", "mask_densify.radius=3")
    assert edited.code == 0 and edited.json["ran"] == {"dataset_pack": 1}
    result = call(*words, "--source", other)
    assert result.code == 0 and {"source_read", "mask_densify", "dataset_pack"} <= result.json["ran"].keys()


def test_lineage_of_a_stage_is_that_of_its_last_output(made: Made) -> None:
    """Named by its name, or by that of its file."""
    shown = made.ask("lineage", "mask-densify", source=False)
    assert shown.code == 0 and "mask_densify" in shown.out.splitlines()[0] and "frame_decode" in shown.out
    assert "dataset_pack" in made.ask("lineage", "dataset_pack", source=False).out.splitlines()[0]


@pytest.mark.parametrize(("words", "message"), [
    (("explain", "model_train", "--target", "dataset"),
     "dataset has no stage 'model_train'; it belongs to train, benchmark, ablation"),
    (("explain", "model-train", "--target", "dataset"), "it belongs to train"),
    (("explain", "rl_grasp_refinement", "--target", "dataset"), "it belongs to grasp (as teacher_0, "),
    (("run", "dataset", "--only", "model_train"), "it belongs to train"),
    (("run", "dataset", "--force", "model_train"), "it belongs to train"),
    (("run", "dataset", "--dry-run", "--force", "model_train"), "it belongs to train"),
    (("run", "dataset", "--set", "model_train.steps=5"),
     "--set model_train.steps=5: dataset does not use model_train; it belongs to train, benchmark, ablation"),
    (("run", "dataset", "--set", "model-train.steps=4500"), "dataset does not use model_train"),
    (("run", "dataset", "--dry-run", "--set", "sor3d_train.steps=5"), "it belongs to sor3d, sor3d-ablation"),
    (("status", "--set", "sor3d_train.steps=5"), "it belongs to sor3d"),
    (("explain", "--set", "sor3d_train.steps=5"), "it belongs to sor3d"),
    (("run", "dataset", "--set", "scene_render.seed=1"), "dataset does not use scene_render with this source; it belongs to "),
])  # fmt: skip
def test_stages_and_settings_of_other_targets_are_refused(words: tuple[str, ...], message: str, made: Made) -> None:
    """Exit 2, one sentence with the targets that have them, and nothing runs."""
    before = made.traces
    refused = call(*words, "--source", made.source, "--store", made.store)
    assert refused.code == 2 and message in refused.words and refused.err.count("\n") == 1 and made.traces == before


def test_a_file_of_parameters_may_have_those_of_other_targets(made: Made, tmp_path) -> None:  # type: ignore[no-untyped-def]
    """One file serves several targets."""
    (tmp_path / "all.toml").write_text("[model_train]\nsteps = 5\n[mask_densify]\nradius = 3\n")
    assert made.ask("explain", "--params", tmp_path / "all.toml").code == 0


@pytest.mark.parametrize("target", TARGETS)
def test_read_settings_are_tracked(target: str) -> None:
    """Stages whose parameters are in the graph under their own name are read, and not all stages are."""
    chosen, read = track_reads(Settings())
    graph = build(target, origin(target, None, chosen, lambda path: "")[0], chosen)
    fields = {stage: Settings().params(stage) for stage in SYSTEM_OF}
    own = {node.name for node in graph.stages() if node.name in fields and node.params is fields[node.name]}
    assert own <= read and not fields.keys() <= read
