"""Box detector of single pictures that SOR3D-AFF is compared with, after AffordanceNet: encoder, boxes, a mask in each box.

Boxes are left, top, right, bottom as shares of the picture's sides. Detector training needs labels only: the true box of an object
is the extent of its affordances.
"""

from __future__ import annotations

from pathlib import Path
from typing import NamedTuple

import numpy as np
import torch
from torch import Tensor, nn
from torch.nn.functional import avg_pool2d, binary_cross_entropy_with_logits, cross_entropy, grid_sample, interpolate, softplus

from afford.rgbd.model import checkpoint
from afford.rgbd.model.config import BoxesParams, Sor3dConfig
from afford.rgbd.model.layers import Encoder, conv_block, conv_stack, init_xavier
from afford.rgbd.model.model_inputs import InputBatch, to_batch
from afford.rgbd.model.predictor import PicturePrediction, PicturePredictor, middle_square, picture_input
from schemas.interaction import BACKGROUND, StaticSample

FORMAT = "afford-boxes-1"
ALIGNED = 14
"""side of the aligned features of a box; masks are twice as large"""
MAX_BOXES, NMS_IOU, MIN_SCORE = 5, 0.5, 0.5
"""maximum number of proposals of a picture; IoU above which the less likely of two proposals is dropped (NMS); score below which
all proposals but the best are dropped"""


class DetectorFeatures(NamedTuple):
    """Features, objectness and box proposals of n pictures, before masks."""

    features: Tensor
    """(n, c, h, w) at a quarter of the picture"""
    thing: Tensor
    """(n, h, w) logits of objectness: the cell is in the middle of an object"""
    box: Tensor
    """(n, 4, h, w) box proposal of each cell"""


class BoxDetector(nn.Module):
    """Detector of the last frame of its input; it uses depth, widths, norm and size of the config."""

    def __init__(self, config: Sor3dConfig) -> None:
        super().__init__()
        self.config = config
        *_, quarter, eighth = config.widths
        self.encoder = Encoder(4 if config.depth else 3, config.widths, config.norm)
        self.lateral, self.top = nn.Conv2d(quarter, eighth, 1), nn.Conv2d(eighth, eighth, 1)
        self.box = nn.Sequential(conv_stack([eighth] * 3, config.norm), nn.Conv2d(eighth, 5, 1))
        self.inside = conv_stack([eighth] * 4, config.norm)
        self.masks = nn.Sequential(conv_block(eighth, eighth, config.norm), nn.Conv2d(eighth, config.labels, 1))

    def forward(self, frames: InputBatch) -> DetectorFeatures:
        """Encode the last frames of n sequences and propose boxes."""
        appearance = frames.appearance[:, -1] if self.config.depth else frames.appearance[:, -1, :3]
        *_, quarter, eighth = self.encoder(appearance)
        size = (quarter.shape[-2], quarter.shape[-1])
        features = self.lateral(quarter) + interpolate(self.top(eighth), size, mode="nearest")
        found = self.box(features)
        return DetectorFeatures(features, found[:, 0], _boxes(softplus(found[:, 1:])))

    def affordances(self, features: Tensor, boxes: Tensor) -> Tensor:
        """Class logits (n, 10, 28, 28) inside one box of each picture."""
        found: Tensor = self.masks(interpolate(self.inside(roi_align(features, boxes, ALIGNED)), scale_factor=2.0, mode="nearest"))
        return found


def _boxes(reach: Tensor) -> Tensor:
    """Boxes from the distances of their left, top, right and bottom sides to each cell's centre."""
    height, width = reach.shape[-2:]
    y = ((torch.arange(height, device=reach.device) + 0.5) / height)[:, None].expand(height, width)
    x = ((torch.arange(width, device=reach.device) + 0.5) / width).expand(height, width)
    return torch.stack([x - reach[:, 0], y - reach[:, 1], x + reach[:, 2], y + reach[:, 3]], 1)


