"""croissant.json: the data set described in MLCommons' Croissant 1.0 (JSON-LD), for search engines and loaders."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import Any

from afford.common.files import sha256
from afford.dataset.columns import Column, Feature

PREFIXES = {
    "@language": "en", "@vocab": "https://schema.org/", "sc": "https://schema.org/",
    "cr": "http://mlcommons.org/croissant/", "rai": "http://mlcommons.org/croissant/RAI/", "dct": "http://purl.org/dc/terms/",
    "conformsTo": "dct:conformsTo",
    "data": {"@id": "cr:data", "@type": "@json"}, "examples": {"@id": "cr:examples", "@type": "@json"},
    "dataType": {"@id": "cr:dataType", "@type": "@vocab"},
}
TERMS = ("citeAs", "column", "extract", "field", "fileProperty", "fileObject", "fileSet", "format", "includes",
         "isLiveDataset", "jsonPath", "key", "md5", "parentField", "path", "recordSet", "references", "regex", "repeated",
         "replace", "separator", "source", "subField", "transform")
TYPES = {"string": "sc:Text", "int32": "sc:Integer", "int64": "sc:Integer", "float32": "sc:Float", "float64": "sc:Float"}
LICENCES = "https://spdx.org/licenses/"
SPDX = {"apache-2.0": "Apache-2.0", "cc-by-4.0": "CC-BY-4.0", "cc-by-nc-4.0": "CC-BY-NC-4.0", "cc0-1.0": "CC0-1.0",
        "mit": "MIT"}
SHARDS = {"@type": "cr:FileSet", "@id": "shards", "name": "shards", "encodingFormat": "application/x-parquet",
          "includes": "data/*.parquet"}


def describe(
    name: str, licence: str, version: str, columns: Iterable[Column], root: Path, shards: Sequence[str]
) -> dict[str, Any]:
    """The whole description; `shards` are the Parquet files, relative to `root`."""
    return {
        "@context": PREFIXES | {term: f"cr:{term}" for term in TERMS},
        "@type": "sc:Dataset",
        "conformsTo": "http://mlcommons.org/croissant/1.0",
        "name": name,
        "description": "Where to put each hand on an object for a narrated task, extracted from first-person video.",
        "license": LICENCES + SPDX[licence] if licence in SPDX else licence,
        "version": version,
        "citeAs": "2HandedAfforder (2025); VISOR (2022); EPIC-KITCHENS-100 (2022)",
        "distribution": [*(_file(root, shard) for shard in shards), SHARDS],
        "recordSet": [{"@type": "cr:RecordSet", "@id": "samples", "name": "samples", "description": "one frame with its task",
                       "field": [field for column in columns for field in _fields(column)]}],
    }


def _file(root: Path, shard: str) -> dict[str, Any]:
    return {"@type": "cr:FileObject", "@id": shard, "name": shard, "contentUrl": shard,
            "encodingFormat": "application/x-parquet", "sha256": sha256(root / shard)}


def _fields(column: Column) -> list[dict[str, Any]]:
    """One field for a column, one per member for a struct."""
    if column.feature.get("_type") == "Image":
        return [_field(column.name, column, column.feature, "bytes")]
    if "_type" in column.feature:
        return [_field(column.name, column, column.feature, "")]
    return [_field(f"{column.name}/{member}", column, inner, member) for member, inner in column.feature.items()]


def _field(name: str, column: Column, feature: Feature, member: str) -> dict[str, Any]:
    kind, repeated = _data_type(feature)
    source: dict[str, Any] = {"fileSet": {"@id": "shards"}, "extract": {"column": column.name}}
    if member:
        source["transform"] = {"jsonPath": member}
    field = {"@type": "cr:Field", "@id": f"samples/{name}", "name": f"samples/{name}", "description": column.doc,
             "dataType": kind, "source": source}
    return field | {"repeated": True} if repeated else field


def _data_type(feature: Feature) -> tuple[str, bool]:
    match feature.get("_type"):
        case "Image":
            return "sc:ImageObject", False
        case "ClassLabel":
            return "sc:Integer", False
        case "Value":
            return TYPES[feature["dtype"]], False
        case "Sequence":
            return _data_type(feature["feature"])[0], True
    raise ValueError(f"croissant: expected an Image, ClassLabel, Value or Sequence, got {feature}")
