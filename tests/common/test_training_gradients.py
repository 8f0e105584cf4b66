"""Laws of the gradients of a step: parts computed together are the parts computed one by one."""

from __future__ import annotations

from collections.abc import Iterator

import pytest
import torch
from torch import nn

from afford.training.gradients import one_by_one, together
from afford.training.ranks import ALONE
from afford.training.repeatable import repeatable


@pytest.fixture(autouse=True)
def one_thread() -> Iterator[None]:
    """Bytes are promised for one number of threads inside an operation."""
    with repeatable(1, "cpu"):
        yield


def net() -> nn.Module:
    torch.manual_seed(0)
    return nn.Sequential(nn.Conv2d(3, 8, 3), nn.ReLU(), nn.Conv2d(8, 8, 3), nn.Flatten(), nn.Linear(8 * 16, 5))


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
        found.append([each["total"].item() for each in scalars] + [p.grad.numpy().tobytes() for p in model[:5].parameters()])
    assert found[0] == found[1] == found[2] == found[3]


def test_gradients_lie_in_memory_as_the_parameters_do() -> None:
    """Also where pictures are channels last: a fused optimiser goes through both in step, so that its steps are the same."""
    seeded = (torch.Generator().manual_seed(n) for n in range(2))
    batches = [torch.randn(4, 3, 8, 8, generator=g).contiguous(memory_format=torch.channels_last) for g in seeded]
    made = []
    for threads in (0, 2):
        model = net()
        optimiser = torch.optim.AdamW(model.parameters(), 0.1, fused=True)
        for _ in range(3):
            optimiser.zero_grad(set_to_none=True)

            def loss(batch: torch.Tensor, model: nn.Module = model) -> dict[str, torch.Tensor]:
                return {"total": model(batch).square().mean()}

            if threads:
                together(loss, batches, model, threads)
            else:
                one_by_one(loss, batches, model, ALONE)
            assert all(p.grad is not None and p.grad.stride() == p.stride() for p in model.parameters())
            optimiser.step()
        made.append(b"".join(p.detach().numpy().tobytes() for p in model.parameters()))
    assert made[0] == made[1]


def test_a_failure_in_a_thread_is_the_failure_of_the_step() -> None:
    """Nothing is swallowed."""

    def loss(batch: int) -> dict[str, torch.Tensor]:
        raise ZeroDivisionError(str(batch))

    with pytest.raises(ZeroDivisionError, match="4"):
        together(loss, [4, 5], net(), 2)
