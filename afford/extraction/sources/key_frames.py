"""The hands of one key frame: gloves count as the hand they are on, a doubtful frame is left out, contacts name a mask."""

from __future__ import annotations

import zipfile
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import replace

import numpy as np

from afford.common.bounded import ZIP_ERRORS, read_member, reason
from afford.common.errors import SourceError
from afford.common.text import parse_json, word_tables
from afford.common.video.probe import epic_rate
from afford.extraction.sources import coco, visor
from afford.extraction.sources.discover import CORRECTIONS, DENSE, EXTRAS, SPARSE
from afford.extraction.sources.hand_names import check_names, side_of
from afford.extraction.sources.outlines import union
from afford.extraction.sources.rows import Note, Row, Sheet, check_grid, visible
from afford.extraction.sources.visor import read_mapping
from schemas.files import FileRef, FileTree
from schemas.video import HAND_CLASS, NOT_IN_CONTACT, SIDES, UNKNOWN_CONTACT, Annotation, Hand, KeyFrame

OTHER_WORDS = {"none": "hand-not-in-contact"}
Corrections = Mapping[str, Mapping[str, str]]
"""image name -> hand name -> annotation id of the object it really touches"""


def plain(name: str) -> str:
    """A name as VISOR would write it, if it is a hand or a glove: 'left hand' for every spelling of one, else lower case and single
    spaces.
    """
    side = side_of(name)
    return f"{side} hand" if side else " ".join(name.lower().replace("_", " ").replace("-", " ").split())


def key_frame(sheet: Sheet, dense: bool, corrections: Corrections, notes: list[Note]) -> KeyFrame | None:
    """The key frame, or None when a hand is annotated twice in different ways: which is meant cannot be known, and without
    the hand it would seem to be out of sight. `notes` says what was corrected or left out.
    """
    rows = [_correct(row, corrections.get(sheet.image, {})) for row in visible(sheet, notes)]
    hands: dict[str, list[Row]] = {side: [row for row in rows if plain(row.name) == f"{side} hand"] for side in SIDES}
    gloves: dict[str, list[Row]] = {side: [row for row in rows if _worn_on(row) == {side}] for side in SIDES}
    for side, found in hands.items():
        if any(not _same(found[0], other) for other in found[1:]):
            remark = f"{sheet.where}: the {side} hand is annotated {len(found)} times; the frame was left out"
            notes.append((sheet.frame, remark))
            return None
    merged = [_merge(side, hands[side], gloves[side], sheet) for side in SIDES if hands[side] or gloves[side]]
    alias = {row.annotation_id: hand.annotation_id for hand in merged for row in [*hands[hand.side], *gloves[hand.side]]}
    annotations = [*merged, *(_annotation(row) for row in rows if row.annotation_id not in alias)]
    settled = tuple(_settle(a, annotations, alias, sheet, notes) for a in annotations)
    return KeyFrame(sheet.frame, sheet.width_px, sheet.height_px, settled, dense)


def _correct(row: Row, right: Mapping[str, str]) -> Row:
    return replace(row, contact=right[plain(row.name)]) if plain(row.name) in right else row


def _worn_on(row: Row) -> set[str]:
    """Sides of the hands that this glove is on; empty for everything else."""
    if "glove" not in plain(row.name):
        return set()
    return {side for side in SIDES if f"{side} hand" in map(plain, row.worn)}


def _same(a: Row, b: Row) -> bool:
    return len(a.polygons) == len(b.polygons) and all(
        np.array_equal(p.points, q.points) for p, q in zip(a.polygons, b.polygons, strict=True))


def _merge(side: Hand, hands: list[Row], gloves: list[Row], sheet: Sheet) -> Annotation:
    """One annotation of hand and glove, drawn as their union; the contact is the glove's when there is one."""
    parts = [*hands[:1], *gloves]
    polygons = parts[0].polygons
    for part in parts[1:]:
        polygons = union(polygons, part.polygons, sheet.width_px, sheet.height_px)
    contact = next((row.contact for row in [*gloves, *hands] if row.contact), "")
    head = parts[0]
    return Annotation(head.annotation_id, f"{side} hand", HAND_CLASS[side], side, contact, head.exhaustive, polygons)


def _annotation(row: Row) -> Annotation:
    """An object, or gloves that are one mask on both hands."""
    both = _worn_on(row) == set(SIDES)
    contact = row.contact if both else ""
    return Annotation(row.annotation_id, row.name, row.class_id, "both" if both else "", contact, row.exhaustive, row.polygons)


def _settle(
    annotation: Annotation, others: list[Annotation], alias: Mapping[str, str], sheet: Sheet, notes: list[Note]
) -> Annotation:
    """The same annotation with a contact that is one of VISOR's words or the id of a mask of this frame."""
    said = OTHER_WORDS.get(annotation.contact, annotation.contact)
    if annotation.side == "" or said in NOT_IN_CONTACT or said in UNKNOWN_CONTACT:
        return replace(annotation, contact=said)
    named = [other.annotation_id for other in others if alias.get(said, said) == other.annotation_id or said == other.name]
    if len(named) == 1:
        return replace(annotation, contact=named[0])
    remark = f"{sheet.where}: {annotation.name!r} touches {said!r}, which is no mask of this frame; counted as inconclusive"
    notes.append((sheet.frame, remark))
    return replace(annotation, contact="inconclusive")


