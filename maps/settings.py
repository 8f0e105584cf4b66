"""The parameters of every stage, and where the data come from."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any, NamedTuple

from maps.from_above import FITTED, MOTION, RECORDED
from schemas.files import FileTree
from schemas.scene import RenderedClip, SceneSpec
from stages.extraction import (
    affordance_intersect,
    dataset_pack,
    extraction_report,
    extraction_score,
    frame_decode,
    hand_detect,
    hand_inpaint,
    hands_train,
    key_thin,
    mask_densify,
    narration_labelling,
    object_completion,
    sample_assemble,
    source_read,
)
from stages.grasping import (
    grasp_evaluate,
    grasp_judge,
    grasp_report,
    grasp_student,
    grasp_targets,
    grasp_tasks,
    grasp_two_tasks,
    hand_imitation,
    hand_model,
    hand_retarget,
    imitation_evaluate,
    motion_read,
    motion_report,
    motion_synthesise,
    object_solids,
    rl_grasp_refinement,
)
from stages.grasping.hand_retarget import Params as Retarget
from stages.recording import grasp_record, interaction_record
from stages.rgbd import (
    action_pack,
    action_read,
    interaction_pack,
    interaction_read,
    scene_flow,
    sor3d_evaluate,
    sor3d_report,
    static_evaluate,
    static_read,
)
from stages.surface import (
    mask_propose,
    mask_score,
    mesh_read,
    mesh_texture,
    negative_affordance_projection,
    negative_affordance_report,
    negative_affordance_score,
    part_describe,
    part_lessons,
    positive_affordance_projection,
    scorer_train,
    view_render,
)
from stages.synthetic import (
    benchmark_plan,
    hand_lessons,
    hand_plan,
    interaction_plan,
    interaction_render,
    object_build,
    object_plan,
    scene_render,
    still_render,
    still_sample,
    train_plan,
)
from stages.twohands import ablation_report, baseline_cases, benchmark, benchmark_set, model_train, predict_cases, score_cases
from stages.twohands.model_train import SOR3D, SOR3D_PAPER, SOR3D_PAPER_ACTIONS
from stages.twohands.model_train import Params as Training


@dataclass(frozen=True)
class Settings:
    """The parameters of every stage, by stage."""

    scene_render: scene_render.Params = scene_render.Params()
    source_read: source_read.Params = source_read.Params()
    frame_decode: frame_decode.Params = frame_decode.Params()
    hand_detect: hand_detect.Params = hand_detect.Params()
    mask_densify: mask_densify.Params = mask_densify.Params()
    hand_inpaint: hand_inpaint.Params = hand_inpaint.Params()
    object_completion: object_completion.Params = object_completion.Params()
    affordance_intersect: affordance_intersect.Params = affordance_intersect.Params()
    narration_labelling: narration_labelling.Params = narration_labelling.Params()
    sample_assemble: sample_assemble.Params = sample_assemble.Params()
    dataset_pack: dataset_pack.Params = dataset_pack.Params()
    key_thin: key_thin.Params = key_thin.Params()
    extraction_score: extraction_score.Params = extraction_score.Params()
    extraction_report: extraction_report.Params = extraction_report.Params()
    train_plan: train_plan.Params = train_plan.Params()
    still_render: still_render.Params = still_render.Params()
    still_sample: still_sample.Params = still_sample.Params()
    benchmark_plan: benchmark_plan.Params = benchmark_plan.Params()
    benchmark_set: benchmark_set.Params = benchmark_set.Params()
    model_train: model_train.Params = model_train.Params()
    predict_cases: predict_cases.Params = predict_cases.Params()
    baseline_cases: baseline_cases.Params = baseline_cases.Params()
    score_cases: score_cases.Params = score_cases.Params()
    benchmark: benchmark.Params = benchmark.Params()
    ablation_report: ablation_report.Params = ablation_report.Params()
    object_plan: object_plan.Params = object_plan.Params()
    object_build: object_build.Params = object_build.Params()
    mesh_read: mesh_read.Params = mesh_read.Params()
    mesh_texture: mesh_texture.Params = mesh_texture.Params()
    view_render: view_render.Params = view_render.Params()
    mask_propose: mask_propose.Params = mask_propose.Params()
    part_lessons: part_lessons.Params = part_lessons.Params()
    scorer_train: scorer_train.Params = scorer_train.Params()
    part_describe: part_describe.Params = part_describe.Params()
    mask_score: mask_score.Params = mask_score.Params()
    negative_affordance_projection: negative_affordance_projection.Params = negative_affordance_projection.Params()
    positive_affordance_projection: positive_affordance_projection.Params = positive_affordance_projection.Params()
    negative_affordance_score: negative_affordance_score.Params = negative_affordance_score.Params()
    negative_affordance_report: negative_affordance_report.Params = negative_affordance_report.Params()
    hand_plan: hand_plan.Params = hand_plan.Params()
    hand_lessons: hand_lessons.Params = hand_lessons.Params()
    hands_train: hands_train.Params = hands_train.Params()
    hand_model: hand_model.Params = hand_model.Params()
    object_solids: object_solids.Params = object_solids.Params()
    grasp_tasks: grasp_tasks.Params = grasp_tasks.Params()
    grasp_targets: grasp_targets.Params = grasp_targets.Params()
    motion_synthesise: motion_synthesise.Params = MOTION
    hand_retarget: hand_retarget.Params = FITTED
    motion_read: motion_read.Params = motion_read.Params()
    motion_retarget: Retarget = RECORDED
    motion_report: motion_report.Params = motion_report.Params()
    hand_imitation: hand_imitation.Params = hand_imitation.Params()
    rl_grasp_refinement: rl_grasp_refinement.Params = rl_grasp_refinement.Params()
    grasp_student: grasp_student.Params = grasp_student.Params()
    grasp_evaluate: grasp_evaluate.Params = grasp_evaluate.Params()
    grasp_two_tasks: grasp_two_tasks.Params = grasp_two_tasks.Params()
    imitation_evaluate: imitation_evaluate.Params = imitation_evaluate.Params()
    grasp_judge: grasp_judge.Params = grasp_judge.Params()
    grasp_record: grasp_record.Params = grasp_record.Params()
    grasp_report: grasp_report.Params = grasp_report.Params()
    static_read: static_read.Params = static_read.Params()
    static_evaluate: static_evaluate.Params = static_evaluate.Params()
    boxes_train: Training = replace(SOR3D, backend="boxes", row="rgbd", batch=8, steps=1000, lr=5e-4, bf16=False)
    interaction_record: interaction_record.Params = interaction_record.Params()
    interaction_plan: interaction_plan.Params = interaction_plan.Params()
    interaction_render: interaction_render.Params = interaction_render.Params()
    interaction_read: interaction_read.Params = interaction_read.Params()
    interaction_pack: interaction_pack.Params = interaction_pack.Params(licence="apache-2.0")
    scene_flow: scene_flow.Params = scene_flow.Params()
    action_read: action_read.Params = action_read.Params()
    action_pack: action_pack.Params = action_pack.Params()
    sor3d_pretrain: Training = replace(SOR3D, backend="sor3d_actions", steps=300, validate_every=150)
    sor3d_train: Training = SOR3D
    sor3d_evaluate: sor3d_evaluate.Params = sor3d_evaluate.Params()
    sor3d_report: sor3d_report.Params = sor3d_report.Params()


PRESETS: dict[tuple[str, str, str], Any] = {
    ("sor3d_train", "variant", "paper"): SOR3D_PAPER,
    ("sor3d_pretrain", "variant", "paper"): SOR3D_PAPER_ACTIONS,
}
"""stage, parameter, value -> what all parameters of the stage are where it has this value and nothing else is said"""


class Origin(NamedTuple):
    """Where the videos come from: clips to render, or what is on disk (`truth` is an empty tree where there is none; `bare` videos
    have no masks)."""

    name: str
    specs: tuple[SceneSpec, ...] = ()
    videos: tuple[RenderedClip, ...] = ()
    cases: FileTree | None = None
    predictions: tuple[FileTree, ...] = ()
    dataset: FileTree | None = None
    meshes: tuple[FileTree, ...] = ()
    sequences: tuple[FileTree, ...] = ()
    actions: FileTree | None = None
    pictures: FileTree | None = None
    bare: bool = False
    motions: FileTree | None = None
