"""Report the scores of SOR3D-AFF's model, or of the rows of its ablation, next to the paper's figures.

Reads   the planned Recipes; InteractionScores of the evaluated ones, named as their recipe; FlowScores of sequences with ground
        truth
Writes  metrics.json (video.iou, static.f, flow.epe_ratio, action.accuracy, ...; of an ablation <row>.video.iou, ...), report.md,
        scores.json (per seed), sheet.png
Method  pixels pooled over sequences, then a mean over categories (docs/rgbd/sor3d.md); percentile intervals by resampling
        sequences; a row is the mean over its seeds, with the sample standard deviation
Fails   without scores, or when a score belongs to no recipe
Paper   SOR3D-AFF, tables of results and ablations
"""

from __future__ import annotations

from dataclasses import dataclass

from schemas.files import FileTree
from schemas.interaction import FlowScore, InteractionScores
from schemas.spec import Context
from schemas.training import Recipe

LIBRARIES = ("numpy", "opencv-python-headless", "pillow", "matplotlib", "blake3")
THREADS = 1
MEMORY_GIB = 0.5


@dataclass(frozen=True)
class Params:
    """Parameters of `sor3d_report`."""

    rows: tuple[str, ...] = ("rgb", "rgb_attention", "rgb_attention_flow2d", "rgbd", "rgbd_attention", "rgbd_attention_flow3d",
                             "pretrained")
    """sor3d_ablation: rows that are trained; pretrained is the whole model on an encoder that was pre-trained on actions"""
    seeds: int = 3
    """sor3d_ablation: trainings of each row, with the seeds first_seed, first_seed + 1, ..."""
    first_seed: int = 0
    """sor3d_ablation: first seed; several machines use different ones, and their scores.json can be combined"""
    steps: int = 0
    """sor3d_ablation: steps of each training; 0: those of sor3d_train"""
    pretrained: bool = False
    """sor3d: pre-train the encoder on actions"""
    actions: str = ""
    """folder of UTKinect-Action3D for the pre-training; '': the sequences themselves"""
    resamples: int = 1000
    """bootstrap resamples of the intervals"""
    seed: int = 0
    """seed of the intervals"""
    ablation: bool = False
    """report figures by row; set by the target"""


def run(recipes: tuple[Recipe, ...], scores: tuple[InteractionScores, ...], params: Params, ctx: Context,
        more: tuple[InteractionScores, ...] = (), flows: tuple[FlowScore, ...] = ()) -> FileTree:  # fmt: skip
    """Write one report; `more` are scores of a second group of trainings."""
    from afford.common.files import empty_folder, tree
    from afford.rgbd.evaluate.report import ReportInput, write_report

    root = empty_folder(ctx.scratch / "report")
    found = ReportInput(recipes, (*scores, *more), flows)
    write_report(root, found, params.ablation, params.resamples, params.seed)
    return tree("sor3d", root)
