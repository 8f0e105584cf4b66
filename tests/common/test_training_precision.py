"""Mixed precision is for devices that are quicker at it: a product is of bfloat16 there, and single elsewhere."""

from __future__ import annotations

import pytest
import torch

from afford.training import precision


@pytest.mark.parametrize(("found", "wanted", "kind"), [
    ({"amx_bf16": True}, True, torch.bfloat16), ({"avx512_bf16": True, "amx_bf16": False}, True, torch.bfloat16),
    ({"bf16": True}, True, torch.bfloat16), ({"avx512_f": True, "avx512_bf16": False}, True, torch.float32),
    ({}, True, torch.float32), ({"amx_bf16": True}, False, torch.float32),
])  # fmt: skip
def test_a_cpu_without_instructions_for_it_stays_single(found: dict[str, bool], wanted: bool, kind: torch.dtype,
                                                        monkeypatch: pytest.MonkeyPatch) -> None:  # fmt: skip
    """Whatever was wanted; and so does one that has them, where it was not."""
    monkeypatch.setattr(torch.cpu, "get_capabilities", lambda: found)
    with precision.mixed("cpu", wanted):
        assert (torch.ones(2, 2) @ torch.ones(2, 2)).dtype == kind
