"""Painters of stills: the fast renderer, and Cycles with natural materials, indoor light and the response of a small camera."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from itertools import count

import numpy as np

from afford.common.photographs import read_photographs
from afford.render.cycles.client import Cycles
from afford.render.cycles.indoor import indoor_light
from afford.render.cycles.natural import natural
from afford.render.scene import Camera
from afford.synthetic.kitchens.scene_builder import CENTRE
from afford.synthetic.stills import CyclesParams
from afford.synthetic.stills.camera_response import develop
from afford.synthetic.stills.still_world import Layout
from schemas.files import FileTree
from schemas.scene import StillSpec

Painter = Callable[[Layout, Camera], np.ndarray]
"""paints a layout as a camera takes it, (h, w, 3) uint8"""


@contextmanager
def raster(spec: StillSpec, params: None, photographs: FileTree | None) -> Iterator[None]:
    """Render stills with the fast renderer, which draws masks and pictures together."""
    yield None


@contextmanager
def cycles(spec: StillSpec, params: CyclesParams, photographs: FileTree | None) -> Iterator[Painter]:
    """Path-trace stills with Cycles, in natural materials and indoor light.

    Light, materials and camera of a picture depend on the room's seed and the picture's number.

    OSError when Cycles is not installed, RuntimeError when it fails, ValueError for a photograph that is not readable.
    """
    shown = read_photographs(photographs) if photographs else ()
    number, target = count(), np.array([*CENTRE, 0.04])
    with Cycles() as process:

        def paint(layout: Layout, camera: Camera) -> np.ndarray:
            rng = np.random.default_rng((spec.seed, next(number)))
            kinds = {obj.number: obj.model.kind for obj in layout.objects}
            instances, surfaces = natural(layout.instances, kinds, shown, rng)
            lit = indoor_light(rng, camera.T_world_cam[:3, 3], target)
            return develop(process.render(instances, surfaces, camera, lit, params.samples, int(rng.integers(1 << 31))), rng)

        yield paint
