"""what became of every clip -> the motions that a robot hand is to imitate, and a report of what was dropped, and why.

Reads   Retargeted of every clip
Writes  ReferenceSet: references by name; RetargetReport: every verdict, how many were kept, how many each reason dropped
Method  sorted and counted
Fails   ValueError when no clip was kept, with the reasons
Paper   AffordDex, HTI, says nothing of filtering; users of its data report 323 of 583 clips that track
"""

from __future__ import annotations

from collections import Counter
from dataclasses import dataclass

from schemas.hand import ReferenceSet, Retargeted, RetargetReport

LIBRARIES = ()
THREADS = 1
MEMORY_GIB = 1.0


@dataclass(frozen=True)
class Params:
    name: str = "shadow"
    """what the set is called"""


def run(clips: tuple[Retargeted, ...], params: Params) -> ReferenceSet:
    """All clips together."""
    verdicts = tuple(sorted((clip.verdict for clip in clips), key=lambda verdict: verdict.name))
    reasons = Counter(verdict.reason for verdict in verdicts if not verdict.kept)
    dropped = tuple(f"{reason}: {number}" for reason, number in sorted(reasons.items(), key=lambda item: (-item[1], item[0])))
    references = tuple(sorted((one for clip in clips for one in clip.references), key=lambda reference: reference.name))
    if not references:
        raise ValueError(f"motion_report: no clip of {len(clips)} can be imitated; {', '.join(dropped)}")
    return ReferenceSet(params.name, references, RetargetReport(params.name, verdicts, len(references), dropped))
