"""A sample -> one row of the table, in the columns of `columns.py`."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

from afford.dataset import masks
from afford.dataset.columns import MASKS, PATHS
from schemas.affordance import Sample, Samples, Taxonomy

TAXONOMY3 = {Taxonomy.LEFT: 0, Taxonomy.RIGHT: 0, Taxonomy.BOTH_SAME: 1, Taxonomy.BOTH_DIFFERENT: 2}


def row(clip: Samples, sample: Sample, verbs: dict[str, int], nouns: dict[str, int], provenance: str) -> dict[str, Any]:
    """One row; `verbs` and `nouns` map class keys to labels."""
    return {
        "sample_id": sample.sample_id,
        "image": {"bytes": sample.image_jpeg.tobytes(), "path": f"{sample.sample_id}.jpg"},
        "object_left": sample.object_left,
        "object_right": sample.object_right,
        "taxonomy": sample.taxonomy,
        "taxonomy3": TAXONOMY3[Taxonomy(sample.taxonomy)],
        "quality": sample.quality,
        "inpaint_confidence": sample.inpaint_confidence,
        "key_frame": sample.key_frame,
        "key_distance": sample.key_distance,
        "provenance": provenance,
        **source(clip, sample),
        **task(sample, verbs, nouns),
        **dict(_masks(sample)),
        "motion": dict(zip(PATHS, sample.motion.tolist(), strict=True)),
        "motion_time_ns": sample.motion_time_ns.tolist(),
    }


def source(clip: Samples, sample: Sample) -> dict[str, Any]:
    """Columns that say where the sample comes from."""
    return {
        "video": clip.video_id,
        "clip": clip.clip_id,
        "participant": clip.participant_id,
        "frame": sample.frame,
        "time_ns": sample.time_ns,
        "timestamp": sample.time_ns / 1e9,
        "width": clip.width_px,
        "height": clip.height_px,
    }


def task(sample: Sample, verbs: dict[str, int], nouns: dict[str, int]) -> dict[str, Any]:
    """Columns of the narration."""
    said = sample.narration
    return {
        "narration": said.text,
        "narration_id": said.narration_id,
        "verb": said.verb,
        "noun": said.noun,
        "verb_class": verbs[said.verb_key],
        "noun_class": nouns[said.noun_key],
        "verb_epic_id": said.verb_class,
        "noun_epic_id": said.noun_class,
        "all_nouns": list(said.all_nouns),
    }


def _masks(sample: Sample) -> Iterator[tuple[str, Any]]:
    height, width = sample.masks.shape[1:]
    counts = masks.encode_rle(sample.masks)
    boxes, areas = masks.boxes(counts, height, width), masks.areas(counts, height, width)
    for name, mask, count, box, area in zip(MASKS, sample.masks, counts, boxes, areas, strict=True):
        png = masks.encode_png(mask) if area else masks.empty_png(height, width)
        yield name, {"bytes": png, "path": f"{sample.sample_id}.{name}.png"}
        yield f"{name}_rle", count.decode("ascii")
        yield f"{name}_area", area
        yield f"{name}_bbox", box
