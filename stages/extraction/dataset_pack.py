"""Pack the samples of all clips into a data set: Parquet shards for `datasets`, with card, statistics and pictures.

Reads   Samples of every clip
Writes  data/<split>-NNNNN-of-NNNNN.parquet, README.md, croissant.json, manifest.json,
        statistics.json, plots/, contact_sheet.png
Method  rows are streamed (one row group in memory); classes are those of the narrations; splits by video: the split of the
        source if every video has one, else by a seeded hash of the video (or participant)
Fails   without samples, when two samples share an id, when a video is in two splits
Paper   2HandedAfforder, 2HANDS: the same content; flips, crops and colours are left to load time (afford/dataset/augment.py)
"""

from __future__ import annotations

from dataclasses import dataclass

from schemas.affordance import Samples
from schemas.files import FileTree
from schemas.spec import Context

LIBRARIES = ("numpy", "pyarrow", "pycocotools", "blake3", "matplotlib", "pillow", "opencv-python-headless")
THREADS = 1
MEMORY_GIB = 2.0
SCRATCH_GIB = 2.0


@dataclass(frozen=True)
class Params:
    """Parameters of `dataset_pack`."""

    name: str = "afford-2hands"
    """name of the data set, on its card"""
    version: str = "1.0.0"
    """version of the data set, in croissant.json"""
    license: str = ""
    """licence id on the card; '' = that of the source: cc-by-nc-4.0 for EPIC-KITCHENS and VISOR (which refuse any other),
    apache-2.0 for rendered clips, other for videos without a stated licence"""
    made: str = "extracted"
    """origin of the samples, for the card: extracted from video, or rendered"""
    split_by: str = "video"
    """unit of the split where the source has no split: video or participant"""
    val_fraction: float = 0.1
    """share of videos (participants) for validation where the source has no split"""
    test_fraction: float = 0.1
    """share of videos (participants) for testing where the source has no split"""
    seed: int = 0
    """seed of the split by hash"""
    samples_per_shard: int = 10_000
    """rows per Parquet file"""
    sheet_samples: int = 18
    """samples on the contact sheet"""


def run(samples: tuple[Samples, ...], params: Params, ctx: Context, more: tuple[Samples, ...] = ()) -> FileTree:
    """Write the data set of samples, and of `more` of them from elsewhere, to the scratch folder and return its files."""
    from afford.common import files
    from afford.dataset import packing
    from afford.dataset.packing import SplitRule

    root = files.empty_folder(ctx.scratch / "dataset")
    rule = SplitRule(params.split_by, params.val_fraction, params.test_fraction, params.seed)
    everything = (*samples, *more)
    plan = packing.plan_pack(everything, rule)
    writing = packing.write_samples(root, everything, plan, params.samples_per_shard, params.sheet_samples, ctx.progress)
    packing.write_metadata(root, writing, params.name, params.license, params.version, params.made)
    return files.tree(params.name, root)
