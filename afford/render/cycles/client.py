"""Client of the process that renders with Cycles."""

from __future__ import annotations

import json
import subprocess
import sys
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from tempfile import TemporaryDirectory
from types import TracebackType

import numpy as np

from afford.render.scene import Camera, Instance, world_vertices

DATA_FILES = ("worker.py",)
WORKER = Path(__file__).with_name("worker.py")
FOLDER = "share/afford/bpy-5.0.1"
"""environment of Blender's module, below the prefix of this environment, as in install/cycles.py"""


@dataclass(frozen=True, eq=False)
class Lit:
    """Light and lens of a picture."""

    sky: np.ndarray
    """(h, w, 3) float32 radiance of the surroundings, equirectangular, rows from the zenith"""
    lamps: np.ndarray
    """(n, 10) float64 square lamps: place (3) and target (3) in the world, side (m), power of RGB (3, W)"""
    focus_m: float = 1.0
    f_number: float = 0.0
    """0 for a sharp picture"""


@dataclass(frozen=True)
class Surface:
    """Properties of a material that Cycles shows and the fast renderer does not."""

    transmission: float = 0.0
    """1 for glass"""
    coat: float = 0.0
    """1 for a layer of varnish"""
    roughness: float | None = None
    """instead of the material's"""
    saturation: float = 1.0
    """factor of the saturation of the material's colours"""


class Cycles:
    """A process that renders scenes one after the other; a context manager.

    OSError when the environment of Blender's module is missing.
    """

    def __init__(self, python: Path | None = None) -> None:
        self.python = python or Path(sys.prefix) / FOLDER / "bin" / "python"
        if not self.python.is_file():
            raise OSError(f"the renderer Cycles is not installed: expected {self.python.name} of an environment with bpy in "
                          f"{FOLDER} of this environment, got nothing there; run `python install/cycles.py` (1 GB), or set "
                          "still_render.backend=raster")

    def __enter__(self) -> Cycles:
        """Start the process."""
        self._folder = TemporaryDirectory(prefix="afford-cycles-")
        self._log = (Path(self._folder.name) / "log.txt").open("w+")
        self._process = subprocess.Popen([str(self.python), "-I", str(WORKER)], stdin=subprocess.PIPE, stdout=subprocess.PIPE,
                                         stderr=self._log, text=True, cwd=self._folder.name)  # fmt: skip
        return self

    def __exit__(self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None) -> None:
        """End the process and remove its files."""
        self._process.kill()
        self._process.wait()
        for pipe in (self._process.stdin, self._process.stdout, self._log):
            if pipe is not None:
                pipe.close()
        self._folder.cleanup()

    def render(self, instances: Sequence[Instance], surfaces: Sequence[Surface], camera: Camera, lit: Lit, samples: int,
               seed: int) -> np.ndarray:  # fmt: skip
        """Render linear RGB (h, w, 3) float32. RuntimeError with the last output of the process when it fails."""
        folder = Path(self._folder.name)
        scene, out = folder / "scene.npz", folder / "picture.npy"
        np.savez(scene, **scene_arrays(instances, surfaces, camera, lit))  # type: ignore[arg-type]  # names of arrays only
        request = {"scene": str(scene), "out": str(out), "samples": samples, "seed": seed}
        assert self._process.stdin is not None and self._process.stdout is not None
        try:
            self._process.stdin.write(json.dumps(request) + "\n")
            self._process.stdin.flush()
            line = self._process.stdout.readline()
        except OSError as error:
            raise RuntimeError(self._failure(str(error))) from error
        answer = json.loads(line) if line else {"error": "the process ended"}
        if "error" in answer:
            raise RuntimeError(self._failure(answer["error"]))
        return np.load(out, allow_pickle=False).astype(np.float32)

    def _failure(self, reason: str) -> str:
        self._log.seek(0)
        return f"Cycles: {reason}; its last output: {self._log.read()[-400:]}"


def scene_arrays(instances: Sequence[Instance], surfaces: Sequence[Surface], camera: Camera, lit: Lit) -> dict[str, np.ndarray]:
    """Describe a scene as the arrays that the process reads."""
    images: dict[int, int] = {}
    arrays: dict[str, np.ndarray] = {}
    looks = []
    for k, (one, surface) in enumerate(zip(instances, surfaces, strict=True)):
        m = one.material
        if id(m.image) not in images:
            images[id(m.image)] = len(images)
            arrays[f"image{images[id(m.image)]}"] = m.image
        roughness = m.roughness if surface.roughness is None else surface.roughness
        looks.append((*m.tint, m.specular, roughness, m.bump, m.metal, m.skin, images[id(m.image)], surface.transmission,
                      surface.coat, surface.saturation))  # fmt: skip
        vertices, normals = world_vertices(one)
        arrays |= {f"vertices{k}": vertices, f"normals{k}": normals, f"uv{k}": one.mesh.uv, f"colour{k}": one.mesh.colour,
                   f"faces{k}": one.mesh.faces}  # fmt: skip
    return arrays | {"images": np.array(len(images)), "looks": np.array(looks, np.float64), "materials": np.arange(len(looks)),
                     "K": camera.K, "T_world_cam": camera.T_world_cam, "size": np.array([camera.width, camera.height]),
                     "sky": lit.sky, "lamps": lit.lamps, "lens": np.array([lit.focus_m, lit.f_number])}  # fmt: skip
