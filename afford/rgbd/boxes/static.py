"""Pictures with affordance labels -> what a detector says of each, from its own boxes or from true ones."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import torch

from afford.rgbd.boxes import BoxesParams
from afford.rgbd.boxes.losses import extents
from afford.rgbd.boxes.model import load, painted, proposals
from afford.rgbd.model.inputs import frames
from afford.rgbd.model.static import Teller, Told, seen, square
from schemas.interaction import StaticSample


def teller(folder: Path, device: str, params: BoxesParams) -> Teller:
    """Predictions of the model in `folder`; with `params.true_boxes` the boxes are those of the label."""
    model = load(folder).to(device)

    @torch.inference_mode()
    def tell(sample: StaticSample) -> Told:
        label = torch.from_numpy(np.ascontiguousarray(square(sample.label)).astype(np.int64))[None]
        found = model(frames([seen(sample, model.config.size_px)], model.config).to(device))
        boxes = extents(label)[0].to(device) if params.true_boxes else proposals(found, 0)
        probability = painted(model, found.features, boxes, (label.shape[1], label.shape[2]))
        return Told(probability.cpu().numpy(), np.zeros((0, 0), np.float32), label.shape[1] * boxes.cpu().numpy())

    return tell
