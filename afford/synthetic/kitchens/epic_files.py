"""Writer of the files of an EPIC-KITCHENS-100 / VISOR root: sparse annotations, narrations, classes and video info.

Names, columns and JSON are those of a real root, and polygons are in 1920 x 1080, so the readers need no special case.
`write_root` joins the files of several rendered clips into one root.
"""

from __future__ import annotations

import csv
import hashlib
import json
import shutil
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np

from afford.synthetic.kitchens.vocabulary import NOUNS, VERBS, WordClass, noun_class, verb_class
from schemas.files import FileRef, FileTree
from schemas.masks import Entity
from schemas.video import HAND_CLASS, SIDES, Narration

GRID_WH = (1920, 1080)


def mask_to_polygons(mask: np.ndarray) -> list[list[list[float]]]:
    """Convert a mask (h, w) bool to VISOR polygons: lists of [x, y] corners in the 1920 x 1080 grid, holes included.

    The mask is enlarged so that each of its pixels covers exactly the grid cells that nearest-neighbour resizing reads it from.
    Every border is then traced. Drawing all polygons together (even-odd rule, borders included) fills the same cells.
    """
    rows, columns = _cells(mask.shape[0], GRID_WH[1]), _cells(mask.shape[1], GRID_WH[0])
    large = np.ascontiguousarray(mask[rows][:, columns]).view(np.uint8)
    outlines, _ = cv2.findContours(large, cv2.RETR_CCOMP, cv2.CHAIN_APPROX_SIMPLE)
    return [outline.reshape(-1, 2).astype(float).tolist() for outline in outlines]


def _cells(size: int, grid: int) -> np.ndarray:
    """Map each of `grid` cells to the index of its pixel, out of `size` pixels."""
    first = np.arange(size) * grid // size
    return np.searchsorted(first, np.arange(grid), side="right") - 1


FPS = 30
ACTION_COLUMNS = (
    "narration_id", "participant_id", "video_id", "narration_timestamp", "start_timestamp", "stop_timestamp", "start_frame",
    "stop_frame", "narration", "verb", "verb_class", "noun", "noun_class", "all_nouns", "all_noun_classes")
ACTION_FILES = {"train": "EPIC_100_train.csv", "val": "EPIC_100_validation.csv"}
CLASS_COLUMNS = ("id", "key", "instances", "category")
INFO_COLUMNS = ("video_id", "duration", "fps", "resolution")


@dataclass(frozen=True)
class KeyMasks:
    """Masks and contacts of one annotated key frame."""

    frame: int
    masks: np.ndarray
    """(n, h, w) bool visible pixels of each entity; an empty mask is not annotated"""
    contact: tuple[int, int]
    """index of the entity that the (left, right) hand touches, -1 for none"""


def write_annotations(path: Path, video_id: str, entities: Sequence[Entity], keys: Sequence[KeyMasks]) -> None:
    """Write the sparse VISOR annotations of one video as JSON."""
    path.parent.mkdir(parents=True, exist_ok=True)
    points = [{"image": _image(video_id, key.frame), "annotations": _annotations(video_id, entities, key)} for key in keys]
    path.write_text(json.dumps({"video_annotations": points}, separators=(",", ":")), encoding="utf-8")


def _image(video_id: str, frame: int) -> dict[str, str]:
    name = f"{video_id}_frame_{frame:010d}.jpg"
    return {"image_path": f"{video_id}/{name}", "name": name, "subsequence": f"{video_id}_seq_00001", "video": video_id}


def _annotations(video_id: str, entities: Sequence[Entity], key: KeyMasks) -> list[dict[str, object]]:
    seen = [index for index in range(len(entities)) if key.masks[index].any()]
    ids = {index: _annotation_id(video_id, key.frame, entities[index].entity_id) for index in seen}
    rows: list[dict[str, object]] = []
    for index in seen:
        entity = entities[index]
        row: dict[str, object] = {"id": ids[index], "name": entity.name, "class_id": entity.class_id, "exhaustive": "y",
                                  "segments": mask_to_polygons(key.masks[index])}
        if entity.role == "hand":
            touched = key.contact[0 if entity.side == "left" else 1]
            row["in_contact_object"] = ids.get(touched, "hand-not-in-contact" if touched < 0 else "none-of-the-above")
        rows.append(row)
    return rows


def _annotation_id(video_id: str, frame: int, entity_id: str) -> str:
    return hashlib.md5(f"{video_id}/{frame}/{entity_id}".encode(), usedforsecurity=False).hexdigest()


def write_actions(root: Path, video_id: str, split: str, narrations: Sequence[Narration]) -> None:
    """Write the narration CSV of a split, with EPIC's 15 columns."""
    rows = [_action(video_id, narration) for narration in narrations]
    write_csv(root / ACTION_FILES[split], ACTION_COLUMNS, rows)


