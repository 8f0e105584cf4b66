"""Every module of schemas. The list is part of no key: a schema may move to another module, and modules may become one."""

from __future__ import annotations

from schemas import (
    affordance,
    benchmark,
    candidates,
    clip,
    comparison,
    episodes,
    files,
    grasp,
    grasp_task,
    hand,
    hand_lessons,
    interaction,
    interaction_scores,
    masks,
    mesh,
    motion,
    negative,
    object_list,
    positive,
    prediction,
    report,
    sample,
    scene,
    scene_flow,
    still,
    training,
    truth,
    video,
)

MODULES = (affordance, benchmark, candidates, clip, comparison, episodes, files, grasp, grasp_task, hand, hand_lessons,
           interaction, interaction_scores, masks, mesh, motion, negative, object_list, positive, prediction, report, sample,
           scene, scene_flow, still, training, truth, video)  # fmt: skip
