"""The card of a trained SOR3D-AFF model."""

from __future__ import annotations

import json
from collections import Counter
from collections.abc import Mapping
from typing import Any

from afford.training.curves import scores_at_best, scores_table
from afford.training.job import Dataset
from schemas.training import TrainingLog

LIMITS = """- It knows things and actions like those it was trained on. Rendered sequences are tidier than people at tables.
- A region says where an action takes hold of a thing; it promises neither a stable grasp nor that touching is safe.
- The camera must stand: motion is measured against it.
- The validation figures above chose the step, so they flatter."""
WHAT = """SOR3D-AFF's spatio-temporal autoencoder. An RGB-D sequence (or one picture) goes in; which pixels of its last frame afford
what, and the action, come out."""


def text(name: str, dataset: Dataset, parts: Mapping[str, Counter[str]], job: dict[str, Any], count: int,
         curves: TrainingLog, what: str = WHAT) -> str:
    """The whole card; `parts` are sequences by '<object type> <affordance>', `job` its fields, `what` the model is."""
    config, plan = job["config"], job["plan"]
    kinds = sorted(set().union(*parts.values()))
    return f"""---
license: {dataset.licence}
library_name: afford
pipeline_tag: image-segmentation
tags:
- affordance
- rgb-d
- video
---

# {name}

{what}

{count:,} parameters.

Depth: {config['depth']}; flow: {config['flow']}; attention: {config['attention']}.

## Data

`{dataset.name}`, content digest `{dataset.digest}`.

| | {' | '.join(parts)} |
|---|{'--:|' * len(parts)}
| sequences | {' | '.join(str(sum(part.values())) for part in parts.values())} |
{_lines(kinds, parts)}

## Training

{curves.steps} of {plan['steps']} steps of {job['batch'] * plan['accumulate']} sequences a process, seed {job['seed']}; the weights
of step {curves.best_step} were kept. Only the label of the last frame is learned, and the action.

```json
{json.dumps({key: value for key, value in job.items() if key not in ('vgg', 'encoder')}, indent=1, sort_keys=True)}
```

## Validation

{scores_table(scores_at_best(curves))}

## Limits

{LIMITS}

The licence is that of the data set.
"""


def _lines(kinds: list[str], parts: Mapping[str, Counter[str]]) -> str:
    return "\n".join(f"| {kind} | {' | '.join(str(part[kind]) for part in parts.values())} |" for kind in kinds)
