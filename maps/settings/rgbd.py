"""Parameters of SOR3D-AFF: RGB-D interactions, the model of sequences, the detector of single pictures."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from stages.recording import interaction_record
from stages.rgbd import (
    action_pack,
    action_read,
    boxes_train,
    interaction_pack,
    interaction_read,
    scene_flow,
    sor3d_evaluate,
    sor3d_pretrain,
    sor3d_report,
    sor3d_train,
    static_evaluate,
    static_read,
)


@dataclass(frozen=True)
class Rgbd:
    """Parameters of every stage of the system, by stage."""

    interaction_read: interaction_read.Params = interaction_read.Params()
    interaction_pack: interaction_pack.Params = interaction_pack.Params(licence="apache-2.0")
    interaction_record: interaction_record.Params = interaction_record.Params()
    scene_flow: scene_flow.Params = scene_flow.Params()
    action_read: action_read.Params = action_read.Params()
    action_pack: action_pack.Params = action_pack.Params()
    sor3d_pretrain: sor3d_pretrain.Params = sor3d_pretrain.Params()
    sor3d_train: sor3d_train.Params = sor3d_train.Params()
    sor3d_evaluate: sor3d_evaluate.Params = sor3d_evaluate.Params()
    sor3d_report: sor3d_report.Params = sor3d_report.Params()
    static_read: static_read.Params = static_read.Params()
    static_evaluate: static_evaluate.Params = static_evaluate.Params()
    boxes_train: boxes_train.Params = boxes_train.Params()


PRESETS: dict[tuple[str, str, str], Any] = {
    ("sor3d_train", "variant", "paper"): sor3d_train.PAPER,
    ("sor3d_pretrain", "variant", "paper"): sor3d_pretrain.PAPER,
}
"""(stage, parameter, value) -> defaults of all parameters of the stage when the parameter has this value"""
