"""Measure the cost of reading a root of EPIC-KITCHENS size: 700 annotated videos. Writes benchmarks/ingest.md.

    PYTHONPATH=. python benchmarks/bench_ingest.py [--videos 700]

The root is simulated with sparse files: tars of 400 MB as published, videos, or folders of frames. Measured are CPU seconds
(user + system, with start-up) and peak memory of `run dataset --dry-run`, of reading every video's annotations and tar index
once, of the run after it, which is fully cached, and of the index of one full-length tar.
"""

from __future__ import annotations

import argparse
import os
import platform
import resource
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable
from pathlib import Path

from afford.common.folders import index_pack
from tests.helpers.made_epic import write_tables

ROOT = Path(__file__).resolve().parent.parent
PLAN_TAR_MB, READ_TAR_MB, READ_FRAMES, FOLDER_FRAMES, FULL_FRAMES = 400, 16, 40, 510, 16_500
READ = '''
import sys
from pathlib import Path
from commands.origin import origin
from commands.session import digester, open_runner
from maps.settings import Settings
from runner import Graph
from stages.extraction import source_read
p, source, store = Settings(), Path(sys.argv[1]), Path(sys.argv[2])
runner = open_runner(store, jobs=1)
place, _ = origin("dataset", source, p, digester(runner))
g = Graph()
video = g.each(g.leaf("videos", place.videos))
g.target("read", g.collect(g.add(source_read.run, files=g.pick(video, lambda v: v.files), params=p.extraction.source_read)))
report = runner.run(g, "read")
print(report.ran.get("source_read", 0), report.cached.get("source_read", 0), len(report.failures))
'''


def spent(command: list[str]) -> tuple[float, float, str]:
    """(CPU seconds, peak MiB of the largest process, what it printed last) of a command."""
    code = ("import resource, subprocess, sys; done = subprocess.run(sys.argv[1:], stdout=subprocess.PIPE, text=True, check=True); "
            "used = resource.getrusage(resource.RUSAGE_CHILDREN); "
            "print(used.ru_utime + used.ru_stime, used.ru_maxrss / 1024, (done.stdout.splitlines() or [''])[-1])")
    done = subprocess.run([sys.executable, "-c", code, *command], cwd=ROOT, stdout=subprocess.PIPE, text=True, check=True,
                          env=os.environ | {"PYTHONPATH": str(ROOT)})
    cpu, peak, counts = done.stdout.strip().split(" ", 2)
    return float(cpu), float(peak), counts


def names(count: int) -> list[str]:
    """Ids of the extension, 20 videos a person."""
    return [f"P{1 + i // 20:02d}_{101 + i % 20}" for i in range(count)]


def hollow(path: Path, size: int) -> None:
    """A file without data."""
    path.parent.mkdir(parents=True, exist_ok=True)
    with path.open("wb") as stream:
        stream.truncate(size)


def tar(path: Path, frames: int, frame_bytes: int) -> None:
    """A whole tar whose pictures are holes."""
    import tarfile

    path.parent.mkdir(parents=True, exist_ok=True)
    with path.open("wb") as stream:
        for number in range(1, frames + 1):
            item = tarfile.TarInfo(f"./frame_{number:010d}.jpg")
            item.size = frame_bytes
            stream.write(item.tobuf())
            stream.seek(-(-frame_bytes // 512) * 512, os.SEEK_CUR)
        stream.truncate(stream.tell() + 1024)


def folder(path: Path, frames: int) -> None:
    """Frames of no bytes."""
    path.mkdir(parents=True)
    for number in range(1, frames + 1):
        (path / f"frame_{number:010d}.jpg").touch()


def planned(videos: list[str], write: Callable[[Path, str], None]) -> tuple[float, float, str]:
    """The plan of a root whose media `write` makes."""
    with tempfile.TemporaryDirectory() as name:
        root = write_tables(Path(name) / "EPIC-KITCHENS", videos)
        for video in videos:
            write(root, video)
        command = [sys.executable, "pipeline.py", "run", "dataset", "--source", str(root), "--store", f"{name}/store", "--dry-run"]
        return spent(command)


def read_twice(videos: list[str]) -> list[tuple[float, float, str]]:
    """Reading every video once, and the run after."""
    with tempfile.TemporaryDirectory() as name:
        root = write_tables(Path(name) / "EPIC-KITCHENS", videos)
        for video in videos:
            tar(root / video[:3] / "rgb_frames" / f"{video}.tar", READ_FRAMES, READ_TAR_MB * 1_000_000 // READ_FRAMES)
        time.sleep(0.1)
        return [spent([sys.executable, "-c", READ, str(root), f"{name}/store"]) for _ in range(2)]


def indexed() -> float:
    """CPU seconds of the index of one tar of full length."""
    with tempfile.TemporaryDirectory() as name:
        path = Path(name) / "P01_101.tar"
        tar(path, FULL_FRAMES, 24_000)
        before = resource.getrusage(resource.RUSAGE_SELF)
        assert len(index_pack(path).names) == FULL_FRAMES
        after = resource.getrusage(resource.RUSAGE_SELF)
        return after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime


def main() -> None:
    """Measure, then write."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--videos", type=int, default=700)
    videos = names(parser.parse_args().videos)
    kinds: list[tuple[str, Callable[[Path, str], None]]] = [
        (f"plan: tars of {PLAN_TAR_MB} MB", lambda root, v: hollow(root / v[:3] / "rgb_frames" / f"{v}.tar", PLAN_TAR_MB * 10**6)),
        (f"plan: videos of {PLAN_TAR_MB} MB", lambda root, v: hollow(root / v[:3] / "videos" / f"{v}.MP4", PLAN_TAR_MB * 10**6)),
        (f"plan: folders of {FOLDER_FRAMES} frames", lambda root, v: folder(root / v[:3] / "rgb_frames" / v, FOLDER_FRAMES)),
    ]
    rows = [(what, *planned(videos, write)) for what, write in kinds]
    once, again = read_twice(videos)
    rows += [(f"first reading: tars of {READ_TAR_MB} MB, {READ_FRAMES} frames each", *once), ("nothing to do", *again)]
    counts = f"{len(videos)} videos; tasks run, cached, failed: first {once[2]}; then {again[2]}"
    lines = [f"# Ingest: a root of {len(videos)} annotated videos", "",
             f"Simulated with sparse files ({counts}). CPU seconds with start-up. {platform.machine()}, Python "
             f"{platform.python_version()}. Written by `benchmarks/bench_ingest.py`.", "",
             "| what | CPU s | peak MiB |", "|---|--:|--:|"]
    lines += [f"| {what} | {cpu:.1f} | {peak:.0f} |" for what, cpu, peak, _ in rows]
    lines += [f"| index of one tar of {FULL_FRAMES} frames | {indexed():.2f} | |", "",
              "A plan opens no archive; of a folder it lists at most 501 names. The first run reads every byte of the media of "
              "annotated videos once, for their digests, and the tar headers once, for the index."]
    (ROOT / "benchmarks" / "ingest.md").write_text("\n".join(lines) + "\n")


if __name__ == "__main__":
    main()
