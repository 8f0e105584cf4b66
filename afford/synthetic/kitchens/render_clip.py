"""Rendering of a kitchen clip: noisy frames, their ground truth, and the files of an EPIC root.

Contact masks are visible hand pixels whose 3-D point lies within `THRESHOLD_M` of the surface of the touched object.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import trimesh
from blake3 import blake3
from scipy.spatial import cKDTree

from afford.codecs import save
from afford.common.folders import media_of
from afford.common.video.frames import write_video
from afford.render.draw import render_bundle
from afford.render.scene import Bundle, Camera
from afford.synthetic.assets.object_model import Part
from afford.synthetic.kitchens import epic_files
from afford.synthetic.kitchens.animation import DURATION, Animation, NarratedAction
from afford.synthetic.kitchens.world import HEIGHT, WIDTH, World
from afford.synthetic.sensor import add_image_noise
from schemas.files import FileRef, FileTree
from schemas.scene import ClipTruth, RenderedClip, SceneSpec
from schemas.video import Narration

THRESHOLD_M = 0.005
SPACING_M = 0.0022


class ContactFinder:
    """Contact query for the objects of a world, from point clouds of their surfaces."""

    def __init__(self, world: World) -> None:
        self.world = world
        self._trees: dict[tuple[int, bool], cKDTree] = {}

    def near(self, camera: Camera, depth_m: np.ndarray, mask: np.ndarray, entity: int, time: float) -> np.ndarray:
        """Mark the pixels of `mask` whose 3-D point lies within 5 mm of the surface of `entity` at `time`, (h, w) bool."""
        y, x = np.nonzero(mask)
        out = np.zeros(mask.shape, bool)
        points = _unproject(camera, x, y, depth_m[y, x])
        obj = self.world.objects[entity - 2]
        joint = obj.model.joint
        for moving in {part.moving for part in obj.model.parts}:
            swing = joint.T_obj_moving(float(obj.opened.at(time)[0])) if moving and joint else np.eye(4)
            back = np.linalg.inv(obj.at(time) @ swing)
            local = points @ back[:3, :3].T + back[:3, 3]
            gap, _ = self._tree(entity, moving).query(local, distance_upper_bound=THRESHOLD_M)
            out[y, x] |= np.isfinite(gap)
        return out

    def _tree(self, entity: int, moving: bool) -> cKDTree:
        key = (entity, moving)
        if key not in self._trees:
            parts = [part for part in self.world.objects[entity - 2].model.parts if part.moving == moving]
            self._trees[key] = cKDTree(np.concatenate([_sample_surface(part) for part in parts]))
        return self._trees[key]


def _sample_surface(part: Part) -> np.ndarray:
    """Sample a surface about `SPACING_M` apart, and append its vertices; (n, 3) metres, object frame."""
    surface = trimesh.Trimesh(part.mesh.vertices, part.mesh.faces, process=False)
    count = int(2 * surface.area / SPACING_M**2) + 1
    points, _ = trimesh.sample.sample_surface(surface, count, seed=0)
    return np.concatenate([np.asarray(points), part.mesh.vertices])


def _unproject(camera: Camera, x: np.ndarray, y: np.ndarray, depth_m: np.ndarray) -> np.ndarray:
    """Unproject pixels at a depth to world points (n, 3), metres."""
    K, T = camera.K, camera.T_world_cam
    local = np.stack([(x - K[0, 2]) / K[0, 0], (y - K[1, 2]) / K[1, 1], np.ones(len(x))], axis=1) * depth_m[:, None]
    return local @ T[:3, :3].T + T[:3, 3]


HANDS = (0, 1)
SLIVER_PX = 12
"""Smallest visible area of an entity, in pixels; a smaller one counts as out of sight."""


@dataclass(frozen=True)
class RenderedFrames:
    """Frames with sensor noise, (t, h, w, 3) uint8, and their ground truth."""

    images: np.ndarray
    truth: ClipTruth


def render_frames(spec: SceneSpec, world: World, supersample: int, progress: Callable[[int, int], None]) -> RenderedFrames:
    """Render every frame of a clip and collect its ground truth."""
    count, n = spec.frames, len(world.entities)
    shape = (count, HEIGHT, WIDTH)
    rgb, clean, kept = (np.zeros((*shape, 3), np.uint8) for _ in range(3))
    visible, amodal = np.zeros((n, *shape), bool), np.zeros((n, *shape), bool)
    depth, touch = np.zeros(shape, np.uint16), np.zeros((2, *shape), bool)
    contact, poses = np.full((2, count), -1, np.int16), np.zeros((count, 4, 4))
    surfaces, noise = ContactFinder(world), np.random.default_rng([spec.seed, 7])
    for t in range(count):
        time = t * DURATION / count
        camera = world.camera(time)
        bundle = render_bundle(world.instances(time), HANDS, n, camera, world.room.light, world.textures, supersample=supersample)
        rgb[t] = add_image_noise(bundle.rgb, noise)
        clean[t], kept[t] = bundle.rgb_no_hands, bundle.rgb_no_hands_shadow
        visible[:, t], amodal[:, t] = visible_masks(bundle, n), bundle.amodal
        depth[t] = np.round(1000 * bundle.depth_m).astype(np.uint16)
        contact[:, t], poses[t] = world.contacts(time), camera.T_world_cam
        touch[:, t] = _contact_masks(surfaces, camera, bundle, contact[:, t], time)
        progress(t + 1, count)
    frame = np.arange(1, count + 1, dtype=np.int64)
    truth = ClipTruth(
        spec.video_id,
        world.animation.hard,
        world.entities,
        frame,
        visible,
        amodal,
        clean,
        kept,
        depth,
        contact,
        touch,
        world.K,
        poses,
    )
    return RenderedFrames(rgb, truth)


def visible_masks(bundle: Bundle, count: int) -> np.ndarray:
    """Return the visible pixels of each entity, (n, h, w) bool, without areas below `SLIVER_PX`."""
    masks = bundle.ids[None] == np.arange(count, dtype=np.int16)[:, None, None]
    masks[masks.sum(axis=(1, 2)) < SLIVER_PX] = False
    return masks


def _contact_masks(surfaces: ContactFinder, camera: Camera, bundle: Bundle, contact: np.ndarray, time: float) -> np.ndarray:
    out = np.zeros((2, *bundle.ids.shape), bool)
    for hand, entity in enumerate(contact):
        if entity >= 0:
            out[hand] = surfaces.near(camera, bundle.depth_m, bundle.ids == hand, int(entity), time)
    return out


def write_clip(root: Path, spec: SceneSpec, animation: Animation, recording: RenderedFrames, crf: int) -> RenderedClip:
    """Write all files of a clip below `root`. Raises ValueError for a split other than train and val."""
    if spec.split not in epic_files.ACTION_FILES:
        raise ValueError(f"SceneSpec.split: expected one of {', '.join(epic_files.ACTION_FILES)}, got {spec.split!r}")
    truth, person = recording.truth, spec.video_id.split("_")[0]
    narrations = [_narration(spec, number, action) for number, action in enumerate(animation.narrations)]
    write_video(root / "videos" / person / f"{spec.video_id}.MP4", recording.images, crf)
    annotations = root / "GroundTruth-SparseAnnotations" / "annotations" / spec.split / f"{spec.video_id}.json"
    epic_files.write_annotations(annotations, spec.video_id, truth.entities, _keys(spec, truth))
    epic_files.write_actions(root, spec.video_id, spec.split, sorted(narrations, key=lambda n: n.start_frame))
    epic_files.write_classes(root, (noun for action in animation.narrations for noun in action.nouns))
    height, width = recording.images.shape[1:3]
    epic_files.write_info(root, spec.video_id, spec.frames, width, height)
    folder = root / "truth" / spec.video_id
    folder.mkdir(parents=True, exist_ok=True)
    save(truth, folder)
    return rendered_clip(root, spec.video_id)


def rendered_clip(root: Path, video_id: str) -> RenderedClip:
    """Index the files of the root of one video as a RenderedClip."""
    names = sorted(path.relative_to(root).as_posix() for path in root.rglob("*") if path.is_file())
    refs = [_ref(root, name) for name in names]
    files = FileTree(video_id, tuple(ref for ref in refs if not ref.name.startswith("truth/")))
    return RenderedClip(
        files=files, media=media_of(files), truth=FileTree(video_id, tuple(ref for ref in refs if ref.name.startswith("truth/")))
    )


def _ref(root: Path, name: str) -> FileRef:
    data = (root / name).read_bytes()
    return FileRef(name, blake3(data).hexdigest(), len(data), root / name)


def _keys(spec: SceneSpec, truth: ClipTruth) -> list[epic_files.KeyMasks]:
    indices = np.arange(0, spec.frames, spec.key_gap)
    return [
        epic_files.KeyMasks(int(t) + 1, truth.visible[:, t], (int(truth.contact[0, t]), int(truth.contact[1, t]))) for t in indices
    ]


def _narration(spec: SceneSpec, number: int, action: NarratedAction) -> Narration:
    start, stop = (round(time * spec.frames / DURATION) + 1 for time in (action.start, action.stop))
    interval = (min(max(1, start), spec.frames), min(max(1, start, stop), spec.frames))
    return epic_files.narration(spec.video_id, number, interval, action.text, action.verb, action.nouns)
