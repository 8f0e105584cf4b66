"""Table schema of the data set: columns, Arrow types, verb and noun classes, and the conversion of a sample to a row.

The Hugging Face metadata lets `datasets` decode the columns without code of this project.
"""

from __future__ import annotations

import json
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass
from typing import Any

import pyarrow as pa

from afford.dataset import masks
from schemas.affordance import TAXONOMY, Sample, Samples, Taxonomy


@dataclass(frozen=True)
class Classes:
    """Verb or noun classes of one data set: EPIC's classes in EPIC's order, then new ones. The label is the index."""

    keys: tuple[str, ...]
    """key of each class"""
    epic_ids: tuple[int, ...]
    """EPIC-KITCHENS id of each class, -1 for a new one"""

    def labels(self) -> dict[str, int]:
        """Map each key to its label."""
        return {key: label for label, key in enumerate(self.keys)}


def collect_classes(seen: Iterable[tuple[str, int]]) -> Classes:
    """Collect classes from (key, EPIC id or -1) pairs, in any order and with repetitions."""
    epic_id: dict[str, int] = {}
    for key, number in seen:
        epic_id[key] = max(number, epic_id.get(key, -1))
    keys = sorted(epic_id, key=lambda key: (epic_id[key] < 0, epic_id[key], key))
    return Classes(tuple(keys), tuple(epic_id[key] for key in keys))


TAXONOMY3 = ("one_hand", "both_same", "both_different")
MASKS = ("mask_left", "mask_right", "object_left_mask", "object_right_mask")
PATHS = ("left_hand", "right_hand", "left_object", "right_object")

Feature = Mapping[str, Any]
IMAGE: Feature = {"_type": "Image"}


def value_feature(dtype: str) -> Feature:
    """Return the feature of a plain column of this dtype."""
    return {"dtype": dtype, "_type": "Value"}


def list_feature(feature: Feature, length: int = -1) -> Feature:
    """Return the feature of a list, as `Sequence`, which every version of `datasets` supports."""
    return {"feature": feature, "length": length, "_type": "Sequence"}


POINTS = list_feature(list_feature(value_feature("float32")))


@dataclass(frozen=True)
class Column:
    """Column with its Hugging Face feature and its meaning."""

    name: str
    feature: Feature
    doc: str


def _mask_column_set(name: str, doc: str) -> tuple[Column, ...]:
    return (
        Column(name, IMAGE, f"{doc}; 1-bit PNG of the image's size, all 0 when there is none"),
        Column(f"{name}_rle", value_feature("string"), "the same mask as compressed COCO run lengths"),
        Column(f"{name}_area", value_feature("int32"), "its area in px"),
        Column(f"{name}_bbox", list_feature(value_feature("int32"), 4), "its box [x, y, width, height] in px, zeros when empty"),
    )


FIXED = (
    Column("sample_id", value_feature("string"), "unique in the data set: `<video>_<frame>[_<narration id>]`"),
    Column("image", IMAGE, "JPEG of the frame with the hands removed"),
    *_mask_column_set("mask_left", "where the left hand acts on its object"),
    *_mask_column_set("mask_right", "where the right hand acts on its object"),
    *_mask_column_set("object_left_mask", "complete (amodal) object of the left hand"),
    *_mask_column_set("object_right_mask", "complete (amodal) object of the right hand"),
    Column("object_left", value_feature("string"), "name of the left hand's object, empty for none"),
    Column("object_right", value_feature("string"), "name of the right hand's object, empty for none"),
    Column("narration", value_feature("string"), "the task, as narrated"),
    Column("narration_id", value_feature("string"), "id of the narration in the source"),
    Column("verb", value_feature("string"), "verb as narrated"),
    Column("noun", value_feature("string"), "noun as narrated"),
    Column("verb_epic_id", value_feature("int32"), "EPIC-KITCHENS id of the verb class, -1 for a class that is not EPIC's"),
    Column("noun_epic_id", value_feature("int32"), "EPIC-KITCHENS id of the noun class, -1 for a class that is not EPIC's"),
    Column("all_nouns", list_feature(value_feature("string")), "every noun of the narration"),
    Column("taxonomy", {"names": list(TAXONOMY), "_type": "ClassLabel"}, "which hands the task takes, 4-way"),
    Column("taxonomy3", {"names": list(TAXONOMY3), "_type": "ClassLabel"}, "the same, 3-way"),
    Column("video", value_feature("string"), "video id; a video is in one split only"),
    Column("clip", value_feature("string"), "clip id, which also names its recording"),
    Column("participant", value_feature("string"), "who wore the camera"),
    Column("frame", value_feature("int64"), "frame number of the source, 1-based"),
    Column("time_ns", value_feature("int64"), "media time in ns, exact; log time of the recording counts from it"),
    Column("timestamp", value_feature("float64"), "media time in s"),
    Column("width", value_feature("int32"), "image width in px"),
    Column("height", value_feature("int32"), "image height in px"),
    Column("quality", value_feature("float32"), "quality of the extraction, 0..1"),
    Column("inpaint_confidence", value_feature("float32"), "mean confidence of the pixels that replace the hands, 0..1"),
    Column("key_frame", value_feature("int64"), "annotated frame that the masks lean on"),
    Column("key_distance", value_feature("int32"), "distance to it in frames"),
    Column("motion", dict.fromkeys(PATHS, POINTS),
           "path of each hand and object after the sample: lists of [x, y] in px, NaN when out of sight"),
    Column("motion_time_ns", list_feature(value_feature("int64")), "time of each point of `motion` after the sample, in ns"),
    Column("provenance", value_feature("string"), "digest of the clip's samples: `pipeline.py lineage DIGEST` walks back from it"),
)


