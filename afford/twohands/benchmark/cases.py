"""Read a benchmark case: image, task and valid modes.

Masks are anti-aliased grey and read as `> 0` (ActAffordance). A mask of another size than the case is resized to it by nearest
neighbour. Such irregularities of the files are listed in the notes of the case.
"""

from __future__ import annotations

import io
from collections.abc import Callable, Sequence
from typing import Any

import cv2
import numpy as np
from PIL import Image

from afford.common.errors import SourceError
from afford.common.text import json_field, parse_json
from afford.dataset.act_affordance import ANNOTATION, IMAGE, MODES, CaseFiles
from schemas.affordance import TAKES, TAXONOMY, Taxonomy
from schemas.benchmark import Case
from schemas.files import FileRef
from schemas.video import SIDES


def prompts(given: Sequence[str], text: str, seed: int) -> list[str]:
    """Tasks to prompt the model with, one for each case: `given`, `shuffled` or `removed`. ValueError for another `text`."""
    if text == "given":
        return list(given)
    if text == "removed":
        return [""] * len(given)
    if text == "shuffled":
        return shuffled(given, seed)
    raise ValueError(f"text: expected given, shuffled or removed, got {text!r}")


def shuffled(given: Sequence[str], seed: int) -> list[str]:
    """Draw a task of another wording for each case, by seed. ValueError when all tasks are equal."""
    if len(set(given)) < 2:
        raise ValueError("text shuffled: expected cases with at least two different tasks, got one; no task can be exchanged")
    rng = np.random.default_rng(seed)
    words = np.array(given, dtype=object)
    return [str(rng.choice(words[words != own])) for own in given]


KITCHEN, SHIFT = "kitchen", "shift"
Size = tuple[int, int]
Outlines = Callable[[CaseFiles, Any], np.ndarray]
"""source of the two true masks of a case other than its PNGs: (files, annotation) -> (2, h, w) bool"""


def read(files: CaseFiles, outlines: Outlines | None = None) -> Case:
    """Read a case. SourceError names the file and field that cannot be used."""
    annotation = _json(files, ANNOTATION)
    notes: list[str] = []
    regions, taxonomy = _drawn(files, annotation, outlines) if outlines else _modes(files, annotation)
    size = _size(files, regions)
    modes = np.stack([[_fit(mask, size, name, notes) for mask, name in pair] for pair in regions])
    if not all(mode.any() for mode in modes):
        raise SourceError(files.where, "aff_left.png or aff_right.png with a region in every mode", "none", "remove the case")
    notes += [note for mode, said in zip(modes, taxonomy, strict=True) if (note := _disagreement(mode, said))]
    objects = np.stack([_fit(_mask(files, f"obj_{side}.png"), size, f"obj_{side}.png", notes) for side in SIDES])
    words = {key: str(annotation.get(key) or "") for key in ("verb", "noun")}
    data = np.frombuffer(files.files[IMAGE].path.read_bytes(), np.uint8)
    return Case(files.protocol, files.video, files.frame, _groups(files, annotation), task(files), words["verb"], words["noun"],
                data, modes, np.array(taxonomy, np.int8), objects, tuple(notes))


def task(files: CaseFiles) -> str:
    """Read the task, the narration of a case."""
    return str(json_field(_json(files, ANNOTATION), "narration", str, f"{files.where}/{ANNOTATION}"))


def picture(files: CaseFiles) -> np.ndarray:
    """Decode the image of the files of a case, (h, w, 3) uint8 RGB at its own size."""
    return _decode(np.frombuffer(files.files[IMAGE].path.read_bytes(), np.uint8), files.where)


def image(case: Case) -> np.ndarray:
    """Decode the image of a case, (h, w, 3) uint8 RGB at its own size."""
    return _decode(case.image, case.case_id)


def _decode(data: np.ndarray, where: str) -> np.ndarray:
    decoded = cv2.imdecode(data, cv2.IMREAD_COLOR_RGB)
    if decoded is None:
        raise SourceError(f"{where}/{IMAGE}", "a PNG or JPEG", "other bytes", "get the file again")
    return np.asarray(decoded)


def grey(ref: FileRef) -> np.ndarray:
    """Decode a mask file, (h, w) uint8. SourceError when it is not a picture."""
    decoded = cv2.imdecode(np.frombuffer(ref.path.read_bytes(), np.uint8), cv2.IMREAD_GRAYSCALE)
    if decoded is None:
        raise SourceError(ref.name, "a grey PNG", f"{ref.size} other bytes", "get the file again")
    return np.asarray(decoded)


def resize_mask(mask: np.ndarray, size: Size) -> np.ndarray:
    """Resize a mask (h, w) bool by nearest neighbour with exact pixel centres."""
    if mask.shape == size:
        return mask
    return cv2.resize(mask.view(np.uint8), size[::-1], interpolation=cv2.INTER_NEAREST_EXACT).view(bool)


