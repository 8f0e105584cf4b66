"""Files of a published checkpoint: its tensors, memory-mapped, its configs, and the licence that it states."""

from __future__ import annotations

import json
import re
import zipfile
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from torch import Tensor

from afford.common.bounded import reason
from afford.models.tensor_files import load_weights_only, named_tensors, read_tensors

WEIGHTS = (".safetensors", ".pt", ".pth", ".ckpt", ".bin")
"""suffixes of files of tensors, in the order of preference: a folder that has both is read from the first"""
INDEX, RECORD = "model.safetensors.index.json", "weights.json"
"""index of the shards of a model, and record of an imported one"""
TOKENIZER, CONFIG = "tokenizer.json", "config.json"
MAX_TEXT_BYTES = 1 << 26
"""limit of a config or tokenizer"""
TRAINING = re.compile(r"^(training_args|optimizer|scheduler|rng_state|zero_pp_rank|mp_rank)")
"""files of tensors beside a model that are not its weights"""
LICENCE = re.compile(r"^license(?:_name)?:\s*['\"]?([\w.+-]+)", re.M)
LICENCE_FILES = ("LICENSE", "LICENSE.txt", "LICENSE.md", "LICENCE")
NOT_STATED = "not stated"


@dataclass(frozen=True)
class Source:
    """Files of a checkpoint."""

    files: tuple[Path, ...]
    """files of tensors"""
    tensors: dict[str, Tensor]
    """all tensors by their published names, memory-mapped"""
    folders: tuple[Path, ...]
    """folders of the files, in which configs and tokenizers are looked for"""

    def config(self, wanted: str = "") -> dict[str, Any]:
        """Read the first config.json beside the tensors whose model_type contains `wanted`; empty without one.

        ValueError for a damaged one.
        """
        for path in self._beside(CONFIG):
            found = json_object(path)
            if wanted in str(found.get("model_type", "")):
                return found
        return {}

    def tokenizer(self) -> str:
        """Text of tokenizer.json beside the tensors; '' without one."""
        return next((bounded_text(path) for path in self._beside(TOKENIZER)), "")

    def licence(self) -> str:
        """Licence as the files state it: the field of a model card, else the first line of a licence file, else 'not stated'."""
        for path in self._beside("README.md"):
            found = LICENCE.search(bounded_text(path))
            if found:
                return found[1]
        for name in LICENCE_FILES:
            for path in self._beside(name):
                return next((line.strip() for line in bounded_text(path).splitlines() if line.strip()), NOT_STATED)[:80]
        return NOT_STATED

    def _beside(self, name: str) -> Iterator[Path]:
        return (folder / name for folder in self.folders if (folder / name).is_file())


def open_source(given: Sequence[Path]) -> Source:
    """Open the files and folders of a checkpoint. ValueError, one sentence: nothing there, damaged, or a name twice."""
    tensors: dict[str, Tensor] = {}
    files = [file for path in given for file in tensor_paths(path)]
    if not files:
        raise ValueError(f"{', '.join(map(str, given))}: expected files of tensors ({', '.join(WEIGHTS)}), found none")
    for file in files:
        found = read_any(file)
        twice = sorted(found.keys() & tensors.keys())
        if twice:
            raise ValueError(f"{file}: {len(twice)} tensors are also in another file, such as {twice[0]}; give each file once")
        tensors |= found
    folders = dict.fromkeys(path if path.is_dir() else path.parent for path in given)
    return Source(tuple(files), tensors, tuple(folders))


def read_any(file: Path) -> dict[str, Tensor]:
    """Tensors of a file, memory-mapped; those of a file from before torch 1.6 are in memory. ValueError, one sentence."""
    if file.suffix == ".safetensors" or zipfile.is_zipfile(file):
        return read_tensors(file)
    found = dict(named_tensors(load_weights_only(file, "a file of tensors")))
    if not found:
        raise ValueError(f"{file}: expected a file of tensors by name, got none")
    return found


def tensor_paths(path: Path) -> list[Path]:
    """Files of tensors in a folder, by its index where it has one, or the file itself; none for a file of another kind."""
    if not path.exists():
        raise ValueError(f"{path}: expected a file or folder of a checkpoint, got nothing there; check the path")
    if path.is_file():
        return [path] if path.suffix in WEIGHTS else []
    for suffix in WEIGHTS:
        indexed = [one for index in sorted(path.glob(f"*{suffix}.index.json")) for one in shards(index)]
        found = indexed or sorted(one for one in path.glob(f"*{suffix}") if not TRAINING.match(one.name))
        if found:
            return found
    return []


def shards(index: Path) -> list[Path]:
    """Files that an index names. ValueError for another file, or for names outside its folder."""
    try:
        names = {str(name) for name in json_object(index)["weight_map"].values()}
    except (KeyError, AttributeError) as error:
        raise ValueError(f"{index}: expected {{\"weight_map\": {{tensor: file}}}}; {reason(error)}") from error
    outside = sorted(name for name in names if Path(name).name != name)
    if outside:
        raise ValueError(f"{index}: expected names of files beside it, got {', '.join(outside)}")
    missing = sorted(name for name in names if not (index.parent / name).is_file())
    if missing:
        raise ValueError(f"{index.parent}: {len(missing)} of {len(names)} files are missing: {', '.join(missing)}; fetch them")
    return [index.parent / name for name in sorted(names)]


def json_object(path: Path) -> dict[str, Any]:
    """Read a JSON object. ValueError for another file."""
    try:
        found = json.loads(bounded_text(path))
    except (ValueError, RecursionError) as error:
        raise ValueError(f"{path}: expected a JSON object; {reason(error)}") from error
    if not isinstance(found, dict):
        raise ValueError(f"{path}: expected a JSON object, got {type(found).__name__}")
    return found


def bounded_text(path: Path) -> str:
    """Read a text of at most MAX_TEXT_BYTES. ValueError for a longer one, or other bytes."""
    if path.stat().st_size > MAX_TEXT_BYTES:
        raise ValueError(f"{path}: expected a text of at most {MAX_TEXT_BYTES >> 20} MiB, got {path.stat().st_size >> 20} MiB")
    try:
        return path.read_text(encoding="utf-8")
    except UnicodeDecodeError as error:
        raise ValueError(f"{path}: expected a text in UTF-8; {error.reason}") from error
