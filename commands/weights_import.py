"""The verbs of `weights`: import a published checkpoint, list the kinds, verify and show what was imported."""

from __future__ import annotations

import json
import sys
import time
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from rich.console import Console
from rich.table import Table

from commands.errors import UsageError, unknown
from commands.progress import observer
from runner import Reason

if TYPE_CHECKING:
    from afford.models.importing import Imported

STAGE = "weights"
KINDS = {
    "2haff": "afford.twohands.model.published:import_2haff",
    "lisa": "afford.twohands.model.published:import_lisa",
    "llava": "afford.models.importing.llava:import_llava",
    "sam": "afford.models.importing.sam:import_sam",
    "sam2": "afford.models.importing.sam2:import_sam2",
    "sam3": "afford.models.importing.sam3:import_sam3",
    "xmem": "afford.models.importing.xmem:import_xmem",
    "clip": "afford.models.importing.clip:import_clip",
    "vidm": "afford.extraction.inpaint.vidm_model:import_vidm",
    "lama": "afford.extraction.inpaint.lama:import_lama",
    "vgg16": "afford.rgbd.model.checkpoint:import_vgg16",
}
"""name -> reader of a kind"""
NEEDS = {
    "2haff": "the released 2HandedAfforder: pytorch_model*.bin or safetensors, tokenizer.json with [SEG], CLIP ViT-L/14",
    "lisa": "LISA 7B or 13B: the same files",
    "llava": "LLaVA-1.5 7B or 13B: the authors' files with CLIP ViT-L/14 at 336 px, or a folder of transformers",
    "sam": "sam_vit_b, _l or _h *.pth, or a folder of transformers",
    "sam2": "sam2_hiera_*.pt, sam2.1_hiera_*.pt, or a folder of transformers",
    "sam3": "sam3.pt with a tokenizer.json, or a folder of transformers (facebook/sam3) with its config.json and tokenizer.json",
    "xmem": "XMem.pth",
    "clip": "ViT-L-14.pt and the like with a tokenizer.json, or a folder of transformers",
    "vidm": "nohands_weights.ckpt",
    "lama": "best.ckpt or big-lama.pt",
    "vgg16": "vgg16-397923af.pth",
}
"""kind -> files"""


def bring(kind: str, files: Sequence[Path], out: Path, dtype: str, as_json: bool) -> int:
    """Import a checkpoint into the new folder `out`; 0, or 1 for one that does not fit. UsageError for a wrong call."""
    if kind not in NEEDS:
        raise unknown("KIND", kind, NEEDS)
    if out.exists():
        raise UsageError(f"--out {out}: it exists; name a new folder")
    from afford.common.registry import load
    from afford.models.importing.source import open_source
    from afford.models.importing.write import write_model
    from afford.models.loading import DTYPES

    if dtype not in DTYPES:
        raise unknown("--dtype", dtype, DTYPES)
    began = time.perf_counter()
    try:
        source = open_source(files)
        made: Imported = load(KINDS, kind)(source)
        with observer(quiet=as_json) as shown:
            shown.planned(STAGE, kind)
            shown.started(STAGE, kind, Reason("forced", out.name))
            record = write_model(made, source, kind, out, DTYPES[dtype],
                                 lambda done, total: shown.progress(STAGE, kind, done, total))  # fmt: skip
            shown.finished(STAGE, kind, "ran", time.perf_counter() - began, 0.0, "")
    except (ValueError, OSError, RuntimeError) as error:
        return _failed(f"{kind}: {error}")
    _tell(record, out, as_json)
    return 0


def kinds(as_json: bool) -> int:
    """List the kinds that can be imported."""
    if as_json:
        sys.stdout.write(json.dumps({"kinds": NEEDS}) + "\n")
        return 0
    table = Table("kind", "files", box=None)
    for name, needs in NEEDS.items():
        table.add_row(name, needs)
    Console().print(table)
    return 0


def verify(folder: Path, as_json: bool) -> int:
    """Compare the files of an imported model with their digests; 0, or 1 where one is missing or differs."""
    from afford.models.importing.write import damaged, read_record

    try:
        record, wrong = read_record(folder), damaged(folder)
    except (ValueError, OSError) as error:
        return _failed(str(error))
    if as_json:
        sys.stdout.write(json.dumps({"folder": str(folder), "kind": record["kind"], "damaged": wrong}) + "\n")
    elif not wrong:
        sys.stdout.write(f"{folder}: {record['title']}, all {len(record['files'])} files as they were imported" + "\n")
    return _failed(f"{folder}: {len(wrong)} of {len(record['files'])} files are missing or differ: {', '.join(wrong)}; import it "
                   "again") if wrong else 0


def show(folder: Path, as_json: bool) -> int:
    """Show kind, parameters, type, digest, licence as stated and use of an imported model; 0, or 1 for another folder."""
    from afford.models.importing.write import read_record

    try:
        _tell(read_record(folder), folder, as_json)
    except (ValueError, OSError) as error:
        return _failed(str(error))
    return 0


def _tell(record: dict[str, Any], folder: Path, as_json: bool) -> None:
    facts = facts_of(record, folder)
    if as_json:
        sys.stdout.write(json.dumps(facts) + "\n")
        return
    for name, value in facts.items():
        text = f"{value:,}" if isinstance(value, int) else "; ".join(value) if isinstance(value, list) else str(value)
        sys.stdout.write(f"{name + ':':<12} {text}" + "\n")


def facts_of(record: dict[str, Any], folder: Path) -> dict[str, Any]:
    """Facts of a record that are shown; the digest is that of its files' digests."""
    from blake3 import blake3

    digest = blake3(json.dumps(record["files"], sort_keys=True).encode()).hexdigest()
    fresh = {"not in the checkpoint": f"{len(record['fresh'])} tensors, such as {record['fresh'][0]}"} if record["fresh"] else {}
    return {"folder": str(folder), "kind": record["kind"], "model": record["title"], "parameters": record["parameters"],
            "dtype": record["dtype"], "digest": digest, "licence": record["licence"],
            "use": record["use"].replace("DIR", str(folder)), **fresh,
            **({"notes": record["notes"]} if record["notes"] else {})}  # fmt: skip


def _failed(message: str) -> int:
    sys.stderr.write(f"error: {message}\n")
    return 1
