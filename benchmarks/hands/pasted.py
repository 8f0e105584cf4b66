"""Composite clips: rendered hands with arms and objects before photographs, as video with exact truth.

Hands, grasps and objects move as in the rendered kitchens. The room is replaced: by a photographed surface as the table top, or
by a photograph that fills the background, still or moving with the camera's rotation. The camera looks as the person or faces
the person, who then has a torso, and sometimes a head with a photographed face beside it.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path

import cv2
import numpy as np

from afford.common.palette import TONES
from afford.common.video.frames import write_video
from afford.render import materials
from afford.render.camera import intrinsics, look_at
from afford.render.draw import render
from afford.render.mesh import transform, translate
from afford.render.raster import View
from afford.render.scene import Camera, Instance, Light, Material, Textures, batch
from afford.render.solids import lathe, patch, tube
from afford.synthetic.human_hand.skeleton import POSTURES
from afford.synthetic.human_hand.skin import ARM_M
from afford.synthetic.kitchens.animation import DURATION
from afford.synthetic.kitchens.world import World, build_world, elbow
from afford.synthetic.sensor import add_image_noise
from benchmarks.hands.clip_truth import VIDEO, ClipTruth
from benchmarks.hands.keypoints import in_camera, world_keypoints
from benchmarks.hands.photographs import photographs, read
from benchmarks.hands.rendered import SLEEVE, Moment, labelled, of_ids, stacked
from schemas.scene import SceneSpec
from schemas.video import SIDES

SIZE = (1280, 720)
RATE_HZ = 12
TEXTURE_PX = 1024


@dataclass(frozen=True)
class CompositeSpec:
    """Specification of a composite clip; the same spec and photographs give the same video."""

    name: str
    script: str
    setting: str
    seed: int
    viewpoint: str = "ego"
    background: str = "surface"
    """surface (a table top) or scene (behind everything)"""
    moving: bool = False
    """whether the camera moves"""
    frames: int = 36
    zoom: float = 1.0
    """size of the hands, 1: about 250 px from wrist to fingertip"""
    light: float = 1.0
    """exposure; below 0.5 with much noise"""
    blur: int = 1
    """pictures averaged over the exposure, 1: no motion blur"""
    crf: int = 26
    hands: int = 2
    """hands that appear; with one, the idler hand is left out"""
    free: bool = False
    """whether the hands gesture and touch nothing"""
    contrast: float = 1.0
    """strength of the key light against the light from everywhere"""
    face: bool = False
    """whether a photographed face is beside the hands"""


Hands = Callable[[World, float], tuple[list[Instance], list[np.ndarray]]]
"""instances of both hands at a time, sleeves with entity SLEEVE + side, and their keypoints, each (21, 3), world, metres"""


def own_hands(world: World, time: float) -> tuple[list[Instance], list[np.ndarray]]:
    """Draw the hands of the rendered kitchens."""
    drawn = [i for i in world.instances(time) if i.entity in (0, 1)]
    points = [world_keypoints(hand, world.animation.arms[side].track.at(time), world.fingers[n].at(time))
              for n, (side, hand) in enumerate(zip(SIDES, world.hands, strict=True))]  # fmt: skip
    return list(labelled(drawn, world.hands[0].look)), points


def composite(spec: CompositeSpec, pictures: Path, folder: Path, hands: Hands = own_hands) -> ClipTruth:
    """Render a composite clip below `folder` and return its truth."""
    world = build_world(SceneSpec("P79_01", spec.script, spec.setting, spec.seed))
    world = gesturing(world, spec.seed) if spec.free else world
    rng = np.random.default_rng([spec.seed, 79])
    backdrop = _Backdrop.drawn(spec, pictures, world.hands[0].look.cloth, rng)
    stage = _Stage(spec, world, hands, backdrop, _camera(spec, world, rng), _light(spec, rng), rng)
    images, rows = [], []
    for t in range(spec.frames):
        image, row = stage.shot(t)
        images.append(image)
        rows.append(row)
    write_video(folder / VIDEO, images, spec.crf, RATE_HZ)
    truth = stacked(spec.name, spec.viewpoint, list(range(1, spec.frames + 1)), rows)
    truth.save(folder)
    return truth


@dataclass(frozen=True, eq=False)
class _Backdrop:
    """Photographed background: instances of it, and a picture behind everything."""

    instances: tuple[Instance, ...]
    behind: np.ndarray

    @staticmethod
    def drawn(spec: CompositeSpec, root: Path, cloth: Material, rng: np.random.Generator) -> _Backdrop:
        """Choose photographs at random."""
        def pick(kind: str) -> np.ndarray:
            found = photographs(root, kind)
            return read(found[int(rng.integers(len(found)))])

        around = 1.5 if spec.background == "surface" else 1.25
        behind = _filled(pick(spec.background if spec.background == "scene" else "scene"), around)
        out: list[Instance] = []
        if spec.background == "surface":
            image = cv2.resize(pick("surface"), (TEXTURE_PX, TEXTURE_PX), interpolation=cv2.INTER_AREA)
            mirrored = np.concatenate([image, image[:, ::-1]], 1)
            tiled = np.concatenate([mirrored, mirrored[::-1]])
            wide = float(rng.uniform(0.5, 1.3))
            top = patch((-3, -1.5 if spec.viewpoint == "ego" else -0.25, 0), (6, 0, 0), (0, 3.5, 0), (3 / wide, 1.75 / wide))
            out.append(Instance(top, Material(np.ascontiguousarray(tiled), roughness=0.6), casts=False))
        if spec.viewpoint == "facing":
            out += _person(cloth, rng)
        if spec.face:
            out.append(_portrait(pick("face"), spec.viewpoint, rng))
        return _Backdrop(tuple(out), behind)

    def seen(self, turn: np.ndarray) -> np.ndarray:
        """Return the background picture at the video's size; `turn` (3, 3) maps pixels of the first view to this one."""
        margin = (np.array(self.behind.shape[1::-1]) - SIZE) / 2
        centre = np.array([[1, 0, -margin[0]], [0, 1, -margin[1]], [0, 0, 1.0]])
        return np.asarray(cv2.warpPerspective(self.behind, turn @ centre, SIZE, flags=cv2.INTER_LINEAR,
                                              borderMode=cv2.BORDER_REFLECT_101))  # fmt: skip


