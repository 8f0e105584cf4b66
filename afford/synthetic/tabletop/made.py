"""A spec rendered and written: files of one sequence, and its truth."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from blake3 import blake3

from afford.dataset.sor3d.folder import discover
from afford.dataset.sor3d.write import write
from afford.synthetic.tabletop.film import film
from afford.synthetic.tabletop.sensor import grain, sense
from schemas.interaction import InteractionClip, InteractionSpec, InteractionTruth, RenderedInteraction


def made(spec: InteractionSpec, size_px: int, frames: int, rate_hz: float, clutter: int, noise: float, supersample: int,
         root: Path) -> RenderedInteraction:  # fmt: skip
    """Render the sequence and write it below `root`."""
    take, shot = film(spec, frames, clutter, size_px, supersample)
    K, rng = take.studio.camera.K, np.random.default_rng([spec.seed, 7])
    depth = np.stack([sense(exact, K, noise, rng) for exact in shot.depth_m])
    rgb = np.stack([grain(frame, rng) for frame in shot.rgb])
    clip = InteractionClip(spec.name, spec.split, spec.object_type, spec.affordance, rgb, depth, K, shot.label, rate_hz,
                           shot.hotspot)  # fmt: skip
    write(clip, root)
    truth = InteractionTruth(spec.name, shot.flow_m, shot.flow_px, shot.valid, shot.visible, shot.depth_m)
    (files,) = discover(root, lambda path: blake3(path.read_bytes()).hexdigest())
    return RenderedInteraction(files, truth)