def nms_proposals(seen: DetectorFeatures, picture: int) -> Tensor:
    """Non-maximum suppression: boxes (k, 4) of one picture, k >= 1, most likely first."""
    chance, boxes = seen.thing[picture].flatten().sigmoid(), seen.box[picture].flatten(1).T
    kept: list[Tensor] = []
    for n in chance.argsort(descending=True, stable=True).tolist():
        if kept and (len(kept) == MAX_BOXES or chance[n] < MIN_SCORE):
            break
        if all(float(box_iou(boxes[n], other)) <= NMS_IOU for other in kept):
            kept.append(boxes[n])
    return torch.stack(kept)


def box_iou(a: Tensor, b: Tensor) -> Tensor:
    """Intersection over union of boxes (..., 4)."""
    both = (torch.minimum(a[..., 2:], b[..., 2:]) - torch.maximum(a[..., :2], b[..., :2])).clamp(min=0).prod(-1)
    return both / ((a[..., 2:] - a[..., :2]).prod(-1) + (b[..., 2:] - b[..., :2]).prod(-1) - both).clamp(min=1e-9)


def paste_masks(model: BoxDetector, features: Tensor, boxes: Tensor, size: tuple[int, int]) -> Tensor:
    """Class probabilities (10, h, w) of a picture from the masks inside its boxes (k, 4), most likely box on top.

    `features` are (1, c, h', w'). Pixels outside all boxes are background.
    """
    inside = model.affordances(features.expand(len(boxes), -1, -1, -1), boxes).softmax(1)
    maps, where = paste_into_image(inside, boxes, *size)
    whole = torch.zeros_like(maps[0])
    whole[BACKGROUND] = 1
    for plane, mask in zip(reversed(maps), reversed(where), strict=True):
        whole = torch.where(mask, plane, whole)
    return whole


def build(config: Sor3dConfig, seed: int) -> BoxDetector:
    """Build a detector with Xavier weights from `seed`."""
    with torch.random.fork_rng(devices=[]):
        torch.manual_seed(seed)
        model = BoxDetector(config)
        init_xavier(model)
    return model


def load(folder: Path) -> BoxDetector:
    """Load a trained detector in evaluation mode. ValueError when the files are damaged or of another model."""
    model = build(checkpoint.read_config(folder, FORMAT), 0)
    checkpoint.load_weights(model, folder)
    return model.eval()


SAMPLES = 2
"""bilinear samples per bin and axis"""


def roi_align(features: Tensor, boxes: Tensor, size: int) -> Tensor:
    """RoIAlign (He et al. 2017): features (n, c, h, w) and a box of each (n, 4) -> (n, c, size, size)."""
    steps = (torch.arange(size * SAMPLES, device=boxes.device) + 0.5) / (size * SAMPLES)
    x, y = (boxes[:, k, None] + (boxes[:, k + 2, None] - boxes[:, k, None]) * steps for k in (0, 1))
    grid = torch.stack(torch.broadcast_tensors(x[:, None, :], y[:, :, None]), -1)
    sampled = grid_sample(features, 2 * grid - 1, mode="bilinear", padding_mode="border", align_corners=False)
    return avg_pool2d(sampled, SAMPLES)


def labels_inside(label: Tensor, boxes: Tensor, size: int) -> Tensor:
    """Crop labels (n, h, w) to boxes: (n, size, size), the nearest pixel to each bin's centre."""
    steps = (torch.arange(size, device=boxes.device) + 0.5) / size
    x, y = (boxes[:, k, None] + (boxes[:, k + 2, None] - boxes[:, k, None]) * steps for k in (0, 1))
    column = (x * label.shape[2]).long().clamp(0, label.shape[2] - 1)
    row = (y * label.shape[1]).long().clamp(0, label.shape[1] - 1)
    return label[torch.arange(len(label), device=label.device)[:, None, None], row[:, :, None], column[:, None, :]]


def paste_into_image(maps: Tensor, boxes: Tensor, height: int, width: int) -> tuple[Tensor, Tensor]:
    """Paste maps (n, c, s, s) of boxes (n, 4) into (n, c, height, width); also returns the mask of pixels inside."""
    x = ((torch.arange(width, device=boxes.device) + 0.5) / width - boxes[:, :1]) / (boxes[:, 2:3] - boxes[:, :1])
    y = ((torch.arange(height, device=boxes.device) + 0.5) / height - boxes[:, 1:2]) / (boxes[:, 3:] - boxes[:, 1:2])
    grid = torch.stack(torch.broadcast_tensors(x[:, None, :], y[:, :, None]), -1)
    inside = ((grid > 0) & (grid < 1)).all(-1)
    return grid_sample(maps, 2 * grid - 1, mode="bilinear", padding_mode="border", align_corners=False), inside


