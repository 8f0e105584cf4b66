"""Write retargeted motions as files: arrays of each clip, a row for every clip, a report."""

from __future__ import annotations

import csv
import dataclasses
import io
from collections import Counter
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from afford.common.files import write_json
from schemas.hand import PHASES, HandReference, ReferenceSet, RetargetVerdict


def write_references(root: Path, name: str, found: ReferenceSet) -> Path:
    """Write references/*.npz, verdicts.csv, metrics.json and report.md to `root`."""
    (root / "references").mkdir()
    for reference in found.references:
        file = root / "references" / f"{reference.name.replace('/', '_')}.npz"
        np.savez(file, **arrays(reference))  # type: ignore[arg-type]  # no field is named as a keyword of savez
    (root / "verdicts.csv").write_text(verdict_table(found.report.verdicts), encoding="utf-8", newline="\n")
    write_json(root / "metrics.json", metrics(found))
    (root / "report.md").write_text(report(name, found), encoding="utf-8", newline="\n")
    return root


def arrays(one: HandReference) -> dict[str, np.ndarray]:
    """Return every field of a reference under its own name, and `phases`, the meaning of the numbers in `phase`.

    Strings are arrays of one string.
    """
    fields = {field.name: np.asarray(getattr(one, field.name)) for field in dataclasses.fields(one)}
    return fields | {"phases": np.asarray(PHASES)}


def verdict_table(verdicts: Sequence[RetargetVerdict]) -> str:
    """Format every clip with its verdict and figures as CSV, by name; unknown figures are empty."""
    out = io.StringIO()
    names = [field.name for field in dataclasses.fields(RetargetVerdict)]
    lines = csv.writer(out, lineterminator="\n")
    lines.writerow(names)
    for verdict in verdicts:
        values = (getattr(verdict, name) for name in names)
        lines.writerow("" if isinstance(value, float) and value == -1 else value for value in values)
    return out.getvalue()


def metrics(found: ReferenceSet) -> dict[str, float]:
    """Compute counts of clips, kept clips and frames, and tracking errors as means over kept clips."""
    kept = [verdict for verdict in found.report.verdicts if verdict.kept]
    means = {"error_mm": 1000 * np.mean([one.error_mean_m for one in kept]),
             "error_p95_mm": 1000 * np.mean([one.error_p95_m for one in kept]),
             "bone_error_deg": np.degrees(np.mean([one.bone_error_rad for one in kept]))}  # fmt: skip
    counts = {"clips": len(found.report.verdicts), "kept": len(kept), "frames": sum(one.frames for one in kept),
              "mirrored": sum(one.mirrored for one in kept)}  # fmt: skip
    return {name: float(value) for name, value in (counts | means).items()}


def report(name: str, found: ReferenceSet) -> str:
    """Format the report in Markdown: kept clips, their tracking errors, reasons of dropped clips."""
    m = metrics(found)
    reasons = (line.rpartition(": ") for line in found.report.dropped)
    dropped = "".join(f"| {reason} | {number} |\n" for reason, _, number in reasons)
    why = f"\n| dropped because | clips |\n|---|--:|\n{dropped}" if dropped else ""
    return (f"# Motions: {name}\n\n{m['kept']:.0f} of {m['clips']:.0f} clips are kept, {m['frames']:.0f} frames; "
            f"{m['mirrored']:.0f} are of the other hand and were mirrored. Points of the hand {found.name} are "
            f"{m['error_mm']:.1f} mm from where a person's would be (mean over clips; 95 % of frames below "
            f"{m['error_p95_mm']:.1f} mm), bones {m['bone_error_deg']:.1f} degrees.\n{why}\nEvery clip: verdicts.csv.\n")


def write_clip_report(root: Path, name: str, found: ReferenceSet) -> Path:
    """Write report.md, clips.csv and metrics.json of the clips that a prior learns from to `root`."""
    verdicts = found.report.verdicts
    (root / "clips.csv").write_text(verdict_table(verdicts), encoding="utf-8", newline="\n")
    write_json(root / "metrics.json", {"clips": float(len(verdicts)), "kept": float(found.report.kept)})
    (root / "report.md").write_text(_clip_report(name, found), encoding="utf-8", newline="\n")
    return root


def _clip_report(name: str, found: ReferenceSet) -> str:
    """Format tables of clips by source, kept clips by object, and dropped clips by reason and by name."""
    verdicts = found.report.verdicts
    total = Counter(one.source for one in verdicts)
    kept = Counter(one.source for one in verdicts if one.kept)
    sources = "".join(f"| {source} | {total[source]} | {kept[source]} |\n" for source in sorted(total))
    held = Counter(one.object_name for one in found.references)
    objects = "".join(f"| {body} | {held[body]} |\n" for body in sorted(held))
    reasons = "".join("| {} | {} |\n".format(*line.rsplit(": ", 1)) for line in found.report.dropped)
    lost = "".join(f"- {one.name}: {one.reason}, {one.detail}\n" for one in verdicts if not one.kept)
    return (f"# Clips of the prior: {name}\n\n| source | clips | kept |\n|---|--:|--:|\n{sources}\n"
            f"| object | kept clips |\n|---|--:|\n{objects}\n| dropped because | clips |\n|---|--:|\n{reasons}\n"
            f"## Dropped clips\n\n{lost}")  # fmt: skip
