"""A small clip by hand and its recordings, made by the two recording stages."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from afford.common.image_files import encode_jpeg
from schemas.affordance import Affordances, FrameLabels, Sample, Samples
from schemas.masks import CompleteObjects, Entity, Tracks
from schemas.video import Annotation, Clip, Frames, Inpainted, KeyFrame, Narration, Polygon
from stages.recording import clip_record, stage_record

T, H, W = 6, 48, 64
HANDS = (Entity("left hand", "left hand", -1, "hand", "left"), Entity("right hand", "right hand", -1, "hand", "right"))
LABELS = {"mug": "mug", "mug#2": "mug", "Tasse (groß)": "cup"}
MUG = tuple(Entity(label, name, 13, "object", "") for label, name in LABELS.items())
NARRATION = Narration("n1", 1, 4, "nimm die Tasse über den Tisch", "take", 0, "take", "cup", 13, "cup", ("cup",))
SQUARE = Polygon(np.array([[20, 10], [120, 10], [120, 60]], np.float32))
KEYS = (KeyFrame(2, 2 * W, 2 * H, (
    Annotation("a1", "left hand", -1, "left", "a2", "y", (SQUARE,)),
    Annotation("a2", "mug", 13, "", "", "y", (SQUARE, SQUARE)))), KeyFrame(99, 2 * W, 2 * H, ()))  # fmt: skip
CLIP = Clip("c1", "c1", "P1", "", ("v.mp4",), "video", 25.0, False, 1, T, KEYS, (NARRATION,), ("frame 3 is odd",))


@dataclass
class Ctx:
    """Context of a stage: scratch folder and progress."""

    scratch: Path

    def progress(self, done: int, total: int) -> None:
        """Ignore the progress."""


def outputs(seed: int = 0) -> dict[str, object]:
    """Random outputs of the extraction stages for a clip of T frames; stage -> value."""
    rng = np.random.default_rng(seed)
    frame, entities = np.arange(1, T + 1, dtype=np.int64), HANDS + MUG
    n, rgb = len(entities), rng.integers(0, 256, (T, H, W, 3), np.uint8)
    masks = np.zeros((n, T, H, W), bool)
    for i in range(n):
        masks[i, :, 8 * i : 8 * i + 6, 5:30] = True
    per_entity = (n, T)
    contact = np.full((2, T), -1, np.int16)
    contact[0, 2:] = 2
    tracks = Tracks("c1", entities, frame, masks, rng.random(per_entity, np.float32), np.full(per_entity, 3, np.uint8),
                    np.ones(per_entity, np.int64), np.zeros(per_entity, np.int32), contact,
                    np.zeros((2, T), np.int32))  # fmt: skip
    replaced = masks[:2].any(axis=0)
    inpainted = Inpainted("c1", frame, rgb, replaced, replaced.astype(np.uint8), np.full((T, H, W), 200, np.uint8))
    index = np.where(contact >= 0, 0, -1).astype(np.int16)
    samples = tuple(
        Sample(f"c1_{n}", n, n * 40_000_000, encode_jpeg(rgb[n - 1], 90), masks[:4, n - 1], "mug", "", NARRATION, 0, 0.5, 1.0, 2, 1,
               np.zeros((4, 3, 2), np.float32), np.zeros(3, np.int64)) for n in (2, 4))  # fmt: skip
    return {
        "source_read": CLIP,
        "frame_decode": Frames("c1", frame, frame * 40_000_000, rgb),
        "mask_densify": tracks,
        "hand_inpaint": inpainted,
        "object_completion": CompleteObjects("c1", MUG, frame, masks[2:], np.ones((3, T), np.float32)),
        "affordance_intersect": Affordances("c1", MUG, frame, masks[:2], index, np.zeros(T, np.int8), np.zeros(T, np.int8),
                                            np.ones(T, np.float32), np.zeros(T, np.uint8)),
        "narration_labelling": FrameLabels("c1", (NARRATION,), frame[:4], np.zeros(4, np.int32), (), ()),
        "sample_assemble": Samples("c1", "c1", "P1", "", W, H, samples, (("no_contact", 4),)),
    }  # fmt: skip


def recorded(folder: Path, seed: int = 0) -> Path:
    """The recording of that clip: every stage by itself, then merged."""
    made = outputs(seed)
    frames, parts = made["frame_decode"], []
    for stage, value in made.items():
        (folder / stage).mkdir(parents=True)
        parts.append(stage_record.run(value, frames, stage_record.Params(stage), Ctx(folder / stage)))
    return clip_record.run(CLIP, tuple(parts), clip_record.Params(), Ctx(folder)).files[0].path
