"""What the rest of afford calls: images with exact id maps, and the full truth of a frame in one go."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass

import numpy as np

from afford.render.batch import Batch, batch
from afford.render.model import BACKGROUND, Bundle, Camera, Instance, Light, Rendered
from afford.render.raster import edges, fill, project
from afford.render.shade import shade
from afford.render.shadow import depth_map, lamps
from afford.render.textures import Textures


@dataclass(frozen=True, eq=False)
class View:
    """A batch seen by a camera: edge matrices and pixel boxes of its triangles."""

    scene: Batch
    camera: Camera
    E: np.ndarray
    bounds: np.ndarray

    @staticmethod
    def of(scene: Batch, camera: Camera) -> View:
        E, bounds = edges(project(scene.vertices, camera), scene.faces, camera.width, camera.height)
        return View(scene, camera, E, bounds)

    def seen(self, supersample: int, skip: Iterable[int] = ()) -> tuple[np.ndarray, np.ndarray]:
        """Triangle index (int32, -1 none) and 1 / depth (float32) of every sample, without the entities in `skip`."""
        shape = (self.camera.height * supersample, self.camera.width * supersample)
        near, face = np.zeros(shape, np.float32), np.full(shape, -1, np.int32)
        for first, last in _runs(self.scene, frozenset(skip)):
            fill(self.E, self.bounds, first, last, supersample, near, face)
        return face, near

    def alone(self, entity: int) -> np.ndarray:
        """(h, w) bool: every pixel of one entity, whatever stands before it."""
        others = frozenset(np.unique(self.scene.entity).tolist()) - {entity}
        return self.seen(1, others)[0] >= 0

    def ids(self, face: np.ndarray) -> np.ndarray:
        """(h, w) int16 entity of each triangle index."""
        entity = np.append(self.scene.entity[self.scene.part], np.int16(BACKGROUND))
        return entity[face]


def _runs(scene: Batch, skip: frozenset[int]) -> list[tuple[int, int]]:
    """Ranges of faces whose entity is not skipped."""
    starts = np.searchsorted(scene.part, np.arange(len(scene.entity) + 1))
    return [(int(starts[k]), int(starts[k + 1])) for k in range(len(scene.entity)) if int(scene.entity[k]) not in skip]


def _depth(near: np.ndarray) -> np.ndarray:
    return np.where(near > 0, 1.0 / np.maximum(near, 1e-9), 0.0).astype(np.float32)


@dataclass(frozen=True, eq=False)
class Lighting:
    """Lamps and ambience as the kernel wants them, and one depth map for each lamp."""

    lamps: np.ndarray
    ambience: np.ndarray
    vignette: float
    maps: np.ndarray

    @staticmethod
    def of(scene: Batch, light: Light, skip: frozenset[int] = frozenset()) -> Lighting:
        both = lamps(light)
        rows = [np.concatenate([la.frame.reshape(-1), -la.frame[2, :3], la.colour, [la.softness, la.texel_m]]) for la in both]
        ambience = np.array([light.sky, light.ground, [light.exposure] * 3], np.float32)
        maps = np.stack([depth_map(scene, lamp, skip) for lamp in both])
        return Lighting(np.array(rows, np.float32), ambience, light.vignette, maps)


def _paint(view: View, seen: tuple[np.ndarray, np.ndarray], light: Lighting, textures: Textures, want: np.ndarray,
           out: np.ndarray) -> None:
    s = view.scene
    geometry = (s.vertices, s.normals, s.colours, s.uv, s.faces, s.part, s.layer)
    eye = view.camera.T_world_cam[:3, 3].astype(np.float32)
    supersample = seen[0].shape[0] // view.camera.height
    shade(want, supersample, view.E, *seen, geometry, s.looks, (textures.texels, textures.levels), eye, light.lamps, light.maps,
          light.ambience, light.vignette, out)


def render(instances: Sequence[Instance], camera: Camera, light: Light, textures: Textures, *, supersample: int = 2,
           shadow_casters: Sequence[Instance] | None = None) -> Rendered:
    """An image of the instances; shadows are thrown by `shadow_casters`, by default the instances themselves."""
    view = View.of(batch(instances, textures), camera)
    casters = view.scene if shadow_casters is None else batch(shadow_casters, textures)
    rgb = np.zeros((camera.height, camera.width, 3), np.uint8)
    everywhere = np.ones(rgb.shape[:2], np.bool_)
    _paint(view, view.seen(supersample), Lighting.of(casters, light), textures, everywhere, rgb)
    face, near = view.seen(1)
    return Rendered(rgb, view.ids(face), _depth(near))


def draw_ids(instances: Sequence[Instance], camera: Camera, textures: Textures) -> tuple[np.ndarray, np.ndarray]:
    """Entity (h, w) int16 and depth (h, w) float32 metres at pixel centres, without colour."""
    view = View.of(batch(instances, textures), camera)
    face, near = view.seen(1)
    return view.ids(face), _depth(near)


def render_bundle(instances: Sequence[Instance], hands: Iterable[int], entities: int, camera: Camera, light: Light,
                  textures: Textures, *, supersample: int = 2) -> Bundle:
    """The full truth of one frame: `hands` are the entities to take away, amodal masks are for entities 0..entities-1."""
    gone = frozenset(hands)
    view = View.of(batch(instances, textures), camera)
    full, bare = view.seen(supersample), view.seen(supersample, gone)
    with_hands, without = Lighting.of(view.scene, light), Lighting.of(view.scene, light, gone)
    rgb = np.zeros((camera.height, camera.width, 3), np.uint8)
    everywhere = np.ones(rgb.shape[:2], np.bool_)
    _paint(view, full, with_hands, textures, everywhere, rgb)
    kept = rgb.copy()
    changed = (full[0] != bare[0]).reshape(camera.height, supersample, camera.width, supersample).any(axis=(1, 3))
    _paint(view, bare, with_hands, textures, changed, kept)
    clean = np.zeros_like(rgb)
    _paint(view, bare, without, textures, everywhere, clean)
    face, near = view.seen(1)
    amodal = np.stack([view.alone(k) for k in range(entities)])
    return Bundle(rgb, clean, kept, view.ids(face), _depth(near), amodal)
