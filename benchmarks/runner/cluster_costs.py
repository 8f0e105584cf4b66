"""Compute what EPIC-KITCHENS and Ego4D cost on a Ray cluster, from the measured pages of this repository.

    python benchmarks/runner/cluster_costs.py

Reads benchmarks/extraction.md, benchmarks/ingest.md, benchmarks/runner/ray.md and docs/decisions/005 (size of a frame), and
writes the table in docs/cluster.md. Nothing is run.
"""

from __future__ import annotations

import re
import sys
from dataclasses import dataclass
from pathlib import Path

ROOT = Path(__file__).resolve().parent.parent.parent
sys.path.insert(0, str(ROOT / "benchmarks"))

from pages import into  # noqa: E402

PAGE, BY = ROOT / "docs" / "cluster.md", "runner/cluster_costs.py"
CLIP_FRAMES = 900
"""longest clip that `source_read` cuts (its parameter max_frames)"""
READS, WRITES = 6, 2
"""stages that read the frames of a clip (docs/decisions/005), and stages that write frames: frame_decode, hand_inpaint"""
MANY = 100_000
"""tasks at which the memory of the driver was measured"""
CLUSTERS = (64, 256, 1024)


@dataclass(frozen=True)
class Corpus:
    """Hours of video at a frame rate."""

    name: str
    hours: int
    fps: int

    @property
    def frames(self) -> int:
        """Frames in all."""
        return self.hours * 3600 * self.fps

    @property
    def clips(self) -> int:
        """Clips of the greatest length."""
        return -(-self.frames // CLIP_FRAMES)


CORPORA = (Corpus("EPIC-KITCHENS-100", 100, 60), Corpus("Ego4D", 3670, 30))


@dataclass(frozen=True)
class Measured:
    """Figures of the benchmark pages."""

    stages: dict[str, float]
    """CPU seconds a frame"""
    frame_bytes: float
    media_cpu_s_per_gb: float
    driver_us: float
    """CPU of the driver a shard"""
    driver_mib: float
    """peak memory of the driver at 100,000 shards"""

    @property
    def frame_s(self) -> float:
        """CPU seconds a frame of all stages."""
        return sum(self.stages.values())


def found(pattern: str, page: str, flags: int = 0) -> re.Match[str]:
    """First match in a page of the repository; SystemExit when there is none."""
    match = re.search(pattern, (ROOT / page).read_text(encoding="utf-8"), flags)
    if match is None:
        raise SystemExit(f"{page} has no line that matches {pattern!r}; run the benchmark that writes it")
    return match


def read() -> Measured:
    """Read the figures."""
    table = found(r"## Cost, CPU seconds a frame\n\n\| stage.*\n\|.*\n((?:\|.*\n)+)", "benchmarks/extraction.md")[1]
    rows = [[cell.strip() for cell in line.strip("|").split("|")] for line in table.strip().split("\n")]
    media = found(r"first reading: tars of (\d+) MB, .*? \| ([\d.]+) \|", "benchmarks/ingest.md")
    videos = found(r"(\d+) videos; tasks", "benchmarks/ingest.md")
    size = found(r"about (\d+) kB a frame", "docs/decisions/005-lossless-h264-between-stages.md", re.DOTALL)
    return Measured(
        stages={name: float(value) for name, value in rows if name != "together"}, frame_bytes=1e3 * float(size[1]),
        media_cpu_s_per_gb=float(media[2]) / (int(videos[1]) * int(media[1]) / 1e3),
        driver_us=float(found(r"driver: CPU a shard \| (\d+) us", "benchmarks/runner/ray.md")[1]),
        driver_mib=float(found(r"driver: peak memory \| (\d+) MiB", "benchmarks/runner/ray.md")[1]))


def row(name: str, values: list[str]) -> str:
    """A line of the table."""
    return f"| {name} | " + " | ".join(values) + " |"


def each(form: str, figures: list[float]) -> list[str]:
    """Figures as text."""
    return [form.format(figure) for figure in figures]


def block(measured: Measured) -> str:
    """The table, and the arithmetic below it."""
    hours = [measured.frame_s * corpus.frames / 3600 for corpus in CORPORA]
    tasks = [len(measured.stages) * corpus.clips for corpus in CORPORA]
    lines = [row("what", [corpus.name for corpus in CORPORA]), "|---|" + "--:|" * len(CORPORA)]
    lines += [
        row("video", [f"{corpus.hours:,} h at {corpus.fps} frames/s" for corpus in CORPORA]),
        row("frames", [f"{corpus.frames / 1e6:,.1f} million" for corpus in CORPORA]),
        row(f"clips of {CLIP_FRAMES} frames", [f"{corpus.clips:,}" for corpus in CORPORA]),
        row(f"tasks: {len(measured.stages)} stages a clip", [f"{count:,}" for count in tasks])]
    lines += [row(f"`{name}`, {cost:g} s a frame", each("{:,.0f} CPU h", [cost * corpus.frames / 3600 for corpus in CORPORA]))
              for name, cost in measured.stages.items()]
    lines += [row(f"**together, {measured.frame_s:.3f} s a frame**", each("**{:,.0f} CPU h**", hours))]
    lines += [row(f"wall on {cores:,} cores", [days(figure / cores) for figure in hours]) for cores in CLUSTERS]
    lines += [
        row("driver, CPU", each("{:,.1f} min", [count * measured.driver_us / 6e7 for count in tasks])),
        row("driver, memory (in proportion to 100,000 tasks)",
            each("{:,.1f} GiB", [count * measured.driver_mib / 1024 / MANY for count in tasks])),
        row("frames in the store, decoded and inpainted",
            each("{:,.1f} TB", [WRITES * measured.frame_bytes * corpus.frames / 1e12 for corpus in CORPORA])),
        row("hashing the media once, a TB", each("{:,.1f} CPU h", [1e3 * measured.media_cpu_s_per_gb / 3600] * len(CORPORA)))]
    cores = CLUSTERS[-1]
    rate = cores / measured.frame_s
    clip_s = measured.frame_s * CLIP_FRAMES / len(measured.stages)
    return "\n".join([
        *lines, "",
        f"On {cores:,} cores, {rate:,.0f} frames/s pass through all stages. Each frame is written {WRITES} times and read {READS} "
        f"times at {measured.frame_bytes / 1e3:.0f} kB, so the shared store must serve "
        f"{rate * measured.frame_bytes * WRITES / 1e9:.1f} GB/s of writes and {rate * measured.frame_bytes * READS / 1e9:.1f} GB/s "
        f"of reads. A task takes {clip_s:.0f} s on average, so {cores / clip_s:.0f} tasks end every second, which is "
        f"{cores / clip_s * measured.driver_us / 1e6:.1%} of one core of the driver.", ""])


def days(hours: float) -> str:
    """Hours, or days from two days on."""
    return f"{hours:,.1f} h" if hours < 48 else f"{hours / 24:,.1f} days"


def main() -> None:
    """Write the table."""
    into(PAGE, "costs", BY, block(read()))


if __name__ == "__main__":
    main()
