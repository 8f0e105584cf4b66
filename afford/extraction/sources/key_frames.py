"""Key frames of a video from its mask files: VISOR sparse and dense, own VISOR or COCO JSON, corrections of contacts.

A glove is merged with the hand that wears it. A frame with an ambiguous hand is dropped. Contacts refer to masks of the frame.
"""

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
from afford.extraction.sources.rows import AnnotatedImage, Note, RawAnnotation, check_grid_size, visible_rows
from afford.extraction.sources.visor import read_mapping
from schemas.files import FileRef, FileTree
from schemas.video import HAND_CLASS, NOT_IN_CONTACT, SIDES, UNKNOWN_CONTACT, Annotation, Hand, KeyFrame

OTHER_WORDS = {"none": "hand-not-in-contact"}
Corrections = Mapping[str, Mapping[str, str]]
"""image name -> hand name -> annotation id of the object that it truly touches"""


def normalise_name(name: str) -> str:
    """Normalise a name: 'left hand' for every spelling of one, else lower case with single spaces."""
    side = side_of(name)
    return f"{side} hand" if side else " ".join(name.lower().replace("_", " ").replace("-", " ").split())


def make_key_frame(annotated: AnnotatedImage, dense: bool, corrections: Corrections, notes: list[Note]) -> KeyFrame | None:
    """Build the key frame of an image; None when a hand is annotated twice with different outlines.

    Such a frame is dropped as a whole, because without the hand it would count as invisible. Corrections are reported in `notes`.
    """
    rows = [_correct(row, corrections.get(annotated.image, {})) for row in visible_rows(annotated, notes)]
    names = [normalise_name(row.name) for row in rows]
    hands: dict[str, list[RawAnnotation]] = {
        side: [row for row, name in zip(rows, names, strict=True) if name == f"{side} hand"] for side in SIDES
    }
    gloves: dict[str, list[RawAnnotation]] = {side: [row for row in rows if _worn_on(row) == {side}] for side in SIDES}
    for side, found in hands.items():
        if any(not _same_outlines(found[0], other) for other in found[1:]):
            remark = f"{annotated.where}: the {side} hand is annotated {len(found)} times; the frame was left out"
            notes.append((annotated.frame, remark))
            return None
    merged = [_merge(side, hands[side], gloves[side], annotated) for side in SIDES if hands[side] or gloves[side]]
    alias = {row.annotation_id: hand.annotation_id for hand in merged for row in [*hands[hand.side], *gloves[hand.side]]}
    annotations = [*merged, *(_annotation(row) for row in rows if row.annotation_id not in alias)]
    settled = tuple(_resolve_contact(a, annotations, alias, annotated, notes) for a in annotations)
    return KeyFrame(annotated.frame, annotated.width_px, annotated.height_px, settled, dense)


def _correct(row: RawAnnotation, right: Mapping[str, str]) -> RawAnnotation:
    return replace(row, contact=right[normalise_name(row.name)]) if normalise_name(row.name) in right else row


def _worn_on(row: RawAnnotation) -> set[str]:
    """Sides of the hands that wear this glove; empty for other annotations."""
    if "glove" not in normalise_name(row.name):
        return set()
    return {side for side in SIDES if f"{side} hand" in map(normalise_name, row.worn)}


def _same_outlines(a: RawAnnotation, b: RawAnnotation) -> bool:
    return len(a.polygons) == len(b.polygons) and all(
        np.array_equal(p.points, q.points) for p, q in zip(a.polygons, b.polygons, strict=True))


def _merge(side: Hand, hands: list[RawAnnotation], gloves: list[RawAnnotation], annotated: AnnotatedImage) -> Annotation:
    """Merge a hand with its gloves into one annotation: the union of the outlines, with the contact of the glove if it has one."""
    parts = [*hands[:1], *gloves]
    polygons = parts[0].polygons
    for part in parts[1:]:
        polygons = union(polygons, part.polygons, annotated.width_px, annotated.height_px)
    contact = next((row.contact for row in [*gloves, *hands] if row.contact), "")
    head = parts[0]
    return Annotation(head.annotation_id, f"{side} hand", HAND_CLASS[side], side, contact, head.exhaustive, polygons)


def _annotation(row: RawAnnotation) -> Annotation:
    """Convert an object, or a pair of gloves in one mask, to an annotation."""
    both = _worn_on(row) == set(SIDES)
    contact = row.contact if both else ""
    return Annotation(row.annotation_id, row.name, row.class_id, "both" if both else "", contact, row.exhaustive, row.polygons)


def _resolve_contact(
    annotation: Annotation, others: list[Annotation], alias: Mapping[str, str], annotated: AnnotatedImage, notes: list[Note]
) -> Annotation:
    """Resolve the contact of an annotation to one of VISOR's words or to the id of a mask of this frame."""
    contact = OTHER_WORDS.get(annotation.contact, annotation.contact)
    if annotation.side == "" or contact in NOT_IN_CONTACT or contact in UNKNOWN_CONTACT:
        return replace(annotation, contact=contact)
    named = [other.annotation_id for other in others if alias.get(contact, contact) == other.annotation_id or contact == other.name]
    if len(named) == 1:
        return replace(annotation, contact=named[0])
    remark = f"{annotated.where}: {annotation.name!r} touches {contact!r}, which is no mask of this frame; counted as inconclusive"
    notes.append((annotated.frame, remark))
    return replace(annotation, contact="inconclusive")


