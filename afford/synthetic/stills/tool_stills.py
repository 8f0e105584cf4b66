"""Stills of one object alone on a table: where the hand belongs for a task, as its parts say.

No hand is closed on the object, so a region is the whole part, unlike in rooms. The hand is the one on whose side the part is; near
the middle of the picture both are valid.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np
import trimesh

from afford.common.image_files import encode_jpeg
from afford.render.camera import intrinsics, look_at
from afford.render.draw import draw_ids, render
from afford.render.motion import axis_angle, pose
from afford.render.scene import Camera, Instance, Textures
from afford.render.views.draw import drawable, material
from afford.synthetic.kitchens import rooms
from afford.synthetic.kitchens.scene_builder import CENTRE
from afford.synthetic.kitchens.vocabulary import VERBS
from afford.synthetic.sensor import add_image_noise
from afford.synthetic.stills.painters import Painter
from afford.synthetic.stills.render_stills import MIN_AREA, RenderQuality
from afford.synthetic.stills.still_world import Layout
from schemas.mesh import MeshParts, ObjectMesh
from schemas.scene import Mode, Picture, Still, Stills
from schemas.video import Narration

PERSON = "P83"
"""participant of all objects alone"""
SETTINGS = ("kitchen", "workshop", "desk")
MATS = 0.3
"""share of pictures with mats under the object"""
AS_BUILT = 0.6
"""share of pictures in which the object stands or lies as it was built; in the others it rests on another side of its hull"""
PLACE_M, AZIMUTH_DEG, PITCH_DEG, FIELD_DEG, ROLL_RAD = 0.08, 35.0, (30.0, 80.0), (38.0, 62.0), 0.08
FILLED = (0.3, 0.85)
"""share of the picture's width that the object takes, seen along its diagonal"""
SIDE_SCALE, LEAST_SHARE = 0.08, 0.15
"""widths of the picture within which the preferred hand changes; least probability of a mode that is kept"""
MIDDLE_SHIFT = 0.02
"""share of the width by which the right hand is preferred in the middle"""


@dataclass(frozen=True)
class Use:
    """Task in words, with its verb, and the names of the parts where the hand belongs."""

    text: str
    verb: str
    parts: tuple[str, ...]


@dataclass(frozen=True, eq=False)
class Seen:
    """Picture of the object: rgb (h, w, 3) uint8; part (mask h, mask w) int16 index of the visible part, -1 beside the object."""

    rgb: np.ndarray
    part: np.ndarray


def render_tool(mesh: ObjectMesh, parts: MeshParts, uses: Sequence[Use], split: str, views: int, tasks: int, seed: int,
                quality: RenderQuality, progress: Callable[[int, int], None],
                painter: Painter | None = None) -> Stills:  # fmt: skip
    """Render an object alone `views` times, with up to `tasks` of its uses each time. All painters show the same scenes."""
    poses = rest_poses(mesh)
    pictures: list[Picture] = []
    found: list[Still] = []
    for number in range(views):
        rng = np.random.default_rng((seed, number))
        asked = rng.permutation(len(uses))[:tasks]
        seen = _take_picture(mesh, parts, poses, quality, rng, painter)
        pictures.append(Picture(encode_jpeg(seen.rgb, quality.jpeg_quality)))
        for k in asked:
            modes = _modes(mesh.category, parts, uses[k], seen.part)
            if modes:
                text = _narration(mesh, len(found) + 1, uses[k])
                found.append(Still(len(found) + 1, number, text, (mesh.category,), False, modes))
        progress(number + 1, views)
    width, height = quality.sizes.image
    return Stills(f"{PERSON}_{mesh.name}", PERSON, split, "table", width, height, tuple(pictures), tuple(found))


def rest_poses(mesh: ObjectMesh) -> tuple[np.ndarray, np.ndarray]:
    """Poses (n, 4, 4) T_table_obj in which the object rests on a face of its hull, and their probabilities (n,), by solid angle.

    An object rests on the faces that are below its centre of mass.
    """
    body = trimesh.Trimesh(mesh.vertices, mesh.faces)
    hull, centre = body.convex_hull, body.center_mass
    flat = centre - np.sum((centre - hull.triangles[:, 0]) * hull.face_normals, 1)[:, None] * hull.face_normals
    below = np.flatnonzero((trimesh.triangles.points_to_barycentric(hull.triangles, flat) >= -1e-9).all(1))
    poses = np.array([trimesh.geometry.plane_transform(hull.triangles_center[n], -hull.face_normals[n]) for n in below])
    share = hull.area_faces[below] / np.sum((centre - flat[below]) ** 2, 1)
    return poses, share / share.sum()


