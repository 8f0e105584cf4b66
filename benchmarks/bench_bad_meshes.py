"""Run `run grasp --source` on meshes that cannot be grasped, beside one that can: sentences, peak memory and time of each.

    PYTHONPATH=. python benchmarks/bench_bad_meshes.py [--faces 2000000] [--store DIR]

The meshes: one of 2 million faces, one larger than a room, one thinner than a finger, one without mass, and a stick. Peak memory
is that of the largest process of the run. The table goes to the standard output.
"""

from __future__ import annotations

import argparse
import re
import resource
import subprocess
import sys
import time
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np
import trimesh

from benchmarks.pages import ROOT

FEW = ("body_evaluate.episodes=1", "body_report.engines=mujoco", "view_render.size_px=96", "view_render.directions=64",
       "mesh_texture.procedural.side_px=128", "grasp_record.width=64", "grasp_record.height=48")  # fmt: skip
STEP = re.compile(r"^(\w+) +(\w+) +([\d.]+) s", re.MULTILINE)
"""stage, object and seconds in the log of a run"""


def fine_bottle(faces: int) -> trimesh.Trimesh:
    """A closed body of revolution of `faces` faces or a few more, as from a laser scanner."""
    n = int(np.ceil(np.sqrt(faces / 2)))
    z, a = np.linspace(0, 1, n + 1), np.linspace(0, 2 * np.pi, n, endpoint=False)
    r = 0.03 * np.sqrt(np.sin(np.pi * (0.02 + 0.96 * z))) * (1 + 0.002 * np.sin(400 * z))
    ring = np.stack([np.outer(r, np.cos(a)), np.outer(r, np.sin(a)), np.repeat(0.2 * z[:, None], n, 1)], -1).reshape(-1, 3)
    i, j = np.meshgrid(np.arange(n), np.arange(n), indexing="ij")
    low, high, right = i * n + j, (i + 1) * n + j, (j + 1) % n
    sides = np.stack([low, i * n + right, high, high, i * n + right, (i + 1) * n + right], -1).reshape(-1, 3)
    ends = [np.stack([np.full(n, len(ring) + k), edge[:, 0], edge[:, 1]], -1) for k, edge in enumerate(
        (np.stack([np.roll(np.arange(n), -1), np.arange(n)], -1), n * n + np.stack([np.arange(n), np.roll(np.arange(n), -1)], -1)))]
    points = np.concatenate([ring, [[0, 0, 0], [0, 0, 0.2]]])
    return trimesh.Trimesh(points, np.concatenate([sides, *ends]), process=False)


def write_meshes(folder: Path, faces: int) -> None:
    """Write one mesh of each kind into a folder."""
    fine_bottle(faces).export(folder / "scanned_bottle.ply")
    trimesh.creation.box((5.0, 4.0, 2.5)).export(folder / "room.glb")
    trimesh.creation.box((0.2, 0.1, 0.002)).export(folder / "card.ply")
    cube = trimesh.creation.box((0.06, 0.06, 0.06))
    inside = trimesh.creation.box((0.0599999, 0.0599999, 0.0599999))
    inside.invert()
    (cube + inside).export(folder / "nothing.ply")
    trimesh.creation.box((0.2, 0.025, 0.02)).export(folder / "stick.ply")


def main() -> None:
    """Make the meshes, run, and print the table."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0] if __doc__ else "")
    parser.add_argument("--faces", type=int, default=2_000_000)
    parser.add_argument("--store", type=Path)
    chosen = parser.parse_args()
    with TemporaryDirectory() as scratch:
        folder, store = Path(scratch) / "bad", chosen.store or Path(scratch) / "store"
        folder.mkdir()
        write_meshes(folder, chosen.faces)
        command = [sys.executable, "pipeline.py", "run", "grasp", f"--source={folder}", f"--store={store}", "--jobs=1",
                   *(f"--set={word}" for word in FEW)]  # fmt: skip
        began = time.monotonic()
        done = subprocess.run(command, cwd=ROOT, capture_output=True, text=True)
        took = time.monotonic() - began
        peak = resource.getrusage(resource.RUSAGE_CHILDREN).ru_maxrss / 2**20
        print(f"exit code {done.returncode}, {took:.0f} s, {peak:.2f} GiB at most\n\n| mesh | seconds of its stages |\n|---|--:|")
        steps = [(name, float(seconds)) for _, name, seconds in STEP.findall(done.stderr + done.stdout)]
        for file in sorted(folder.iterdir()):
            print(f"| {file.name} | {sum(seconds for name, seconds in steps if name == file.stem):.0f} |")
        print(f"\n{done.stderr[-3000:]}\n")
        report = next(iter(store.glob("reports/*/report.md")), None)
        print(report.read_text() if report else "no report")


if __name__ == "__main__":
    main()
