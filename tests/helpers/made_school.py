"""Settings with which the targets of grasping take seconds: one screwdriver to learn on, one soldering iron never seen."""

from __future__ import annotations

from dataclasses import replace

from maps.settings import Settings

SCHOOL = Settings.of(
    object_plan=replace(Settings.synthetic.object_plan, categories=("screwdriver", "soldering_iron"), train_per_category=1,
                        val_per_category=1, seen_per_category=1, unseen_per_category=1),
    view_render=replace(Settings.surface.view_render, size_px=64, directions=32, share=0.0),
    scorer_train=replace(Settings.surface.scorer_train, steps=2, objects=1, candidates=2, warmup=1),
    object_solids=replace(Settings.grasping.object_solids, points=128, hulls=8),
    grasp_tasks=replace(Settings.grasping.grasp_tasks, within_m=1.0),
    grasp_targets=replace(Settings.grasping.grasp_targets, places=2),
    hand_imitation=replace(Settings.grasping.hand_imitation, cloning=2, alone=1, worlds=2, hidden=(16,), proofs=0),
    rl_grasp_refinement=replace(Settings.grasping.rl_grasp_refinement, updates=2, worlds=2, iterations=20),
    grasp_student=replace(Settings.grasping.grasp_student, rounds=1, worlds=1, updates=2, batch=8, views=1, size_px=16, points=32),
    grasp_evaluate=replace(Settings.grasping.grasp_evaluate, episodes=1, iterations=20, traces=1),
    imitation_evaluate=replace(Settings.grasping.imitation_evaluate, places=1, iterations=20),
    grasp_two_tasks=replace(Settings.grasping.grasp_two_tasks, rounds=1, iterations=20, width=64, height=48, supersample=1),
    grasp_record=replace(Settings.grasping.grasp_record, width=64, height=48, supersample=1),
    policy_record=replace(Settings.grasping.policy_record, width=64, height=48),
    grasp_report=replace(Settings.grasping.grasp_report, rows=("teacher", "student"), seeds=1, engines=("mujoco",)))  # fmt: skip
