"""World -> what the camera records and what is true of it: noisy frames for the video, a `ClipTruth` of clean ones beside it."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from afford.render.draw import render_bundle
from afford.render.scene import Bundle, Camera
from afford.synthetic.kitchens.contact import Surfaces
from afford.synthetic.kitchens.play import LENGTH
from afford.synthetic.kitchens.world import HEIGHT, WIDTH, World
from schemas.scene import ClipTruth, SceneSpec

HANDS = (0, 1)
SLIVER_PX = 12
"""A visible part smaller than this counts as out of sight: no annotator would see it."""
NOISE_DARK, NOISE_BRIGHT = 1.6, 3.2
"""Standard deviation of the sensor noise at black and at white, in grey levels."""


@dataclass(frozen=True)
class Recording:
    """The frames as a camera records them, (t, h, w, 3) uint8, and their truth."""

    images: np.ndarray
    truth: ClipTruth


def record(spec: SceneSpec, world: World, supersample: int, progress: Callable[[int, int], None]) -> Recording:
    """Render every frame of a clip."""
    count, n = spec.frames, len(world.entities)
    shape = (count, HEIGHT, WIDTH)
    rgb, clean, kept = (np.zeros((*shape, 3), np.uint8) for _ in range(3))
    visible, amodal = np.zeros((n, *shape), bool), np.zeros((n, *shape), bool)
    depth, touch = np.zeros(shape, np.uint16), np.zeros((2, *shape), bool)
    contact, poses = np.full((2, count), -1, np.int16), np.zeros((count, 4, 4))
    surfaces, noise = Surfaces(world), np.random.default_rng([spec.seed, 7])
    for t in range(count):
        time = t * LENGTH / count
        camera = world.camera(time)
        bundle = render_bundle(world.instances(time), HANDS, n, camera, world.room.light, world.textures, supersample=supersample)
        rgb[t], clean[t], kept[t] = grain(bundle.rgb, noise), bundle.rgb_no_hands, bundle.rgb_no_hands_shadow
        visible[:, t], amodal[:, t] = seen(bundle, n), bundle.amodal
        depth[t] = np.round(1000 * bundle.depth_m).astype(np.uint16)
        contact[:, t], poses[t] = world.touched(time), camera.T_world_cam
        touch[:, t] = _touching(surfaces, camera, bundle, contact[:, t], time)
        progress(t + 1, count)
    frame = np.arange(1, count + 1, dtype=np.int64)
    truth = ClipTruth(spec.video_id, world.play.hard, world.entities, frame, visible, amodal, clean, kept, depth, contact, touch,
                      world.K, poses)
    return Recording(rgb, truth)


def seen(bundle: Bundle, count: int) -> np.ndarray:
    """(n, h, w) bool visible pixels of each entity, slivers left out."""
    masks = bundle.ids[None] == np.arange(count, dtype=np.int16)[:, None, None]
    masks[masks.sum(axis=(1, 2)) < SLIVER_PX] = False
    return masks


def grain(image: np.ndarray, rng: np.random.Generator) -> np.ndarray:
    """The image with sensor noise that grows with brightness, mostly grey."""
    level = image.astype(np.float32)
    sigma = NOISE_DARK + (NOISE_BRIGHT - NOISE_DARK) * level / 255
    grey = rng.standard_normal(image.shape[:2], np.float32)[..., None]
    colour = rng.standard_normal(image.shape, np.float32)
    return np.clip(np.round(level + sigma * (0.8 * grey + 0.6 * colour)), 0, 255).astype(np.uint8)


def _touching(surfaces: Surfaces, camera: Camera, bundle: Bundle, contact: np.ndarray, time: float) -> np.ndarray:
    out = np.zeros((2, *bundle.ids.shape), bool)
    for hand, entity in enumerate(contact):
        if entity >= 0:
            out[hand] = surfaces.near(camera, bundle.depth_m, bundle.ids == hand, int(entity), time)
    return out
