"""Metadata of a data set: licence, citation, README.md (Hugging Face dataset card) and croissant.json (MLCommons Croissant 1.0).

The YAML header of the card makes `load_dataset(folder)` work. Croissant describes the files and columns for search engines and
loaders.
"""

from __future__ import annotations

import json
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from afford.common.errors import SourceError
from afford.common.files import sha256
from afford.common.video.probe import EPIC_ID
from afford.dataset.table_schema import Column, Feature

EPIC_LICENCE = "cc-by-nc-4.0"
UNKNOWN_LICENCE = "other"
"""the Hub's identifier of a custom licence"""
LICENCE_NOTES = {
    EPIC_LICENCE: "Whatever is derived from EPIC-KITCHENS or VISOR is under CC BY-NC 4.0, as they are: "
          "name the authors, no commercial use.",
    UNKNOWN_LICENCE: "The videos say what may be done with it: whatever holds for them and for their annotations holds for this "
                     "data set. Ask who made them before you pass it on.",
    "apache-2.0": "Every picture was rendered by afford, from shapes and textures of its own; "
                  "nothing was taken from another data set.",
}  # fmt: skip


def licence_of(videos: Iterable[str], stated: str) -> str:
    """Return the licence id of a data set made of these videos; `stated` is '' when no licence was given.

    Raises ValueError when a video of EPIC-KITCHENS (P01 to P37) is among them and `stated` is another licence than EPIC's.
    """
    epic = next((video for video in sorted(videos) if EPIC_ID.fullmatch(video)), "")
    if epic and stated not in ("", EPIC_LICENCE):
        raise ValueError(f"license: expected {EPIC_LICENCE}, because {epic} is of EPIC-KITCHENS, got {stated!r}; "
                         "leave it out, or rename the video if it is your own")
    return EPIC_LICENCE if epic else stated or UNKNOWN_LICENCE


METHOD_PAPER = "2HandedAfforder (2025)"
EPIC_PAPERS = ("VISOR (2022)", "EPIC-KITCHENS-100 (2022)")


def citation(licence: str) -> str:
    """Return the works to cite: the method, and the sources of the videos for data under EPIC's licence."""
    return "; ".join((METHOD_PAPER, *(EPIC_PAPERS if licence == EPIC_LICENCE else ())))


METHODS = {
    "extracted": """\
Extracted by afford after the method of 2HandedAfforder (affordance = complete object AND same-side hand, on frames whose hands
were removed). `quality`, `key_distance` and `inpaint_confidence` say how far a sample can be trusted; `provenance` leads back
to everything it came from. Masks come from an automatic extraction, not from annotators: look before you rely on them.""",
    "rendered": """\
Rendered by afford: things on a table, seen without hands, with exact labels (affordance = complete object AND visible hand of the
same side). Hands are posed by geometry and by how comfortably an arm reaches; of several valid ways each sample shows one, so
the same picture and text may come with different masks. There is one point of motion, the sample's own.""",
}
"""Origin of the samples, as the card describes it."""
SIZES = ((1_000, "n<1K"), (10_000, "1K<n<10K"), (100_000, "10K<n<100K"), (1_000_000, "100K<n<1M"))


def dataset_card(name: str, licence: str, statistics: dict[str, Any], columns: Iterable[Column], made: str) -> str:
    """Return the dataset card. Raises ValueError when `made` is not a key of `METHODS`."""
    if made not in METHODS:
        raise ValueError(f"dataset_pack.made: expected one of {', '.join(METHODS)}, got {made!r}")
    parts = (_header(name, licence, statistics), _body(name, licence, statistics, METHODS[made]), column_table(columns), "")
    return "\n".join(parts)


def _header(name: str, licence: str, statistics: dict[str, Any]) -> str:
    total = statistics["totals"]["samples"]["here"]
    size = next((label for limit, label in SIZES if total < limit), "n>1M")
    data_files = "\n".join(f"  - split: {split}\n    path: data/{split}-*.parquet" for split in statistics["splits"])
    return (f"---\npretty_name: {name}\nlicense: {licence}\nlanguage:\n- en\nsize_categories:\n- {size}\n"
            "task_categories:\n- image-segmentation\n- robotics\ntags:\n- affordance\n- bimanual\n- egocentric\n"
            f"configs:\n- config_name: default\n  data_files:\n{data_files}\n---\n")


