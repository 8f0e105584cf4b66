"""The card of a trained model: what it learned from, how, how well it did, and what it cannot do."""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from afford.training.curves import scores_at_best, scores_table
from schemas.affordance import TAXONOMY
from schemas.training import TrainingLog

LIMITS = """- It has learned to find regions in pictures like those it was trained on. Rendered pictures are tidier than kitchens.
- A region says where hands were seen to act, in the image; it promises neither a stable grasp nor that touching is safe.
- Words that training did not contain are read by their letters alone, unless a pretrained language model reads them.
- The validation figures above chose the step and the threshold, so they flatter; the benchmark's held-out objects do not."""


@dataclass(frozen=True)
class Source:
    """What a model learned from."""

    name: str
    digest: str
    licence: str
    parts: dict[str, dict[str, Any]]
    """train and val -> what they hold"""


def text(name: str, source: Source, job: Mapping[str, Any], threshold: float, count: int,
         curves: TrainingLog) -> str:  # fmt: skip
    """The whole card, Markdown with the header that model hubs read; `job` is the job as a tree of its fields."""
    config, division, plan = job["config"], job["division"], job["plan"]
    return f"""---
license: {source.licence}
library_name: afford
pipeline_tag: image-segmentation
tags:
- affordance
- bimanual
---

# {name}

A two-hand affordance model of afford, variant `{config["variant"]}` with {count:,} parameters: an image and a task in words go
in; where the left and the right hand act, whether both are needed, and {config["hypotheses"]} hypotheses for each hand come out.

```python
from afford.twohands.model.predictor import Predictor
said = Predictor("model").predict(image, "pour tea from kettle")
said.mask("left"), said.mask("right"), said.taxonomy
```

## Data

`{source.name}`, content digest `{source.digest}`, divided by `{division["by"]}` (seed {division["seed"]}).

| | {' | '.join(source.parts)} |
|---|{'--:|' * len(source.parts)}
{_rows(source.parts)}

## Training

{curves.steps} of {plan["steps"]} steps of {job["batch"] * plan["accumulate"]} samples a process, seed {job["seed"]}; the weights of
step {curves.best_step} were kept. Learns the {job["target"]} of each hand.

```json
{json.dumps(job, indent=1, sort_keys=True)}
```

## Validation

{scores_table(scores_at_best(curves))}

On {min(job["val_samples"], source.parts['val']['samples'])} samples of the part `val`, every second one cropped to its objects, at
{config["size_px"][1]} x {config["size_px"][0]} px; IoU and precision of both hands' union, the top-ranked hypothesis, an idle
hand by the model's own taxonomy. The threshold {threshold} was chosen here.

## Limits

{LIMITS}

The licence is that of the data set.
"""


def _rows(parts: dict[str, dict[str, Any]]) -> str:
    plain = [(key, [str(part[key]) for part in parts.values()]) for key in ("samples", "video", "verb", "noun")]
    hands = [(label.replace("_", " "), [str(part["taxonomy"].get(number, 0)) for part in parts.values()])
             for number, label in enumerate(TAXONOMY)]  # fmt: skip
    return "\n".join(f"| {label} | {' | '.join(cells)} |" for label, cells in [*plain, *hands])
