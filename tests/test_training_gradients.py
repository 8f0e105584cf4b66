"""Laws of the gradients of a step: parts computed together are the parts computed one by one."""

from __future__ import annotations

import pytest
import torch
from torch import nn

from afford.training.gradients import one_by_one, together
from afford.training.ranks import ALONE


def net() -> nn.Module:
    torch.manual_seed(0)
    return nn.Sequential(nn.Conv2d(3, 8, 3), nn.ReLU(), nn.Flatten(), nn.Linear(8 * 36, 5))


@pytest.mark.parametrize("parts", [1, 2, 3])
def test_together_is_one_by_one(parts: int) -> None:
    """The same gradients to the bit and the same scalars, whatever the number of threads; an unused part gets none."""
    batches = [torch.randn(4, 3, 8, 8, generator=torch.Generator().manual_seed(n)) for n in range(parts)]
    found = []
    for threads in (0, 1, 2, 3):
        model = net()
        model.append(nn.Identity()).register_parameter("unused", nn.Parameter(torch.ones(2)))

        def loss(batch: torch.Tensor, model: nn.Module = model) -> dict[str, torch.Tensor]:
            return {"total": model(batch).square().mean()}

        scalars = together(loss, batches, model, threads) if threads else one_by_one(loss, batches, model, ALONE)
        assert model.get_parameter("unused").grad is None
        found.append([each["total"].item() for each in scalars] + [p.grad.numpy().tobytes() for p in model[:4].parameters()])
    assert found[0] == found[1] == found[2] == found[3]


def test_a_failure_in_a_thread_is_the_failure_of_the_step() -> None:
    """Nothing is swallowed."""

    def loss(batch: int) -> dict[str, torch.Tensor]:
        raise ZeroDivisionError(str(batch))

    with pytest.raises(ZeroDivisionError, match="4"):
        together(loss, [4, 5], net(), 2)
