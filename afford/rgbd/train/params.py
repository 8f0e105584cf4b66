"""Parameters that trainings on RGB-D interactions share: input size, sampling and augmentation."""

from __future__ import annotations

from dataclasses import dataclass

from afford.training.params import Optimisation


@dataclass(frozen=True)
class InteractionTraining(Optimisation):
    """Optimisation, input and augmentation."""

    variant: str = "small"
    """small (from scratch, on a CPU) or paper"""
    row: str = "rgbd_attention_flow3d"
    """parts of the model: rgb, rgb_attention, rgb_attention_flow2d, rgbd, rgbd_attention, rgbd_attention_flow3d"""
    height_px: int = 72
    """height and width of the model's input"""
    balance: float = 0.0
    """0: samples uniformly; 1: every affordance of every object type, or every action, equally often"""
    flip_share: float = 0.5
    """share of samples that are mirrored"""
    crop_share: float = 0.8
    """share of samples that are cropped"""
    colour_share: float = 0.5
    """share of samples that are recoloured"""
