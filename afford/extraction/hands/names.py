"""What touched things are called: by the narration during which they alone are touched, else `object`."""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping, Sequence

import numpy as np

from afford.extraction.hands.follow import Track
from afford.extraction.hands.touched import NOTHING
from afford.extraction.sources.speech import UNTOLD
from schemas.video import Hand, Narration

Name = tuple[str, int]
"""a name and its noun class, -1 for none"""
UNNAMED: Name = (UNTOLD[1], -1)


def names(objects: Sequence[Track], touch: Mapping[Hand, np.ndarray], narrations: Sequence[Narration],
          frame: np.ndarray) -> list[Name]:  # fmt: skip
    """A name for every object, no two alike: the second that is called a mug is `mug:2`. frame: (k,) number of every look."""
    votes: list[Counter[Name]] = [Counter() for _ in objects]
    for narration in narrations:
        during = (frame >= narration.start_frame) & (frame <= narration.stop_frame)
        looks = Counter(int(i) for said in touch.values() for i in said[during] if i != NOTHING)
        if len(looks) == 1 and narration.noun:
            ((thing, count),) = looks.items()
            votes[thing][narration.noun, narration.noun_class] += count
    return _apart([vote.most_common(1)[0][0] if vote else UNNAMED for vote in votes])


def _apart(called: Sequence[Name]) -> list[Name]:
    used: Counter[str] = Counter()
    out = []
    for name, class_id in called:
        used[name] += 1
        out.append((name if used[name] == 1 else f"{name}:{used[name]}", class_id))
    return out
