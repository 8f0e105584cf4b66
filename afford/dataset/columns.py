"""The columns of the data set, one line each, and the Arrow schema that lets `datasets` decode them without our code."""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import pyarrow as pa

from afford.dataset.classes import Classes
from schemas.affordance import TAXONOMY

TAXONOMY3 = ("one_hand", "both_same", "both_different")
MASKS = ("mask_left", "mask_right", "object_left_mask", "object_right_mask")
PATHS = ("left_hand", "right_hand", "left_object", "right_object")

Feature = Mapping[str, Any]
IMAGE: Feature = {"_type": "Image"}


def value(dtype: str) -> Feature:
    """A plain column of this dtype."""
    return {"dtype": dtype, "_type": "Value"}


def several(feature: Feature, length: int = -1) -> Feature:
    """A list; `Sequence` is understood by every version of `datasets`."""
    return {"feature": feature, "length": length, "_type": "Sequence"}


POINTS = several(several(value("float32")))


@dataclass(frozen=True)
class Column:
    """One column: its Hugging Face feature and what it means."""

    name: str
    feature: Feature
    doc: str


def _of_mask(name: str, doc: str) -> tuple[Column, ...]:
    return (
        Column(name, IMAGE, f"{doc}; 1-bit PNG of the image's size, all 0 when there is none"),
        Column(f"{name}_rle", value("string"), "the same mask as compressed COCO run lengths"),
        Column(f"{name}_area", value("int32"), "its area in px"),
        Column(f"{name}_bbox", several(value("int32"), 4), "its box [x, y, width, height] in px, zeros when empty"),
    )


FIXED = (
    Column("sample_id", value("string"), "unique in the data set: `<video>_<frame>[_<narration id>]`"),
    Column("image", IMAGE, "JPEG of the frame with the hands removed"),
    *_of_mask("mask_left", "where the left hand acts on its object"),
    *_of_mask("mask_right", "where the right hand acts on its object"),
    *_of_mask("object_left_mask", "complete (amodal) object of the left hand"),
    *_of_mask("object_right_mask", "complete (amodal) object of the right hand"),
    Column("object_left", value("string"), "name of the left hand's object, empty for none"),
    Column("object_right", value("string"), "name of the right hand's object, empty for none"),
    Column("narration", value("string"), "the task, as narrated"),
    Column("narration_id", value("string"), "id of the narration in the source"),
    Column("verb", value("string"), "verb as narrated"),
    Column("noun", value("string"), "noun as narrated"),
    Column("verb_epic_id", value("int32"), "EPIC-KITCHENS id of the verb class, -1 for a class that is not EPIC's"),
    Column("noun_epic_id", value("int32"), "EPIC-KITCHENS id of the noun class, -1 for a class that is not EPIC's"),
    Column("all_nouns", several(value("string")), "every noun of the narration"),
    Column("taxonomy", {"names": list(TAXONOMY), "_type": "ClassLabel"}, "which hands the task takes, 4-way"),
    Column("taxonomy3", {"names": list(TAXONOMY3), "_type": "ClassLabel"}, "the same, 3-way"),
    Column("video", value("string"), "video id; a video is in one split only"),
    Column("clip", value("string"), "clip id, which also names its recording"),
    Column("participant", value("string"), "who wore the camera"),
    Column("frame", value("int64"), "frame number of the source, 1-based"),
    Column("time_ns", value("int64"), "media time in ns, exact; log time of the recording counts from it"),
    Column("timestamp", value("float64"), "media time in s"),
    Column("width", value("int32"), "image width in px"),
    Column("height", value("int32"), "image height in px"),
    Column("quality", value("float32"), "quality of the extraction, 0..1"),
    Column("inpaint_confidence", value("float32"), "mean confidence of the pixels that replace the hands, 0..1"),
    Column("key_frame", value("int64"), "annotated frame that the masks lean on"),
    Column("key_distance", value("int32"), "distance to it in frames"),
    Column("motion", dict.fromkeys(PATHS, POINTS),
           "path of each hand and object after the sample: lists of [x, y] in px, NaN when out of sight"),
    Column("motion_time_ns", several(value("int64")), "time of each point of `motion` after the sample, in ns"),
    Column("provenance", value("string"), "digest of the clip's samples: `pipeline.py lineage DIGEST` walks back from it"),
)


def columns(verbs: Classes, nouns: Classes) -> tuple[Column, ...]:
    """All columns of a data set with these classes."""
    return (
        *FIXED,
        Column("verb_class", {"names": list(verbs.keys), "_type": "ClassLabel"}, "class of the verb"),
        Column("noun_class", {"names": list(nouns.keys), "_type": "ClassLabel"}, "class of the noun"),
    )


def arrow_schema(table: tuple[Column, ...]) -> pa.Schema:
    """Arrow fields and the `huggingface` metadata of these columns."""
    features = {column.name: column.feature for column in table}
    metadata = json.dumps({"info": {"features": features}}, sort_keys=True, ensure_ascii=False)
    return pa.schema([(column.name, arrow_type(column.feature)) for column in table], {"huggingface": metadata})


def arrow_type(feature: Feature) -> pa.DataType:
    """How `datasets` stores a feature."""
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
