"""Probability that what a task names is in the picture at all.

A model finds some region for any words. Two things tell that the words do not fit: the regions, whose expected IoU is small where
the model is unsure (`region_threshold`), and the classifier of the image encoder, which sees the named thing nowhere (lite with
classes). Their logistic regression is fitted to right and wrong words for pictures that the training did not show, and is a file
beside the weights. A model without this file answers every question.
"""

from __future__ import annotations

import dataclasses
import json
import math
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from scipy.special import expit, logit
from torch import Tensor, nn

from afford.twohands.model.class_words import named_classes
from afford.twohands.model.interface import TwoHands
from afford.twohands.model.model_folder import PRESENCE_FILE

PRESENCE_FORMAT = "afford-presence-1"
EDGE = 1e-3
"""distance of an expected IoU from 0 and 1"""


@dataclass(frozen=True)
class Presence:
    """Weights of the regression."""

    bias: float
    expected_iou: float
    """weight of the logit of the expected IoU"""
    named: float
    """added for a task that names a thing with a class of ImageNet"""
    seen: float
    """weight of the largest logit of such a thing at any place (`named_things.named_logits`), 0 to 3.5"""
    least: float
    """probability below which there is no region"""

    def probability(self, expected_iou: float, seen: float | None) -> float:
        """Compute the probability that the thing is there; `seen` is None for a task without classes."""
        at = self.bias + self.expected_iou * float(logit(min(max(expected_iou, EDGE), 1 - EDGE)))
        if seen is not None:
            at += self.named + self.seen * seen
        return float(expit(at))


def write_presence(presence: Presence, folder: Path) -> None:
    """Write presence.json into the folder of a model."""
    text = json.dumps({"format": PRESENCE_FORMAT, **dataclasses.asdict(presence)}, indent=1) + "\n"
    (folder / PRESENCE_FILE).write_text(text, encoding="utf-8")


def read_presence(folder: Path) -> Presence | None:
    """Read the file of the model in a folder; None without one. ValueError, one sentence, for another file."""
    path, names = folder / PRESENCE_FILE, [field.name for field in dataclasses.fields(Presence)]
    if not path.is_file():
        return None
    try:
        fields = json.loads(path.read_text(encoding="utf-8"))
        values = [float(fields[name]) for name in names] if fields["format"] == PRESENCE_FORMAT else [math.nan]
    except (OSError, ValueError, LookupError, TypeError, RecursionError):
        values = [math.nan]
    if not all(map(math.isfinite, values)):
        raise ValueError(f'{path}: expected "format": "{PRESENCE_FORMAT}" and the numbers {", ".join(names)}, got something else; '
                         "copy it from the trained model again, or remove it")  # fmt: skip
    return Presence(*values)


class NamedSight:
    """Evidence of the classifier of a model for the things of its last batch; None for a model without one."""

    def __init__(self, model: TwoHands) -> None:
        self._logits: Tensor | None = None
        if model.config.classes:
            model.get_submodule("encoder").register_forward_hook(self._keep)

    def _keep(self, encoder: nn.Module, given: Any, features: Any) -> None:
        self._logits = features.named

    def of(self, tasks: list[str]) -> list[float | None]:
        """Largest logit of the things of each task of the last batch; None for a task whose things have no classes."""
        if self._logits is None:
            return [None] * len(tasks)
        found = self._logits.detach().flatten(1).amax(1).tolist()
        return [one if named_classes(task) else None for one, task in zip(found, tasks, strict=True)]