def _json(files: CaseFiles, name: str) -> Any:
    if name not in files.files:
        raise SourceError(files.where, name, "no such file", "every case needs one")
    return parse_json(files.files[name].path.read_bytes(), f"{files.where}/{name}")


def _modes(files: CaseFiles, annotation: Any) -> tuple[list[list[tuple[np.ndarray | None, str]]], list[int]]:
    """Pairs of (mask or None, file name) of all modes, and their taxonomies; one mode without modes.json."""
    if MODES not in files.files:
        names = [{side: f"aff_{side}.png" for side in SIDES}]
        taxonomy = [_taxonomy(annotation, f"{files.where}/{ANNOTATION}")]
    else:
        where = f"{files.where}/{MODES}"
        names = json_field(_json(files, MODES), "modes", list, where)
        if not names or not all(isinstance(mode, dict) for mode in names):
            raise SourceError(where, "a list of objects, one per mode", repr(names), "list the mode of aff_*.png first")
        taxonomy = [_taxonomy(mode, where) for mode in names]
        _check_named(files, names, where)
    return [[(_mask(files, mode.get(side)), str(mode.get(side))) for side in SIDES] for mode in names], taxonomy


def _check_named(files: CaseFiles, modes: list[Any], where: str) -> None:
    for name in (mode.get(side) for mode in modes for side in SIDES):
        if name is not None and name not in files.files:
            raise SourceError(where, "names of files beside it", repr(name), "write the file or name it null")


def _drawn(files: CaseFiles, annotation: Any, outlines: Outlines) -> tuple[list[list[tuple[np.ndarray | None, str]]], list[int]]:
    pair = outlines(files, annotation)
    return [[(mask, f"outline of the {side} hand") for mask, side in zip(pair, SIDES, strict=True)]], [
        _taxonomy(annotation, f"{files.where}/{ANNOTATION}")]


def _mask(files: CaseFiles, name: str | None) -> np.ndarray | None:
    return grey(files.files[name]) > 0 if name in files.files else None


def _size(files: CaseFiles, regions: list[list[tuple[np.ndarray | None, str]]]) -> Size:
    """Size (h, w) at which a case is scored: that of the crop, else of the first true mask (855 x 855 as released)."""
    if files.protocol == "cropped":
        try:
            width, height = Image.open(io.BytesIO(files.files[IMAGE].path.read_bytes())).size
        except OSError as error:
            raise SourceError(f"{files.where}/{IMAGE}", "a PNG or JPEG", str(error), "get the file again") from error
        return height, width
    first = next((mask for pair in regions for mask, _ in pair if mask is not None), None)
    if first is None:
        raise SourceError(files.where, "aff_left.png or aff_right.png", "neither", "remove the case")
    return first.shape[0], first.shape[1]


def _fit(mask: np.ndarray | None, size: Size, name: str, notes: list[str]) -> np.ndarray:
    if mask is None:
        return np.zeros(size, bool)
    if mask.shape != size:
        notes.append(f"{name} resized from {mask.shape[1]}x{mask.shape[0]} to {size[1]}x{size[0]}")
    elif not mask.any():
        notes.append(f"{name} is empty")
    return resize_mask(mask, size)


def _taxonomy(record: Any, where: str) -> int:
    """Class of a one-hot vector, -1 without a vector."""
    if record.get("taxonomy") is None:
        return int(Taxonomy.NONE)
    found = record["taxonomy"]
    if not isinstance(found, list) or len(found) != len(TAXONOMY) or sorted(found) != [0, 0, 0, 1]:
        raise SourceError(f"{where}, field 'taxonomy'", "four numbers, one of them 1 and the others 0", repr(found), "correct it")
    return found.index(1)


def _disagreement(mode: np.ndarray, taxonomy: int) -> str:
    """Note about an annotated class that contradicts the masks; '' when they agree."""
    seen = tuple(bool(mask.any()) for mask in mode)
    if taxonomy == Taxonomy.NONE or seen == TAKES[taxonomy]:
        return ""
    hands = " and ".join(side for side, here in zip(SIDES, seen, strict=True) if here)
    return f"taxonomy disagrees: it says {TAXONOMY[taxonomy]}, the masks say {hands}"


def _groups(files: CaseFiles, annotation: Any) -> tuple[str, ...]:
    """Groups of a case in the report: all, kitchen or shift, the source if from ActAffordance, and those that the file adds."""
    epic = files.video.startswith("P")
    scene = str(annotation.get("scene") or (KITCHEN if epic else "other"))
    source = () if MODES in files.files else ("epic" if epic else "ego4d",)
    more = annotation.get("groups") or []
    if not isinstance(more, list) or not all(isinstance(name, str) and name.isidentifier() for name in more):
        raise SourceError(f"{files.where}/{ANNOTATION}, field 'groups'", "a list of plain words", repr(more), "correct it")
    return tuple(dict.fromkeys(("all", KITCHEN if scene == KITCHEN else SHIFT, *source, *more)))