def columns(verbs: Classes, nouns: Classes) -> tuple[Column, ...]:
    """Return all columns of a data set with these classes."""
    return (
        *FIXED,
        Column("verb_class", {"names": list(verbs.keys), "_type": "ClassLabel"}, "class of the verb"),
        Column("noun_class", {"names": list(nouns.keys), "_type": "ClassLabel"}, "class of the noun"),
    )


def arrow_schema(table: tuple[Column, ...]) -> pa.Schema:
    """Return Arrow fields and the `huggingface` metadata of these columns."""
    features = {column.name: column.feature for column in table}
    metadata = json.dumps({"info": {"features": features}}, sort_keys=True, ensure_ascii=False)
    return pa.schema([(column.name, arrow_type(column.feature)) for column in table], {"huggingface": metadata})


def arrow_type(feature: Feature) -> pa.DataType:
    """Return the Arrow type in which `datasets` stores a feature."""
    match feature.get("_type"):
        case "Image":
            return pa.struct([("bytes", pa.binary()), ("path", pa.string())])
        case "ClassLabel":
            return pa.int64()
        case "Sequence":
            return pa.list_(arrow_type(feature["feature"]), feature["length"])
        case "Value":
            return pa.from_numpy_dtype(feature["dtype"]) if feature["dtype"] != "string" else pa.string()
    return pa.struct([(name, arrow_type(inner)) for name, inner in feature.items()])


COARSE_TAXONOMY = {Taxonomy.LEFT: 0, Taxonomy.RIGHT: 0, Taxonomy.BOTH_SAME: 1, Taxonomy.BOTH_DIFFERENT: 2}


def table_row(clip: Samples, sample: Sample, verbs: dict[str, int], nouns: dict[str, int], provenance: str) -> dict[str, Any]:
    """Convert a sample to a table row; `verbs` and `nouns` map class keys to labels."""
    return {
        "sample_id": sample.sample_id,
        "image": {"bytes": sample.image_jpeg.tobytes(), "path": f"{sample.sample_id}.jpg"},
        "object_left": sample.object_left,
        "object_right": sample.object_right,
        "taxonomy": sample.taxonomy,
        "taxonomy3": COARSE_TAXONOMY[Taxonomy(sample.taxonomy)],
        "quality": sample.quality,
        "inpaint_confidence": sample.inpaint_confidence,
        "key_frame": sample.key_frame,
        "key_distance": sample.key_distance,
        "provenance": provenance,
        **source_columns(clip, sample),
        **task_columns(sample, verbs, nouns),
        **dict(_mask_columns(sample)),
        "motion": dict(zip(PATHS, sample.motion.tolist(), strict=True)),
        "motion_time_ns": sample.motion_time_ns.tolist(),
    }


def source_columns(clip: Samples, sample: Sample) -> dict[str, Any]:
    """Return the columns of a sample's source."""
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


def task_columns(sample: Sample, verbs: dict[str, int], nouns: dict[str, int]) -> dict[str, Any]:
    """Return the columns of the narration."""
    narration = sample.narration
    return {
        "narration": narration.text,
        "narration_id": narration.narration_id,
        "verb": narration.verb,
        "noun": narration.noun,
        "verb_class": verbs[narration.verb_key],
        "noun_class": nouns[narration.noun_key],
        "verb_epic_id": narration.verb_class,
        "noun_epic_id": narration.noun_class,
        "all_nouns": list(narration.all_nouns),
    }


def _mask_columns(sample: Sample) -> Iterator[tuple[str, Any]]:
    height, width = sample.masks.shape[1:]
    counts = masks.encode_rle(sample.masks)
    boxes, areas = masks.boxes(counts, height, width), masks.areas(counts, height, width)
    for name, mask, count, box, area in zip(MASKS, sample.masks, counts, boxes, areas, strict=True):
        png = masks.encode_png(mask) if area else masks.empty_png(height, width)
        yield name, {"bytes": png, "path": f"{sample.sample_id}.{name}.png"}
        yield f"{name}_rle", count.decode("ascii")
        yield f"{name}_area", area
        yield f"{name}_bbox", box