def _filled(image: np.ndarray, around: float) -> np.ndarray:
    """Crop and scale a picture to the video's shape, `around` times as large."""
    want = (round(SIZE[0] * around), round(SIZE[1] * around))
    scale = max(want[0] / image.shape[1], want[1] / image.shape[0])
    big = cv2.resize(image, None, fx=scale, fy=scale, interpolation=cv2.INTER_AREA if scale < 1 else cv2.INTER_CUBIC)
    y, x = (big.shape[0] - want[1]) // 2, (big.shape[1] - want[0]) // 2
    return np.ascontiguousarray(big[y : y + want[1], x : x + want[0]])


def _person(cloth: Material, rng: np.random.Generator) -> list[Instance]:
    """Build the torso and the bare head, without a face, of the person who sits behind the table."""
    shoulders = [(0.165, 0.2), (0.15, 0.31), (0.10, 0.36), (0.06, 0.385), (0.055, 0.42), (0, 0.42)]
    outline = np.array([(0, -0.5), (0.15, -0.5), (0.16, 0.0), *shoulders])
    chest = translate(transform(lathe(outline, 40), np.diag([1.35, 0.8, 1.0, 1.0])), 0.0, -0.52, 0.0)
    skull = np.array([(0, -0.13), (0.05, -0.12), (0.075, -0.03), (0.078, 0.05), (0.055, 0.11), (0, 0.13)])
    head = translate(lathe(skull, 32), 0.0, -0.50, 0.57)
    tone = np.array(TONES[int(rng.integers(len(TONES)))])
    return [Instance(chest, cloth), Instance(head, materials.skin(rng, tuple(tone)))]


def upper_arms(world: World, time: float) -> list[Instance]:
    """Build the sleeved upper arms from the elbows to the shoulders, which a camera that faces the person sees."""
    out = []
    for n, side in enumerate(SIDES):
        palm = world.animation.arms[side].track.at(time)
        wrist = world.hands[n].wrist(palm)
        along = elbow(side, palm) - wrist
        end = wrist + ARM_M * along / np.linalg.norm(along)
        line = np.linspace(end - 0.02 * along / np.linalg.norm(along), np.array([(-0.2, 0.2)[n], -0.52, 0.30]), 12)
        out.append(Instance(tube(line, np.full(12, 0.066), 24), world.hands[0].look.cloth, entity=SLEEVE + n))
    return out