def _action(video_id: str, narration: Narration) -> dict[str, object]:
    start, stop = narration.start_frame / FPS, narration.stop_frame / FPS
    classes = [noun_class(noun).id for noun in narration.all_nouns]
    values = (narration.narration_id, video_id.split("_")[0], video_id, _clock(start, 3), _clock(start, 2), _clock(stop, 2),
              narration.start_frame, narration.stop_frame, narration.text, narration.verb, narration.verb_class, narration.noun,
              narration.noun_class, str(list(narration.all_nouns)), str(classes))
    return dict(zip(ACTION_COLUMNS, values, strict=True))


def _clock(seconds: float, digits: int) -> str:
    whole = int(seconds)
    return f"{whole // 3600:02d}:{whole // 60 % 60:02d}:{seconds % 60:0{3 + digits}.{digits}f}"


def write_classes(root: Path, nouns: Iterable[str]) -> None:
    """Write the verb and noun class files: the used part of EPIC's tables, and the clip's nouns that EPIC lacks."""
    known = {entry.id: entry for entry in (*NOUNS, *map(noun_class, nouns))}
    write_csv(root / "EPIC_100_verb_classes.csv", CLASS_COLUMNS, [_class_row(entry) for entry in VERBS])
    write_csv(root / "EPIC_100_noun_classes_v2.csv", CLASS_COLUMNS, [_class_row(known[key]) for key in sorted(known)])


def _class_row(entry: WordClass) -> dict[str, object]:
    return {"id": entry.id, "key": entry.key, "instances": str(list(entry.instances)), "category": entry.category}


def write_info(root: Path, video_id: str, frames: int, width: int, height: int) -> None:
    """Write the video info CSV of one video."""
    row = {"video_id": video_id, "duration": f"{frames / FPS:.6f}", "fps": f"{FPS:.2f}", "resolution": f"{width}x{height}"}
    write_csv(root / "EPIC_100_video_info.csv", INFO_COLUMNS, [row])


def write_csv(path: Path, columns: Sequence[str], rows: Iterable[Mapping[str, object]]) -> None:
    """Write a CSV file with a header and Unix line endings."""
    path.parent.mkdir(parents=True, exist_ok=True)
    with path.open("w", newline="", encoding="utf-8") as file:
        writer = csv.DictWriter(file, columns, lineterminator="\n")
        writer.writeheader()
        writer.writerows(rows)


def narration(video_id: str, number: int, interval: tuple[int, int], text: str, verb: str, nouns: Sequence[str]) -> Narration:
    """Build a narration in EPIC's classes; the first of `nouns` is its main noun."""
    action, obj = verb_class(verb), noun_class(nouns[0])
    return Narration(
        narration_id=f"{video_id}_{number}", start_frame=interval[0], stop_frame=interval[1], text=text, verb=verb,
        verb_class=action.id, verb_key=action.key, noun=nouns[0], noun_class=obj.id, noun_key=obj.key,
        all_nouns=tuple(nouns))


def hand_entities() -> tuple[Entity, Entity]:
    """Return the entities of the left and the right hand, named as in VISOR."""
    left, right = (Entity(f"{side} hand", f"{side} hand", HAND_CLASS[side], "hand", side) for side in SIDES)
    return left, right


CLASS_FILES = ("EPIC_100_verb_classes.csv", "EPIC_100_noun_classes_v2.csv")


def write_root(trees: Iterable[FileTree], root: Path) -> None:
    """Write all files of `trees` (`files`, and optionally `truth`, of rendered clips) into one root.

    CSV tables are joined; other files are copied. Raises ValueError when two clips contain different files of the same name, or
    table rows that share a key but differ.
    """
    by_name: dict[str, list[FileRef]] = {}
    for tree in trees:
        for file in tree.files:
            by_name.setdefault(file.name, []).append(file)
    for name in sorted(by_name):
        _write_joined(root / name, by_name[name])


def _write_joined(path: Path, files: list[FileRef]) -> None:
    path.parent.mkdir(parents=True, exist_ok=True)
    if path.suffix == ".csv":
        _join_tables(path, files, by_id=path.name in CLASS_FILES)
    elif len({file.digest for file in files}) > 1:
        raise ValueError(f"{files[0].name}: two clips bring different files of this name; give them different video ids")
    else:
        shutil.copyfile(files[0].path, path)


def _join_tables(path: Path, files: list[FileRef], by_id: bool) -> None:
    rows: dict[str, dict[str, str]] = {}
    columns: tuple[str, ...] = ()
    for file in files:
        with file.path.open(newline="", encoding="utf-8") as stream:
            reader = csv.DictReader(stream)
            columns = columns or tuple(reader.fieldnames or ())
            for row in reader:
                key = row[columns[0]]
                if rows.setdefault(key, row) != row:
                    raise ValueError(f"{path.name}: {columns[0]} {key} has two different rows; give clips different video ids")
    ordered = sorted(rows.values(), key=lambda row: int(row[columns[0]])) if by_id else list(rows.values())
    write_csv(path, columns, ordered)
