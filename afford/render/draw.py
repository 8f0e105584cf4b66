"""Render images with exact id maps and depth, and the full ground truth of one frame."""

from __future__ import annotations

from collections.abc import Iterable, Sequence

import cv2
import numpy as np

from afford.render.raster import Seen, View, depth
from afford.render.scene import Bundle, Camera, Instance, Light, Rendered, Textures, batch
from afford.render.shade import shade
from afford.render.shadows import Lighting


def render(
    instances: Sequence[Instance],
    camera: Camera,
    light: Light,
    textures: Textures,
    *,
    supersample: int = 2,
    shadow_casters: Sequence[Instance] | None = None,
) -> Rendered:
    """Render the instances; shadows are cast by `shadow_casters`, by default the instances themselves."""
    view = View.of(batch(instances, textures), camera)
    lighting = Lighting.of(view.scene if shadow_casters is None else batch(shadow_casters, textures), light)
    rgb = np.zeros((camera.height, camera.width, 3), np.uint8)
    _paint(view, view.seen(supersample)[1], lighting, lighting.full, textures, np.ones(rgb.shape[:2], np.bool_), rgb)
    face, near = view.seen(1)[1]
    return Rendered(rgb, view.ids(face), depth(near))


def draw_ids(instances: Sequence[Instance], camera: Camera, textures: Textures) -> tuple[np.ndarray, np.ndarray]:
    """Render entity (h, w) int16 and depth (h, w) float32 metres at pixel centres, without colour."""
    view = View.of(batch(instances, textures), camera)
    face, near = view.seen(1)[1]
    return view.ids(face), depth(near)


def render_bundle(
    instances: Sequence[Instance],
    hands: Iterable[int],
    entities: int,
    camera: Camera,
    light: Light,
    textures: Textures,
    *,
    supersample: int = 2,
) -> Bundle:
    """Render one frame with and without hands, ids, depth, and amodal masks.

    `hands` are the entities to remove; amodal masks are those of entities 0..entities-1. Only the pixels that hands cover, or that
    their shadows can reach, are shaded again.
    """
    gone = frozenset(hands)
    view = View.of(batch(instances, textures), camera)
    lighting = Lighting.of(view.scene, light, gone)
    bare, full = view.seen(supersample, gone)
    bare_1, full_1 = view.seen(1, gone)
    rgb = np.zeros((camera.height, camera.width, 3), np.uint8)
    _paint(view, full, lighting, lighting.full, textures, np.ones(rgb.shape[:2], np.bool_), rgb)
    kept = rgb.copy()
    _paint(view, bare, lighting, lighting.full, textures, _changed(full, bare, supersample), kept)
    clean = kept.copy()
    shadowed = cv2.dilate(lighting.touched(camera, depth(bare_1[1])).astype(np.uint8), np.ones((3, 3), np.uint8)) > 0
    _paint(view, bare, lighting, lighting.bare, textures, shadowed, clean)
    amodal = np.stack([view.alone(k) for k in range(entities)])
    return Bundle(rgb, clean, kept, view.ids(full_1[0]), depth(full_1[1]), amodal)


def _changed(full: Seen, bare: Seen, supersample: int) -> np.ndarray:
    """Find pixels (h, w) bool of which at least one sample shows another triangle."""
    height, width = full[0].shape
    return (full[0] != bare[0]).reshape(height // supersample, supersample, width // supersample, supersample).any(axis=(1, 3))


def _paint(
    view: View, seen: Seen, light: Lighting, maps: np.ndarray, textures: Textures, want: np.ndarray, out: np.ndarray
) -> None:
    """Shade the pixels `want` of `out`."""
    s = view.scene
    geometry = (s.vertices, s.normals, s.colours, s.uv, s.faces, s.part, s.layer)
    eye = view.camera.T_world_cam[:3, 3].astype(np.float32)
    supersample = seen[0].shape[0] // view.camera.height
    shade(
        want,
        supersample,
        view.E,
        *seen,
        geometry,
        s.looks,
        (textures.texels, textures.levels),
        eye,
        light.rows,
        maps,
        light.ambience,
        light.vignette,
        out,
    )