def _take_picture(mesh: ObjectMesh, parts: MeshParts, poses: tuple[np.ndarray, np.ndarray], quality: RenderQuality,
                  rng: np.random.Generator, painter: Painter | None) -> Seen:  # fmt: skip
    """Put the object on the table of another room, and render it with its visible parts."""
    setting = str(rng.choice(SETTINGS))
    room = rooms.build_empty(setting, rng)
    mats = rooms.place_mats(setting, rng, CENTRE) if rng.random() < MATS else []
    rest = np.eye(4) if rng.random() < AS_BUILT else poses[0][rng.choice(len(poses[1]), p=poses[1])]
    at = (*(CENTRE + rng.uniform(-PLACE_M, PLACE_M, 2)), 0.0)
    T = pose(at, axis_angle((0, 0, 1), rng.uniform(-np.pi, np.pi))) @ rest
    surroundings = [*room.instances, *mats]
    shown = [*surroundings, Instance(drawable(mesh), material(mesh.texture), T, 0)]
    image, mask = _cameras(mesh.vertices @ T[:3, :3].T + T[:3, 3], quality, rng)
    if painter is None:
        textures = Textures.of(one.material for one in shown)
        rgb = add_image_noise(render(shown, image, room.light, textures, supersample=quality.supersample).rgb, rng)
    else:
        rgb = painter(Layout((), room.light, tuple(shown)), image)
    pieces = [*surroundings, *_pieces(mesh, parts, T)]
    ids, _ = draw_ids(pieces, mask, Textures.of(one.material for one in pieces))
    return Seen(rgb, ids)


def _pieces(mesh: ObjectMesh, parts: MeshParts, T_world_obj: np.ndarray) -> Iterator[Instance]:
    """Yield an instance of each part, whose entity is the number of the part."""
    look = material(mesh.texture)
    for number in range(len(parts.names)):
        mine = parts.part == number
        if mine.any():
            yield Instance(drawable(replace(mesh, faces=mesh.faces[mine], uv=mesh.uv[mine])), look, T_world_obj, number)


def _cameras(corners: np.ndarray, quality: RenderQuality, rng: np.random.Generator) -> tuple[Camera, Camera]:
    """Cameras of image and masks: above the near side, at a distance at which the object takes a share of the width."""
    low, high = corners.min(0), corners.max(0)
    field, share = float(rng.uniform(*FIELD_DEG)), float(rng.uniform(*FILLED))
    azimuth, pitch = np.radians(rng.uniform(-AZIMUTH_DEG, AZIMUTH_DEG)), np.radians(rng.uniform(*PITCH_DEG))
    towards = np.array([np.sin(azimuth) * np.cos(pitch), -np.cos(azimuth) * np.cos(pitch), np.sin(pitch)])
    distance = float(np.linalg.norm(high - low)) / (2 * np.tan(np.radians(field) / 2) * share)
    middle = (low + high) / 2
    T = look_at(middle + max(distance, 0.2) * towards, middle, float(rng.uniform(-ROLL_RAD, ROLL_RAD)))
    image, mask = (Camera(intrinsics(*size, field), T, *size) for size in (quality.sizes.image, quality.sizes.mask))
    return image, mask


def _modes(category: str, parts: MeshParts, use: Use, part: np.ndarray) -> tuple[Mode, ...]:
    """Hold the visible positive parts with the hand of their side, or with either; none where too little of them is visible."""
    region = np.isin(part, [n for n, name in enumerate(parts.names) if name in use.parts])
    if np.count_nonzero(region) < MIN_AREA * region.size:
        return ()
    x = float(np.nonzero(region)[1].mean()) / region.shape[1] - 0.5 + MIDDLE_SHIFT
    right = 1 / (1 + np.exp(-x / SIDE_SCALE))
    kept = [(side, share) for side, share in enumerate((1 - right, right)) if share >= LEAST_SHARE]
    total, grip = sum(share for _, share in kept), " ".join(use.parts)
    return tuple(_mode(side, region, part >= 0, category, grip, share / total) for side, share in sorted(kept, key=lambda k: -k[1]))


def _mode(side: int, region: np.ndarray, whole: np.ndarray, category: str, grip: str, share: float) -> Mode:
    masks = np.zeros((4, *region.shape), np.bool_)
    masks[side], masks[2 + side] = region, whole
    names, grips = ((word, "") if side == 0 else ("", word) for word in (category.replace("_", " "), grip))
    return Mode(masks, names, grips, side, float(share))


def _narration(mesh: ObjectMesh, number: int, use: Use) -> Narration:
    """Narration of a use; verbs outside EPIC's map, and the noun, are classes of their own."""
    noun, known = mesh.category.replace("_", " "), next((one for one in VERBS if use.verb in one.instances), None)
    return Narration(f"{PERSON}_{mesh.name}_{number}", number, number, use.text, use.verb, known.id if known else -1,
                     known.key if known else use.verb, noun, -1, noun, (noun,))  # fmt: skip
