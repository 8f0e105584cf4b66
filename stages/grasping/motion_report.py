"""retargeted clips -> the reference motions that a robot hand imitates, and a report of dropped clips with reasons.

Reads   Retargeted of every clip
Writes  ReferenceSet: references by name; RetargetReport: every verdict, the number of kept clips, the number dropped by each reason
Method  sorting and counting
Fails   ValueError when no clip was kept, with the reasons
Paper   AffordDex, HTI, does not mention filtering; users of its data report 323 of 583 clips that track
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
    """Parameters of motion_report."""

    name: str = "shadow"
    """name of the set"""


def run(clips: tuple[Retargeted, ...], params: Params) -> ReferenceSet:
    """Collect references and verdicts of all clips."""
    verdicts = tuple(sorted((clip.verdict for clip in clips), key=lambda verdict: verdict.name))
    reasons = Counter(verdict.reason for verdict in verdicts if not verdict.kept)
    dropped = tuple(f"{reason}: {number}" for reason, number in sorted(reasons.items(), key=lambda item: (-item[1], item[0])))
    references = tuple(sorted((one for clip in clips for one in clip.references), key=lambda reference: reference.name))
    if not references:
        raise ValueError(f"motion_report: no clip of {len(clips)} can be imitated; {', '.join(dropped)}")
    return ReferenceSet(params.name, references, RetargetReport(params.name, verdicts, len(references), dropped))
