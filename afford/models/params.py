"""Parameters of every backend that runs a pretrained model."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class Pretrained:
    """Which weights, on which device, as which type of numbers."""

    model: str = ""
    """local folder or file, or hub id, of the weights"""
    device: str = "cpu"
    """cpu, cuda or cuda:N; bytes differ between kinds of device"""
    dtype: str = "float32"
    """float32, bfloat16 or float16"""