def read_corrections(files: FileTree) -> Corrections:
    """Read the table of corrected contacts (VISOR-HOS, correct.json); SourceError for another format."""
    file = next((found for name in CORRECTIONS if (found := files.find(name))), None)
    return word_tables(parse_json(file.path.read_bytes(), file.name), file.name) if file else {}


def check_used(corrections: Corrections, images: Iterable[AnnotatedImage], video: str) -> None:
    """Raise SourceError for a correction of this video that refers to an unknown image, hand or mask."""
    by_name = {annotated.image: annotated for annotated in images}
    for image, hands in corrections.items():
        if not image.startswith(f"{video}_"):
            continue
        rows = by_name[image].rows if image in by_name else ()
        names = {normalise_name(row.name) for row in rows}
        known = {row.annotation_id for row in rows} | {*NOT_IN_CONTACT, *UNKNOWN_CONTACT}
        for hand, contact in hands.items():
            if normalise_name(hand) not in names or contact not in known:
                raise SourceError(f"{CORRECTIONS[0]}, {image}", "an annotated image, one of its hands, and a mask of it or a word "
                                  "of VISOR", f"{hand!r}: {contact!r}", "correct the entry or remove it")


MOST_BYTES = 1 << 31
"""size limit of the JSON of one video; interpolations of the longest videos have some hundred MiB"""


def has_masks(files: FileTree) -> bool:
    """Test for files with masks of the video."""
    return bool(_mask_files(files))


def read_keys(files: FileTree, notes: list[Note], frames: Sequence[str] = ()) -> list[KeyFrame]:
    """Read the key frames in order; manual annotations override dense interpolations.

    frames: names of the media. Corrected and dropped annotations are reported in `notes`. SourceError for a malformed file, and
    without masks.
    """
    corrections, images = read_corrections(files), read_annotated_images(files, notes, frames)
    check_used(corrections, (annotated for annotated, _ in images.values()), files.name)
    keys = [make_key_frame(*images[frame], corrections, notes) for frame in sorted(images)]
    if not any(keys):
        raise SourceError(files.name, "at least one image with masks", "files without masks", "annotate some frames")
    return [key for key in keys if key]


def read_annotated_images(
    files: FileTree, notes: list[Note], frames: Sequence[str] = ()
) -> dict[int, tuple[AnnotatedImage, bool]]:
    """Read frame number -> (annotated image, dense); manual annotations override dense interpolations."""
    mapped = read_mapping(files, frames)
    images: dict[int, tuple[AnnotatedImage, bool]] = {}
    for file in sorted(_mask_files(files), key=lambda file: not file.name.startswith(DENSE)):
        dense = file.name.startswith(DENSE)
        found = _drop_unmapped(_read_file(file, dense, mapped), file.name, notes)
        check_grid_size(found, file.name, notes)
        if epic_rate(files.name) is None:  # names in the masks of VISOR itself need no check
            check_names(found, file.name, notes)
        images.update({annotated.frame: (annotated, dense) for annotated in found})
    return images


def _mask_files(files: FileTree) -> list[FileRef]:
    own = not any(file.name.startswith((SPARSE, DENSE)) for file in files.files)
    return [file for file in files.files if file.name.startswith(DENSE) or
            (file.name.endswith(".json") and (file.name.startswith(SPARSE) or (own and file.name not in EXTRAS)))]


def _drop_unmapped(images: list[AnnotatedImage], name: str, notes: list[Note]) -> list[AnnotatedImage]:
    """Drop images without a frame number, with a remark."""
    lost = [annotated.image for annotated in images if annotated.frame == visor.UNMAPPED]
    if lost:
        notes.append((0, f"{name}: {len(lost)} images are not in frame_mapping.json, {lost[0]} is the first; they were left out"))
    return [annotated for annotated in images if annotated.frame != visor.UNMAPPED]


def _read_file(file: FileRef, dense: bool, mapped: visor.Mapped) -> list[AnnotatedImage]:
    document = parse_json(_bytes(file), file.name)
    if isinstance(document, dict) and "video_annotations" in document:
        return visor.read_images(document, file.name, visor.DENSE_GRID_WH if dense else visor.SPARSE_GRID_WH, mapped)
    if isinstance(document, dict) and {"images", "annotations", "categories"} <= document.keys():
        return coco.read_images(document, file.name)
    got = ", ".join(map(str, document)) if isinstance(document, dict) else type(document).__name__
    raise SourceError(file.name, "'video_annotations' (VISOR) or 'images', 'annotations' and 'categories' (COCO)",
                      got or "nothing", "see docs/extraction/own-video.md")


def _bytes(file: FileRef) -> bytes:
    """Read the JSON text of a file, or of the only JSON file in a zip."""
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
