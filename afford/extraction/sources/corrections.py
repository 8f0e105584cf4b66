"""Wrong contacts put right: a table beside VISOR's annotations, which must speak of what is there. VISOR-HOS (correct.json)."""

from __future__ import annotations

from collections.abc import Iterable

from afford.common.errors import SourceError
from afford.common.text import parse_json, word_tables
from afford.extraction.sources.discover import CORRECTIONS
from afford.extraction.sources.hands import Corrections, plain
from afford.extraction.sources.rows import Sheet
from schemas.files import FileTree
from schemas.video import NOT_IN_CONTACT, UNKNOWN_CONTACT


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