def _body(name: str, licence: str, statistics: dict[str, Any], made: str) -> str:
    totals = statistics["totals"]
    splits = ", ".join(f"{split} {count:,}" for split, count in statistics["splits"].items())
    hands = ", ".join(f"{kind.replace('_', ' ')} {count:,}" for kind, count in statistics["taxonomy"].items())
    note = LICENCE_NOTES.get(licence, "")
    first = next(iter(statistics["splits"]))
    return f"""# {name}

Where to put each hand on an object for a narrated task. Every sample is a frame of first-person video with the hands removed,
the region where the left and the right hand act, the complete objects they hold, the task in words, and how hands and objects
move on in the image over the next second.

![samples: affordances filled, complete objects outlined, motion as a line; left orange, right blue](contact_sheet.png)

```python
from datasets import load_dataset
samples = load_dataset("parquet", data_files={{"{first}": "data/{first}-*.parquet"}})
```

|  | here | 2HANDS (published) |
|---|--:|--:|
| samples | {totals['samples']['here']:,} | {totals['samples']['published_2hands']:,} |
| verb (affordance) classes | {totals['verb_classes']['here']} | {totals['verb_classes']['published_2hands']} |
| noun (object) classes | {totals['noun_classes']['here']} | {totals['noun_classes']['published_2hands']} |

{statistics['videos']} videos of {statistics['participants']} participants. Splits: {splits}; a video is in one split only.
Hands: {hands}.

Numbers and distributions: `statistics.json`, `plots/`. Digests of all files: `manifest.json`.

## Licence

`{licence}`. {note}

## How it was made

{made}

## Columns
"""


def column_table(columns: Iterable[Column]) -> str:
    """Return a Markdown table of the columns."""
    lines = [f"| `{column.name}` | {feature_name(column)} | {column.doc} |" for column in columns]
    return "\n".join(["| column | feature | meaning |", "|---|---|---|", *lines])


def feature_name(column: Column) -> str:
    """Return the short name of a column's feature."""
    return _feature_name(column.feature)


def _feature_name(feature: Any) -> str:
    match feature.get("_type"):
        case "Value":
            return feature["dtype"]
        case "Sequence":
            return f"list of {_feature_name(feature['feature'])}"
        case "ClassLabel":
            names = feature["names"]
            return f"ClassLabel ({', '.join(names)})" if len(names) <= 4 else f"ClassLabel ({len(names)})"
        case None:
            return "struct of " + _feature_name(next(iter(feature.values())))
    return feature["_type"]


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


def licence_url(licence: str) -> str:
    """Return the SPDX page of a licence, '' for a licence that SPDX lacks."""
    return LICENCES + SPDX[licence] if licence in SPDX else ""


def croissant(
    name: str, licence: str, version: str, columns: Iterable[Column], root: Path, shards: Sequence[str]
) -> dict[str, Any]:
    """Return the Croissant description; `shards` are the Parquet files, relative to `root`."""
    return {
        "@context": PREFIXES | {term: f"cr:{term}" for term in TERMS},
        "@type": "sc:Dataset",
        "conformsTo": "http://mlcommons.org/croissant/1.0",
        "name": name,
        "description": "Where to put each hand on an object for a narrated task, extracted from first-person video.",
        "license": licence_url(licence) or licence,
        "version": version,
        "citeAs": citation(licence),
        "distribution": [*(_file_object(root, shard) for shard in shards), SHARDS],
        "recordSet": [{"@type": "cr:RecordSet", "@id": "samples", "name": "samples", "description": "one frame with its task",
                       "field": [field for column in columns for field in _fields(column)]}],
    }


def _file_object(root: Path, shard: str) -> dict[str, Any]:
    return {"@type": "cr:FileObject", "@id": shard, "name": shard, "contentUrl": shard,
            "encodingFormat": "application/x-parquet", "sha256": sha256(root / shard)}


def _fields(column: Column) -> list[dict[str, Any]]:
    """Return one field per column, and one per member of a struct."""
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


@dataclass(frozen=True)
class PackedInfo:
    """Name, version and licence of a packed data set."""

    name: str
    version: str
    licence: str
    """licence id on the card"""


def read_info(root: Path) -> PackedInfo:
    """Read name and licence from the YAML header of the card, and the version from croissant.json.

    Raises SourceError when a file is missing, or the header has no name or licence.
    """
    try:
        card = (root / "README.md").read_text(encoding="utf-8")
        version = json.loads((root / "croissant.json").read_text(encoding="utf-8"))["version"]
    except (OSError, ValueError, KeyError) as error:
        raise SourceError(str(root), "README.md and croissant.json of a data set", str(error), "pack the data set again") from error
    header = dict(line.split(": ", 1) for line in card.split("\n---\n")[0].splitlines() if ": " in line)
    if not {"pretty_name", "license"} <= header.keys():
        raise SourceError(str(root / "README.md"), "pretty_name and license in the YAML header", "neither or one of them",
                          "pack the data set again")
    return PackedInfo(header["pretty_name"], version, header["license"])


def write_export_readme(info: PackedInfo, out: Path, format: str, layout: str) -> Path:
    """Write the README.md of an export: name, format and layout, licence, citation. Return its path."""
    licence = f"`{info.licence}`. {LICENCE_NOTES.get(info.licence, '')}".rstrip()
    path = out / "README.md"
    out.mkdir(parents=True, exist_ok=True)
    path.write_text(f"# {info.name}\n\nFormat: {format}. {layout}\n\n## Licence\n\n{licence}\n\n"
                    f"## Citation\n\n{citation(info.licence)}\n", encoding="utf-8", newline="\n")
    return path