MARGIN = 0.1
"""margin of a true box on each side, as a share of the extent of the labels"""
MIDDLE = 0.5
"""central share of a box whose cells propose it"""


def label_boxes(label: Tensor) -> tuple[Tensor, Tensor]:
    """True boxes from labels (n, h, w): box (n, 4) of each picture with a margin, and (n,) bool for pictures with labels.

    The box of a picture without labels is the whole picture.
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


def detector_losses(model: BoxDetector, seen: DetectorFeatures, label: Tensor) -> dict[str, Tensor]:
    """Compute the detector's losses by name.

    thing: cross-entropy of cells in the middle of the box against all others, with equal weight for both kinds. box: -log IoU
    of the proposals of those cells. mask: cross-entropy inside the true box and inside the model's best proposal. total: their
    sum.
    """
    true, known = label_boxes(label)
    middle = _middle(true, seen.thing.shape[-2:]) & known[:, None, None]
    each = binary_cross_entropy_with_logits(seen.thing, middle.float(), reduction="none")
    thing = _masked_mean(each, middle) + _masked_mean(each, ~middle)
    fit = box_iou(seen.box.permute(0, 2, 3, 1), true[:, None, None])
    box = _masked_mean(-fit.clamp(min=1e-3).log(), middle)
    best = seen.thing.flatten(1).argmax(1)
    own = seen.box.flatten(2)[torch.arange(len(label)), :, best].detach()
    mask = torch.stack([_inside(model, seen, label, boxes, known) for boxes in (true, own)]).mean()
    return {"total": thing + box + mask, "thing": thing, "box": box, "mask": mask}


def _inside(model: BoxDetector, seen: DetectorFeatures, label: Tensor, boxes: Tensor, known: Tensor) -> Tensor:
    logits = model.affordances(seen.features, boxes)
    each = cross_entropy(logits, labels_inside(label, boxes, 2 * ALIGNED), reduction="none")
    return _masked_mean(each, known[:, None, None].expand_as(each))


def _middle(boxes: Tensor, size: torch.Size) -> Tensor:
    """(n, h, w) bool: cells with their centre in the middle of the box, and always the cell of the box's centre."""
    inside = []
    for k, count in ((1, size[0]), (0, size[1])):
        at = (torch.arange(count, device=boxes.device) + 0.5) / count
        centre, half = (boxes[:, k] + boxes[:, k + 2]) / 2, (boxes[:, k + 2] - boxes[:, k]) / 2
        inside.append((at - centre[:, None]).abs() <= torch.maximum(MIDDLE * half, torch.full_like(half, 0.5 / count))[:, None])
    return inside[0][:, :, None] & inside[1][:, None, :]


def _masked_mean(values: Tensor, where: Tensor) -> Tensor:
    """Mean over the marked values; 0 without any."""
    return (values * where).sum() / where.sum().clamp(min=1)


def picture_predictor(folder: Path, device: str, params: BoxesParams) -> PicturePredictor:
    """Predictor of pictures with the detector in `folder`; with `params.true_boxes` the boxes are those of the label."""
    model = load(folder).to(device)

    @torch.inference_mode()
    def predict(sample: StaticSample) -> PicturePrediction:
        label = torch.from_numpy(np.ascontiguousarray(middle_square(sample.label)).astype(np.int64))[None]
        found = model(to_batch([picture_input(sample, model.config.size_px)], model.config).to(device))
        boxes = label_boxes(label)[0].to(device) if params.true_boxes else nms_proposals(found, 0)
        probability = paste_masks(model, found.features, boxes, (label.shape[1], label.shape[2]))
        return PicturePrediction(probability.cpu().numpy(), np.zeros((0, 0), np.float32), label.shape[1] * boxes.cpu().numpy())

    return predict
