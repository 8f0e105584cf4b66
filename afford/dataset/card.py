"""README.md of a data set: the Hugging Face dataset card, with the YAML header that makes `load_dataset(folder)` work."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any

from afford.dataset.columns import Column
from afford.dataset.licence import NOTES

MADE = {
    "extracted": """\
Extracted by afford after the method of 2HandedAfforder (affordance = complete object AND same-side hand, on frames whose hands
were removed). `quality`, `key_distance` and `inpaint_confidence` say how far a sample can be trusted; `provenance` leads back
to everything it came from. Masks come from an automatic extraction, not from annotators: look before you rely on them.""",
    "rendered": """\
Rendered by afford: things on a table, seen without hands, with exact labels (affordance = complete object AND visible hand of the
same side). Hands are posed by geometry and by how comfortably an arm reaches; of several valid ways each sample shows one, so
the same picture and text may come with different masks. There is one point of motion, the sample's own.""",
}
"""How the samples came to be, as the card says it."""
SIZES = ((1_000, "n<1K"), (10_000, "1K<n<10K"), (100_000, "10K<n<100K"), (1_000_000, "100K<n<1M"))


def text(name: str, licence: str, statistics: dict[str, Any], columns: Iterable[Column], made: str) -> str:
    """The whole card. ValueError when `made` is none of `MADE`."""
    if made not in MADE:
        raise ValueError(f"dataset_pack.made: expected one of {', '.join(MADE)}, got {made!r}")
    return "\n".join([_header(name, licence, statistics), _body(name, licence, statistics, MADE[made]), table(columns), ""])


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
    note = NOTES.get(licence, "")
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


def table(columns: Iterable[Column]) -> str:
    """A Markdown table of the columns."""
    lines = [f"| `{column.name}` | {kind(column)} | {column.doc} |" for column in columns]
    return "\n".join(["| column | feature | meaning |", "|---|---|---|", *lines])


def kind(column: Column) -> str:
    """Short name of a column's feature."""
    return _kind(column.feature)


def _kind(feature: Any) -> str:
    match feature.get("_type"):
        case "Value":
            return feature["dtype"]
        case "Sequence":
            return f"list of {_kind(feature['feature'])}"
        case "ClassLabel":
            names = feature["names"]
            return f"ClassLabel ({', '.join(names)})" if len(names) <= 4 else f"ClassLabel ({len(names)})"
        case None:
            return "struct of " + _kind(next(iter(feature.values())))
    return feature["_type"]
