"""Every mask file of one video -> its key frames: VISOR sparse and dense, VISOR or COCO JSON of one's own."""

from __future__ import annotations

import zipfile
from collections.abc import Sequence

from afford.common.bounded import ZIP_ERRORS, read_member, reason
from afford.common.errors import SourceError
from afford.common.text import parse_json
from afford.common.video.probe import epic_rate
from afford.extraction.sources import coco, visor
from afford.extraction.sources.corrections import check_used, read_corrections
from afford.extraction.sources.discover import DENSE, EXTRAS, SPARSE
from afford.extraction.sources.grid import check_grid
from afford.extraction.sources.hand_names import check_names
from afford.extraction.sources.hands import key_frame
from afford.extraction.sources.mapping import read_mapping
from afford.extraction.sources.rows import Note, Sheet
from schemas.files import FileRef, FileTree
from schemas.video import KeyFrame

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