def _portrait(image: np.ndarray, viewpoint: str, rng: np.random.Generator) -> Instance:
    """Build a picture of a face: lying on the table, or on the wall behind the person."""
    square = cv2.resize(image, (512, 512), interpolation=cv2.INTER_AREA)
    look = Material(np.ascontiguousarray(square), roughness=0.7)
    if viewpoint == "ego":
        x, y = float(rng.uniform(-0.4, 0.15)), float(rng.uniform(0.1, 0.3))
        return Instance(patch((x, y, 0.004), (0.24, 0, 0), (0, 0.24, 0)), look, casts=False)
    x = float(rng.choice([-0.75, 0.4]))
    return Instance(patch((x + 0.4, -0.7, 0.2), (-0.4, 0, 0), (0, 0, 0.4)), look, casts=False)


def _camera(spec: CompositeSpec, world: World, rng: np.random.Generator) -> Callable[[float], Camera]:
    """Choose a camera: world.camera with another lens, or one that faces the person; still unless `moving`."""
    if spec.viewpoint == "ego":
        K = intrinsics(*SIZE, float(np.clip(62 / spec.zoom, 30, 105)))
        fixed = world.camera(float(rng.uniform(30, 60))).T_world_cam
        return lambda time: Camera(K, world.camera(time).T_world_cam if spec.moving else fixed, *SIZE)
    K = intrinsics(*SIZE, float(rng.uniform(50, 70)))
    away = 0.95 / spec.zoom
    eye = np.array([rng.uniform(-0.3, 0.3), 0.1 + away * 0.85, 0.1 + away * rng.uniform(0.35, 0.65)])
    phase = rng.uniform(0, 6.28, 3)

    def facing(time: float) -> Camera:
        shift = 0.02 * np.sin(time / 17 + phase) * spec.moving
        return Camera(K, look_at(eye + shift, np.array([0, -0.1, 0.12]) + shift[::-1]), *SIZE)

    return facing


def _light(spec: CompositeSpec, rng: np.random.Generator) -> Light:
    """Choose light of a random colour and direction."""
    warm = np.array([1.25, 1.0, 0.72]) ** rng.uniform(-0.7, 1.0)
    angle = rng.uniform(0, 2 * np.pi)
    towards = (0.7 * np.cos(angle), 0.7 * np.sin(angle), -0.8)
    strength = rng.uniform(0.6, 1.2)
    white = ((1.8, 1.75, 1.6), (0.6, 0.6, 0.62), (0.4, 0.4, 0.42))
    shares = (spec.contrast, 1 / spec.contrast, 1 / spec.contrast)
    colours = [np.array(base) * warm * strength * share for base, share in zip(white, shares, strict=True)]
    key, ceiling, sky = ((float(r), float(g), float(b)) for r, g, b in colours)
    return Light(towards, key, ceiling, sky, softness=float(rng.uniform(0.05, 0.4)), centre=(0.0, 0.15, 0.1),
                 radius_m=1.1, exposure=spec.light * float(rng.uniform(0.85, 1.2)), vignette=0.0)  # fmt: skip


