"""What a detector learns from labels alone: the box of a thing is the extent of what it affords."""

from __future__ import annotations

import torch
from torch import Tensor
from torch.nn.functional import binary_cross_entropy_with_logits, cross_entropy

from afford.rgbd.boxes.align import labels_inside
from afford.rgbd.boxes.model import ALIGNED, Boxes, Seen, overlap
from schemas.interaction import BACKGROUND

MARGIN = 0.1
"""a true box is so much wider than the extent, as a share of it, on each side"""
MIDDLE = 0.5
"""share of a box, around its middle, whose cells propose it"""


def extents(label: Tensor) -> tuple[Tensor, Tensor]:
    """Labels (n, h, w) -> the box (n, 4) of each picture, in shares, with a margin, and whether there is anything (n,) bool. Where
    nothing is, the box is the whole picture.
    """
    boxes = torch.tensor([0.0, 0.0, 1.0, 1.0]).repeat(len(label), 1)
    height, width = label.shape[1:]
    for n, one in enumerate(label.cpu() != BACKGROUND):
        rows, columns = one.any(1).nonzero()[:, 0], one.any(0).nonzero()[:, 0]
        if len(rows):
            corner = torch.tensor([columns[0] / width, rows[0] / height, (columns[-1] + 1) / width, (rows[-1] + 1) / height])
            more = MARGIN * (corner[2:] - corner[:2])
            boxes[n] = corner + torch.cat([-more, more])
    return boxes.to(label.device), (label != BACKGROUND).flatten(1).any(1)


def losses(model: Boxes, seen: Seen, label: Tensor) -> dict[str, Tensor]:
    """thing: cross-entropy of cells in the middle of the box against all others, both kinds weighing alike; box: -log IoU of what
    those cells propose; mask: cross-entropy inside the true box and inside the box that the model proposes itself; total: sum.
    """
    true, known = extents(label)
    middle = _middle(true, seen.thing.shape[-2:]) & known[:, None, None]
    each = binary_cross_entropy_with_logits(seen.thing, middle.float(), reduction="none")
    thing = _mean(each, middle) + _mean(each, ~middle)
    fit = overlap(seen.box.permute(0, 2, 3, 1), true[:, None, None])
    box = _mean(-fit.clamp(min=1e-3).log(), middle)
    best = seen.thing.flatten(1).argmax(1)
    own = seen.box.flatten(2)[torch.arange(len(label)), :, best].detach()
    mask = torch.stack([_inside(model, seen, label, boxes, known) for boxes in (true, own)]).mean()
    return {"total": thing + box + mask, "thing": thing, "box": box, "mask": mask}


def _inside(model: Boxes, seen: Seen, label: Tensor, boxes: Tensor, known: Tensor) -> Tensor:
    said = model.affordances(seen.features, boxes)
    each = cross_entropy(said, labels_inside(label, boxes, 2 * ALIGNED), reduction="none")
    return _mean(each, known[:, None, None].expand_as(each))


def _middle(boxes: Tensor, size: torch.Size) -> Tensor:
    """(n, h, w) bool: cells whose centre lies in the middle of the box; the cell of its centre in any case."""
    inside = []
    for k, count in ((1, size[0]), (0, size[1])):
        at = (torch.arange(count, device=boxes.device) + 0.5) / count
        centre, half = (boxes[:, k] + boxes[:, k + 2]) / 2, (boxes[:, k + 2] - boxes[:, k]) / 2
        inside.append((at - centre[:, None]).abs() <= torch.maximum(MIDDLE * half, torch.full_like(half, 0.5 / count))[:, None])
    return inside[0][:, :, None] & inside[1][:, None, :]


def _mean(values: Tensor, where: Tensor) -> Tensor:
    """Mean of what is marked; 0 when nothing is."""
    return (values * where).sum() / where.sum().clamp(min=1)
