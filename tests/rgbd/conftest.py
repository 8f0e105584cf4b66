"""Threads of the tests of `rgbd`: small tensors are faster on one thread, above all when tests run in parallel."""

from __future__ import annotations

from collections.abc import Iterator

import pytest
import torch

from stages.rgbd import boxes_train, sor3d_pretrain, sor3d_train


@pytest.fixture(scope="package", autouse=True)
def one_thread() -> Iterator[None]:
    """Run torch, and the stages that train, on one thread."""
    before = torch.get_num_threads()
    torch.set_num_threads(1)
    with pytest.MonkeyPatch.context() as patch:
        for stage in (boxes_train, sor3d_pretrain, sor3d_train):
            patch.setattr(stage, "THREADS", 1)
        yield
    torch.set_num_threads(before)
