"""Mixed precision, where it is quicker."""

from __future__ import annotations

import torch

QUICK = ("amx_bf16", "avx512_bf16", "bf16")
"""instructions of CPUs that multiply bfloat16 (AMX, AVX-512, Arm)"""


def mixed(device: str, wanted: bool) -> torch.autocast:
    """bfloat16 for what is inside, when it is `wanted` and the device has instructions for it. A CPU that has none would only be
    slower, and goes on in single precision.
    """
    kind = torch.device(device).type
    return torch.autocast(kind, torch.bfloat16, wanted and (kind != "cpu" or quick()))


def quick() -> bool:
    """Whether this CPU multiplies bfloat16."""
    found = torch.cpu.get_capabilities()
    return any(found.get(name, False) for name in QUICK)
