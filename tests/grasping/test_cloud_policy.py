"""Network of the student: published sizes, invariance to the order of points, dependence on every input."""

from __future__ import annotations

import torch
from torch import Tensor, nn

from afford.grasping.rl.cloud_policy import CloudConfig, CloudPolicy, paper_config


def seen(n: int = 3, points: int = 64) -> tuple[Tensor, Tensor, Tensor]:
    generator = torch.Generator().manual_seed(0)
    return tuple(torch.randn(n, *shape, generator=generator) for shape in ((9,), (points, 3), (10, 3)))  # type: ignore[return-value]


def model() -> CloudPolicy:
    torch.manual_seed(0)
    return CloudPolicy(CloudConfig(9, 4)).eval()


def test_paper_sizes() -> None:
    """PointNets 128, 256 (maximum and mean), 256, 128; two blocks of width 128 with 4 heads, dropout 0.1; MLP 1024-1024-512-512."""
    made = CloudPolicy(paper_config(220, 24))
    assert made.config.dropout == 0.1 and len(made.mixer.layers) == 2
    for net in (made.hand, made.object, made.all, made.negative):
        linear = [layer for layer in net.modules() if isinstance(layer, nn.Linear)]
        assert [layer.out_features for layer in linear] == [128, 128, 256, 256, 128]
    block = made.mixer.layers[0]
    assert isinstance(block, nn.TransformerEncoderLayer)
    assert (block.self_attn.embed_dim, block.self_attn.num_heads, block.dropout.p) == (128, 4, 0.1)
    widths = [layer.out_features for layer in made.actor if isinstance(layer, nn.Linear)]
    assert widths == [1024, 1024, 512, 512, 24]
    assert made.eval()(torch.zeros(2, 220), torch.zeros(2, 1024, 3), torch.zeros(2, 100, 3)).shape == (2, 24)


def test_order_of_points_does_not_matter() -> None:
    """Permutations within hand, object or N_t change nothing; swapping hand and object does."""
    net, (robot, cloud, N) = model(), seen()
    order = torch.cat([torch.randperm(32), 32 + torch.randperm(32)])
    assert torch.allclose(net(robot, cloud, N), net(robot, cloud[:, order], N[:, torch.randperm(10)]), atol=1e-6)
    assert not torch.allclose(net(robot, cloud, N), net(robot, cloud.roll(32, dims=1), N), atol=1e-6)


def test_action_depends_on_every_input() -> None:
    """The gradient of each input is not zero."""
    parts = [part.requires_grad_() for part in seen()]
    model()(*parts).square().sum().backward()
    assert all(part.grad is not None and part.grad.abs().sum() > 0 for part in parts)


def test_untrained_student_hardly_moves() -> None:
    assert model()(*seen()).abs().max() < 0.1
