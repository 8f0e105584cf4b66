"""The hands of one key frame: gloves count as the hand they are on, a doubtful frame is left out, contacts name a mask."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

import numpy as np

from afford.extraction.sources.hand_names import side_of
from afford.extraction.sources.polygons import union
from afford.extraction.sources.rows import Note, Row, Sheet, visible
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
