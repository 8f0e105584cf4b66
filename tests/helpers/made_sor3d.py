"""Settings with which the targets of SOR3D-AFF take seconds: a few small sequences, hardly learned from."""

from __future__ import annotations

from dataclasses import replace

from maps.settings import Settings

STEPS = {"steps": 2, "warmup": 1, "validate_every": 2, "batch": 2, "accumulate": 1, "height_px": 32, "val_samples": 2}
FEW = Settings.of(
    interaction_plan=replace(Settings.synthetic.interaction_plan, train=4, val=2),
    interaction_render=replace(Settings.synthetic.interaction_render, height_px=48, frames=4, supersample=1),
    action_read=replace(Settings.rgbd.action_read, size_px=32),
    action_pack=replace(Settings.rgbd.action_pack, val_share=0.5),
    sor3d_pretrain=replace(Settings.rgbd.sor3d_pretrain, **STEPS),
    sor3d_train=replace(Settings.rgbd.sor3d_train, **STEPS),
    sor3d_evaluate=replace(Settings.rgbd.sor3d_evaluate, shown=1),
    sor3d_report=replace(Settings.rgbd.sor3d_report, rows=("rgb", "rgbd_attention_flow3d", "pretrained"), seeds=1,
                         resamples=20))  # fmt: skip