def read_corrections(files: FileTree) -> Corrections:
    """Image name -> hand name -> annotation id; SourceError when the file is of another form."""
    file = next((found for name in CORRECTIONS if (found := files.find(name))), None)
    return word_tables(parse_json(file.path.read_bytes(), file.name), file.name) if file else {}


def check_used(corrections: Corrections, sheets: Iterable[Sheet], video: str) -> None:
    """SourceError when a correction speaks of an image of this video, a hand or a mask that is not there."""
    images = {sheet.image: sheet for sheet in sheets}
    for image, hands in corrections.items():
        if not image.startswith(f"{video}_"):
            continue
        rows = images[image].rows if image in images else ()
        names, said = {plain(row.name) for row in rows}, {row.annotation_id for row in rows} | {*NOT_IN_CONTACT, *UNKNOWN_CONTACT}
        for hand, contact in hands.items():
            if plain(hand) not in names or contact not in said:
                raise SourceError(f"{CORRECTIONS[0]}, {image}", "an annotated image, one of its hands, and a mask of it or a word "
                                  "of VISOR", f"{hand!r}: {contact!r}", "correct the entry or remove it")


MOST_BYTES = 1 << 31
"""of the JSON of one video: interpolations of the longest videos have some hundred MiB"""


def has_masks(files: FileTree) -> bool:
    """Whether somebody annotated the video."""
    return bool(_mask_files(files))


def read_keys(files: FileTree, notes: list[Note], frames: Sequence[str] = ()) -> list[KeyFrame]:
    """Key frames by frame; a ready-made one gives way to the annotator's own. `frames` are the names of the media. SourceError
    when a file is malformed or none has masks. `notes` says what was corrected or left out.
    """
    corrections, sheets = read_corrections(files), read_sheets(files, notes, frames)
    check_used(corrections, (sheet for sheet, _ in sheets.values()), files.name)
    keys = [key_frame(*sheets[frame], corrections, notes) for frame in sorted(sheets)]
    if not any(keys):
        raise SourceError(files.name, "at least one image with masks", "none", "annotate some frames")
    return [key for key in keys if key]


def read_sheets(files: FileTree, notes: list[Note], frames: Sequence[str] = ()) -> dict[int, tuple[Sheet, bool]]:
    """Frame -> the annotations of its image as they are written, and whether they are ready-made; the annotator's own win."""
    mapped = read_mapping(files, frames)
    sheets: dict[int, tuple[Sheet, bool]] = {}
    for file in sorted(_mask_files(files), key=lambda file: not file.name.startswith(DENSE)):
        dense = file.name.startswith(DENSE)
        found = _placed(_sheets(file, dense, mapped), file.name, notes)
        check_grid(found, file.name, notes)
        if epic_rate(files.name) is None:  # masks that VISOR publishes are as they are
            check_names(found, file.name, notes)
        sheets.update({sheet.frame: (sheet, dense) for sheet in found})
    return sheets


def _mask_files(files: FileTree) -> list[FileRef]:
    own = not any(file.name.startswith((SPARSE, DENSE)) for file in files.files)
    return [file for file in files.files if file.name.startswith(DENSE) or
            (file.name.endswith(".json") and (file.name.startswith(SPARSE) or (own and file.name not in EXTRAS)))]


def _placed(sheets: list[Sheet], name: str, notes: list[Note]) -> list[Sheet]:
    """Those whose frame is known."""
    lost = [sheet.image for sheet in sheets if sheet.frame == visor.NOWHERE]
    if lost:
        notes.append((0, f"{name}: {len(lost)} images are not in frame_mapping.json, {lost[0]} is the first; they were left out"))
    return [sheet for sheet in sheets if sheet.frame != visor.NOWHERE]


def _sheets(file: FileRef, dense: bool, mapped: visor.Mapped) -> list[Sheet]:
    document = parse_json(_bytes(file), file.name)
    if isinstance(document, dict) and "video_annotations" in document:
        return visor.sheets(document, file.name, visor.DENSE_GRID_WH if dense else visor.SPARSE_GRID_WH, mapped)
    if isinstance(document, dict) and {"images", "annotations", "categories"} <= document.keys():
        return coco.sheets(document, file.name)
    got = ", ".join(map(str, document)) if isinstance(document, dict) else type(document).__name__
    raise SourceError(file.name, "'video_annotations' (VISOR) or 'images', 'annotations' and 'categories' (COCO)",
                      got or "nothing", "see docs/extraction/own-video.md")


def _bytes(file: FileRef) -> bytes:
    """The JSON text of a file, or of the one JSON file in a zip."""
    if not file.name.endswith(".zip"):
        return file.path.read_bytes()
    try:
        with zipfile.ZipFile(file.path) as archive:
            inside = [item for item in archive.infolist() if item.filename.endswith(".json")]
            if len(inside) == 1:
                return read_member(archive, inside[0], file.name, MOST_BYTES)
    except SourceError:
        raise
    except ZIP_ERRORS as error:
        raise SourceError(file.name, "a zip file", reason(error), "get the file again") from error
    raise SourceError(file.name, "one JSON file in the zip", f"{len(inside)}", "unpack it by hand")
