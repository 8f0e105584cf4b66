"""Recordings of the stages of all targets: each stage has one, or a reason why another recording shows its output."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace

import pytest

from commands.origin import origin
from maps.settings import Origin, Settings
from pipeline import TARGETS, build
from runner import Graph
from runner.graph import Node
from schemas.files import FileTree
from schemas.scene import RenderedClip
from tests.helpers.stage_files import MODULES

RECORDERS = {"clip_record", "grasp_record", "interaction_record", "motion_record", "object_record", "policy_record",
             "positive_record", "run_record", "scorer_record", "stage_record", "training_record"}  # fmt: skip
"""stages that record what others made"""
PLAN = "a list of what is to be rendered: the names and seeds stand in what is made of it"
FIGURES = "figures of one shard: the report over all of them is recorded"
EXCEPTIONS: dict[str, str] = {
    "train_plan": PLAN, "shift_plan": PLAN, "benchmark_plan": PLAN, "hand_plan": PLAN, "object_plan": PLAN,
    "interaction_plan": PLAN, "household_plan": PLAN, "tool_plan": PLAN,
    "scene_render": "its video is /frame_decode/image of the recording of the clip",
    "still_render": "stills are on the contact sheet of train_pack, which is recorded",
    "tool_render": "stills are on the contact sheet of train_pack, which is recorded",
    "still_sample": "samples are on the contact sheet of train_pack, which is recorded",
    "hand_lessons": "pictures in new disguises are the previews of hands_train and held_train",
    "interaction_render": "its frames are /interaction_read/image of interaction_record",
    "clip_footage": "the part of a clip that names its frames, all of them in the recording of the clip",
    "key_thin": "a clip with fewer key frames: the report that compares both is recorded",
    "extraction_score": FIGURES, "score_cases": FIGURES, "sor3d_evaluate": FIGURES, "scene_flow_score": FIGURES,
    "negative_affordance_score": FIGURES, "imitation_evaluate": FIGURES,
    "grasp_judge": "what a model thinks of episodes stands in grasp_report, which is recorded",
    "grasp_two_tasks": "its sheet and its pairs are on the page of grasp_report, which is recorded",
    "predict_cases": "predictions are on the sheet of the benchmark, which is recorded",
    "baseline_cases": "predictions are on the sheet of the benchmark, which is recorded",
    "benchmark_set": "pictures and masks in a published layout: the benchmark that reads them is recorded with its sheet",
    "interaction_read": "frames and depth are /interaction_read/... of interaction_record",
    "scene_flow": "motion is /scene_flow/image of interaction_record",
    "action_read": "clips of a pre-training, which leaves curves: sor3d_pretrain is recorded",
    "action_pack": "the same clips as files of tensors",
    "static_read": "pictures and labels are on the sheets of static_evaluate, which are recorded",
    "mesh_read": "the mesh is /mesh_texture/mesh of object_record, with its texture",
    "negative_affordance_files": "the same overlays and points as files that object_record shows",
    "object_solids": "its hulls are /grasp_evaluate/scene of grasp_record",
    "grasp_tasks_predicted": "the points that it puts into tasks are those of object_record and positive_record",
    "grasp_targets": "the poses that motions grasp: /motion_synthesise/object of motion_record",
    "hand_landmarks": "keypoints of the hands that remain are those of hand_detect",
    "keypoint_files": "the motions are those of motion_record, as files",
    "recordings_read": "the motions as they become clips are those of human_motion; refused files are in prior_report",
    "clip_proof": "its verdicts are on the page of prior_report, which is recorded",
    "part_segment": "its parts are those of the hulls that grasp_record shows",
    "body_tasks": "its bodies are /grasp_evaluate/scene of grasp_record; refusals are in body_report, which is recorded",
    "body_choose": "its bodies are /grasp_evaluate/scene of grasp_record; its choices are in body_report, which is recorded",
    "body_adapt": "its episodes before and after are in body_report, which is recorded, and those after in grasp_record",
    "body_refinement": "its curves are tensorboard/ of its files; its episodes are those of grasp_record",
    "household_build": "its mesh is that of the hulls that grasp_record shows",
    "household_tasks": "its bodies are /grasp_evaluate/scene of grasp_record; refusals are in household_report, which is recorded",
    "body_evaluate": "its episodes, joined by body_episodes, are those of grasp_record",
    "motion_report": "the verdict on each clip is in the log of motion_record",
}
"""stage -> why it has no recorder of its own"""
ELSEWHERE = {"grasp_candidates", "grasp_compare", "grasp_compare_report"}
"""stages of commands that belong to no target"""


def settings() -> Settings:
    """Settings with everything that adds stages to a graph."""
    usual = Settings()
    judge = usual.grasping.grasp_judge
    return replace(usual, weights=(("hand_landmarks", FileTree("a", ())),)).with_stages(
        hand_detect=replace(usual.extraction.hand_detect, backend="network"),
        tool_plan=replace(usual.synthetic.tool_plan, per_category=1),
        sor3d_report=replace(usual.rgbd.sor3d_report, pretrained=True),
        grasp_judge=replace(judge, backend="endpoint", endpoint=replace(judge.endpoint, url="http://localhost")),
        grasp_report=replace(usual.grasping.grasp_report, rows=("teacher", "student", "positive")))  # fmt: skip


def graphs() -> Iterator[tuple[str, Graph]]:
    """Graphs of all targets without a source, and with a source that adds stages."""
    chosen, none = settings(), FileTree("a", ())
    for target in TARGETS:
        if target != "all":
            yield target, build(target, origin(target, None, Settings(), lambda path: "")[0], chosen)
    for target, place in {
        "recordings": Origin("v", videos=(RenderedClip(none, none, none),), bare=True),
        "motions": Origin("v", videos=(RenderedClip(none, none, none),), bare=True),
        "negative-affordance": Origin("m", meshes=(none,)), "grasp": Origin("m", meshes=(none,)),
        "grasp-adapt": Origin("m", meshes=(none,)),
        "sor3d": Origin("s", sequences=(none,), actions=none),
        "static-sets": Origin("p", pictures=none)}.items():  # fmt: skip
        yield target, build(target, place, chosen)


def function(node: Node) -> str:
    return str(node.value.__module__.rpartition(".")[2])


def shown(graph: Graph) -> set[str]:
    """Stages of which a recorder takes an output, whole, in part or collected."""
    by_id = {node.id: node for node in graph.nodes}
    out: set[str] = set()
    for node in graph.stages():
        todo = [by_id[made] for _, made in node.inputs] if function(node) in RECORDERS else []
        while todo:
            one = todo.pop()
            if one.sort == "stage":
                out.add(function(one))
            else:
                todo += [by_id[made] for _, made in one.inputs]
    return out


@pytest.fixture(scope="module")
def built() -> list[tuple[str, Graph]]:
    return list(graphs())


def test_stages_of_targets_are_recorded_or_have_a_reason(built: list[tuple[str, Graph]]) -> None:
    """Stages are identified by their function: one target's recording serves the other targets of the stage."""
    recorded = set().union(*(shown(graph) for _, graph in built))
    found = {function(node): target for target, graph in built for node in graph.stages()}
    assert not {stage: target for stage, target in found.items() if stage not in recorded | RECORDERS | EXCEPTIONS.keys()}


def test_the_exceptions_are_needed(built: list[tuple[str, Graph]]) -> None:
    """No reason for a stage that is recorded or gone; every stage but those of commands is in a target."""
    assert not EXCEPTIONS.keys() & set().union(*(shown(graph) for _, graph in built))
    found = {function(node) for _, graph in built for node in graph.stages()}
    assert EXCEPTIONS.keys() <= found and found >= RECORDERS
    assert found == MODULES.keys() - ELSEWHERE


def test_trainings_are_recorded_with_their_parameters(built: list[tuple[str, Graph]]) -> None:
    """Curves are below the name of the stage, and its parameters go with them."""
    trained = {node.name: node.params for _, graph in built for node in graph.stages() if hasattr(node.params, "parameters")}
    for stage in ("model_train", "sor3d_train", "sor3d_pretrain", "boxes_train", "hands_train", "held_train", "scorer_train",
                  "hand_imitation", "rl_grasp_refinement", "grasp_student"):  # fmt: skip
        params = trained[f"record_{stage}"]
        assert params.stage == stage and stage in dict(params.parameters), stage