@dataclass(frozen=True, eq=False)
class _Stage:
    """Spec, world, background, camera and light of a clip: the means to picture its frames."""

    spec: CompositeSpec
    world: World
    hands: Hands
    backdrop: _Backdrop
    camera: Callable[[float], Camera]
    light: Light
    rng: np.random.Generator
    pool: list[Textures] = field(default_factory=list)
    """textures of the last frame; a clip's frames share their materials"""

    def shot(self, t: int) -> tuple[np.ndarray, Moment]:
        """Picture frame `t`, averaged over the exposure, with noise; the truth is that of the exposure's middle."""
        spec, step = self.spec, DURATION / self.spec.frames
        offsets = (np.arange(spec.blur) - (spec.blur - 1) / 2) / spec.blur * 0.7
        layers = [self._picture((t + 0.5 + offset) * step) for offset in offsets]
        image = np.mean([layer for layer, _ in layers], axis=0)
        noisy = add_image_noise(np.clip(image + 0.5, 0, 255).astype(np.uint8), self.rng)
        if spec.light < 0.5:
            grain = cv2.GaussianBlur(self.rng.standard_normal(noisy.shape).astype(np.float32), (0, 0), 0.8)
            noisy = np.clip(noisy + 12 * grain, 0, 255).astype(np.uint8)
        return noisy, layers[len(layers) // 2][1]

    def _textures(self, parts: Sequence[Instance]) -> Textures:
        if not self.pool or any(id(part.material.image) not in self.pool[0].layer for part in parts):
            self.pool[:] = [Textures.of(part.material for part in parts)]
        return self.pool[0]

    def _picture(self, time: float) -> tuple[np.ndarray, Moment]:
        camera, first = self.camera(time), self.camera(0.5 * DURATION)
        drawn, points = self.hands(self.world, time)
        drawn += upper_arms(self.world, time) if self.spec.viewpoint == "facing" else []
        gone = hidden(self.world, self.spec.hands)
        drawn = [i for i in drawn if i.entity % SLEEVE not in gone]
        held = [interval.obj for arm in self.world.animation.arms.values() for interval in arm.grip_intervals]
        shown = held if self.spec.background == "scene" else list(self.world.objects)
        things = [part for n, obj in enumerate(self.world.objects) if any(obj is one for one in shown)
                  for part in obj.model.instances(obj.at(time), n + 2, float(obj.opened.at(time)[0]))]  # fmt: skip
        things = [] if len(gone) == 2 or self.spec.free else things
        parts: Sequence[Instance] = [*self.backdrop.instances, *drawn, *things]
        textures = self._textures(parts)
        view = View.of(batch(parts, textures), camera)
        picture = render(parts, camera, self.light, textures)
        cover = (view.seen(2)[1][0] >= 0).reshape(SIZE[1], 2, SIZE[0], 2).mean(axis=(1, 3), dtype=np.float32)[..., None]
        turn = camera.K @ camera.T_world_cam[:3, :3].T @ first.T_world_cam[:3, :3] @ np.linalg.inv(first.K)
        behind = self.backdrop.seen(turn) * min(self.spec.light, 1.0) ** 0.45
        left, right = (-1 if n in gone or self.spec.free else c for n, c in enumerate(self.world.contacts(time)))
        row = of_ids(picture.ids, (left, right), [in_camera(p, camera) for p in points])
        return picture.rgb + (1 - cover) * behind, row


def hidden(world: World, hands: int) -> tuple[int, ...]:
    """Return the indices of the sides that do not appear; of two hands the one that holds for the shorter time."""
    held = [sum(i.stop - i.start for i in world.animation.arms[side].grip_intervals) for side in SIDES]
    return ((0, 1), (int(np.argmin(held)),), ())[hands]


@dataclass(frozen=True)
class _Gestures:
    """Finger motion of a hand that touches nothing: postures that follow one another."""

    angles: np.ndarray
    """(n, 20) rad, at equal distances in time"""

    def at(self, time: float) -> np.ndarray:
        """Return the joint angles (20,) at a time, radians."""
        place = time / DURATION * (len(self.angles) - 1)
        k = int(np.clip(place, 0, len(self.angles) - 2))
        share = float(np.clip(place - k, 0, 1))
        return np.asarray(self.angles[k] + (3 * share**2 - 2 * share**3) * (self.angles[k + 1] - self.angles[k]))


def gesturing(world: World, seed: int) -> World:
    """Return the world with fingers that move through random postures."""
    rng, names = np.random.default_rng([seed, 97]), sorted(POSTURES)
    fingers = [_Gestures(np.array([POSTURES[names[int(n)]] for n in rng.integers(0, len(names), 7)])) for _ in SIDES]
    return replace(world, fingers=(fingers[0], fingers[1]))  # type: ignore[arg-type]  # the same interface


def gloved(spec: CompositeSpec) -> CompositeSpec:
    """Return the first spec with another seed whose person wears gloves."""
    for seed in range(spec.seed, spec.seed + 200):
        if build_world(SceneSpec("P79_01", spec.script, spec.setting, seed)).hands[0].look.gloved:
            return replace(spec, seed=seed)
    raise ValueError(f"{spec.name}: no gloves in 200 seeds; choose another seed")
