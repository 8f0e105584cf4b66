"""ActAffordance's folder layout: reader of cases and predictions, and writer of rendered stills in the same layout.

    [data/]{masks,cropped}/<video>/<frame>/{inpainting.png, annotation.json, aff_left.png?, ...}     ground truth
    [masks|cropped/][<threshold>/]<video>/<frame>/aff_{left,right}.png                               predictions of any method

A written case contains the masks of the most likely mode under the published names, and every mode in modes.json.
"""

from __future__ import annotations

import re
from collections import defaultdict
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, NamedTuple

import cv2
import numpy as np

from afford.common.errors import SourceError
from afford.common.files import write_json
from afford.common.folders import entries
from afford.common.image_files import encode_png
from afford.common.masks import box
from schemas.files import FileRef, FileTree
from schemas.scene import Mode, Still, Stills
from schemas.video import SIDES

PROTOCOLS = ("cropped", "masks")
IMAGE, ANNOTATION, MODES = "inpainting.png", "annotation.json", "modes.json"
THRESHOLD = re.compile(r"\d*\.?\d+$")
"""threshold at the end of a folder name, as the released code writes it"""
DEPTH = 3
"""path components of a case: video, frame, file"""


class CaseFiles(NamedTuple):
    """Files of one case, by file name."""

    protocol: str
    video: str
    frame: str
    files: dict[str, FileRef]

    @property
    def where(self) -> str:
        """Path of the case: protocol, video and frame."""
        return f"{self.protocol}/{self.video}/{self.frame}"


def read_tree(root: Path, digest: Callable[[Path], str]) -> FileTree:
    """Index the files below `root` with their content digests. Raises SourceError for a missing folder or a link out of it."""
    if not root.is_dir():
        raise SourceError(str(root), "a folder", "a file" if root.exists() else "nothing", "give the folder itself")
    found = entries(root)
    for entry in found:
        if entry.leaves:
            raise SourceError(entry.name, "a file inside the folder", f"a link to {entry.path.resolve()}", "copy the file into it")
    refs = (FileRef(entry.name, digest(entry.path), entry.path.stat().st_size, entry.path) for entry in found)
    return FileTree(root.resolve().name, tuple(refs))


def cases(files: FileTree) -> list[CaseFiles]:
    """List all cases, cropped ones first, then by video and frame. Raises SourceError when there is none."""
    found: dict[tuple[str, str, str], dict[str, FileRef]] = {}
    for ref in files.files:
        parts = ref.name.removeprefix("data/").split("/")
        if len(parts) == 1 + DEPTH and parts[0] in PROTOCOLS:
            found.setdefault((parts[0], parts[1], parts[2]), {})[parts[3]] = ref
    listed = [CaseFiles(*key, found[key]) for key in sorted(found) if IMAGE in found[key]]
    if not listed:
        raise SourceError(files.name, f"cropped/<video>/<frame>/{IMAGE} or masks/<video>/<frame>/{IMAGE}", "none",
                          "give a folder in ActAffordance's layout, see docs/twohands/benchmark.md")
    return listed


def predictions(files: FileTree, protocol: str) -> Iterator[tuple[float | None, str, str, FileRef]]:
    """Yield (threshold or None, <protocol>/<video>/<frame>, left or right, file) of every predicted mask.

    A folder without a protocol in its path is of `protocol`. Raises SourceError when there is no prediction, and for a
    threshold folder whose name does not end in a number in 0..1.
    """
    empty = True
    for ref in files.files:
        parts = ref.name.split("/")
        side = {"aff_left.png": "left", "aff_right.png": "right"}.get(parts[-1])
        if side is None or len(parts) < DEPTH:
            continue
        *above, video, frame, _ = parts
        named = above.pop(0) if above and above[0] in PROTOCOLS else protocol
        yield _threshold(above, ref.name), f"{named}/{video}/{frame}", side, ref
        empty = False
    if empty:
        raise SourceError(files.name, "<video>/<frame>/aff_left.png or aff_right.png", "none",
                          "give the folder that holds the videos, or one folder per threshold that does; "
                          "see docs/twohands/benchmark.md")


def _threshold(above: list[str], name: str) -> float | None:
    if not above:
        return None
    number = THRESHOLD.search(above[0])
    if len(above) > 1 or number is None or float(number[0]) > 1:
        raise SourceError(name, "[masks|cropped/][<threshold 0..1>/]<video>/<frame>/aff_*.png", "/".join(above),
                          "let the name of a threshold's folder end in its number, e.g. 0.3")
    return float(number[0])


PAPER_PX = 855
PNG = (cv2.IMWRITE_PNG_COMPRESSION, 6)
FREE_OVERLAP = 0.5
"""IoU of the most likely masks below which two tasks of one image select different regions."""
README = """# {name}

{stills} tasks in {pictures} rendered pictures of {rooms} rooms, in the folders of ActAffordance. `modes.json` lists every valid
way to do a task, the likeliest first; `aff_*.png` and `obj_*.png` are those of the first. `stills.json` lists all tasks with the
kinds of things that they speak of and the groups that they belong to:

- known, new: a kitchen with things and uses as in training; with some that training never shows
- workshop, desk: other scenes
- text_decides: another task of the same picture wants another place
- hands_from_image: tasks with the same verb and nouns take different hands, so that the text does not tell which
"""


@dataclass(frozen=True)
class StillFacts:
    """Properties of a still that depend on the whole set."""

    text_decides: bool
    text_tells_hands: bool


def write_benchmark(root: Path, rooms: Sequence[Stills], name: str, margin_px: int, progress: Callable[[int, int], None]) -> None:
    """Write the cropped and the full cases of all rooms. Raises ValueError when there is no still."""
    total, done = sum(len(room.stills) for room in rooms), 0
    if not total:
        raise ValueError("benchmark_set: there is no still to write; plan more rooms or layouts")
    facts = _still_facts(rooms)
    listed = []
    for room in rooms:
        for still in room.stills:
            known = _record(room, still, facts[room.video_id, still.number])
            _write_still(root, room, still, known, margin_px)
            listed.append({"video": room.video_id, "frame": frame_name(still)} | known)
            done += 1
            progress(done, total)
    write_json(root / "stills.json", {"stills": listed})
    numbers = {"stills": total, "pictures": sum(len(room.images) for room in rooms), "rooms": len(rooms)}
    (root / "README.md").write_text(README.format(name=name, **numbers), encoding="utf-8", newline="\n")


def frame_name(still: Still) -> str:
    """Return the frame name of a still: seven digits, as in the published sets."""
    return f"{still.number:07d}"


def row_of(room: Stills, still: Still) -> str:
    """Return the report row of a still: known or new (held-out kinds or uses) in kitchens, else workshop or desk."""
    return room.setting if room.setting != "kitchen" else "new" if still.new else "known"


def _record(room: Stills, still: Still, facts: StillFacts) -> dict[str, Any]:
    flags = {"text_decides": facts.text_decides, "hands_from_image": not facts.text_tells_hands}
    groups = [row_of(room, still), *(name for name, holds in flags.items() if holds)]
    return {"scene": room.setting, "groups": groups, "kinds": list(still.kinds), "picture": still.image}


def _still_facts(rooms: Sequence[Stills]) -> dict[tuple[str, int], StillFacts]:
    hands: dict[tuple[str, ...], set[int]] = defaultdict(set)
    for room in rooms:
        for still in room.stills:
            hands[_words(still)].update(mode.taxonomy for mode in still.modes)
    return {(room.video_id, still.number): StillFacts(_decides(room, still), len(hands[_words(still)]) == 1)
            for room in rooms for still in room.stills}


def _words(still: Still) -> tuple[str, ...]:
    return still.narration.verb_key, *sorted(still.narration.all_nouns)


def _decides(room: Stills, still: Still) -> bool:
    mine = still.modes[0].masks[:2].any(axis=0)
    others = (one.modes[0].masks[:2].any(axis=0) for one in room.stills if one.image == still.image and one.number != still.number)
    return any(np.count_nonzero(mine & other) < FREE_OVERLAP * np.count_nonzero(mine | other) for other in others)


def _write_still(root: Path, room: Stills, still: Still, known: dict[str, Any], margin_px: int) -> None:
    image = cv2.imdecode(room.images[still.image].jpeg, cv2.IMREAD_COLOR_BGR)
    height, width = still.modes[0].masks.shape[1:]
    things = np.any([mode.masks[2:].any(axis=0) for mode in still.modes], axis=0)
    shown = box(things, round(margin_px * width / PAPER_PX))
    large = cv2.resize(image, (width, height), interpolation=cv2.INTER_LINEAR)
    _write_case(root / "masks" / room.video_id / frame_name(still), _squared(image), still, known, _squared)
    _write_case(root / "cropped" / room.video_id / frame_name(still), large[shown], still, known, lambda mask: mask[shown])


def _squared(plane: np.ndarray) -> np.ndarray:
    """Pad a plane to a square with black above it, as the released code does."""
    height, width = plane.shape[:2]
    return np.pad(plane, ((width - height, 0), *((0, 0),) * (plane.ndim - 1)))


def _write_case(folder: Path, image: np.ndarray, still: Still, known: dict[str, Any],
                place: Callable[[np.ndarray], np.ndarray]) -> None:  # fmt: skip
    folder.mkdir(parents=True)
    _write_png(folder / "inpainting.png", image)
    first = still.modes[0]
    for k, name in enumerate((*(f"aff_{side}" for side in SIDES), *(f"obj_{side}" for side in SIDES))):
        if first.masks[k].any():
            _write_png(folder / f"{name}.png", place(first.masks[k]).astype(np.uint8) * 255)
    listed = [_write_mode(folder, number, mode, place) for number, mode in enumerate(still.modes)]
    write_json(folder / "annotation.json", _annotation(still, first) | {"scene": known["scene"], "groups": known["groups"]})
    write_json(folder / "modes.json", {"modes": listed} | known)


def _write_mode(folder: Path, number: int, mode: Mode, place: Callable[[np.ndarray], np.ndarray]) -> dict[str, Any]:
    names: dict[str, str | None] = {}
    for side, mask in zip(SIDES, mode.masks[:2], strict=True):
        names[side] = (f"mode{number}_{side}.png" if number else f"aff_{side}.png") if mask.any() else None
        if number and mask.any():
            _write_png(folder / f"mode{number}_{side}.png", place(mask).astype(np.uint8) * 255)
    return names | {"taxonomy": _one_hot(mode), "weight": round(mode.weight, 4), "grips": list(mode.grips)}


def _annotation(still: Still, mode: Mode) -> dict[str, Any]:
    narration = still.narration
    return {"taxonomy": _one_hot(mode), "obj_left": mode.objects[0] or None, "obj_right": mode.objects[1] or None,
            "narration": narration.text, "noun": narration.noun, "verb": narration.verb, "vector": None}


def _one_hot(mode: Mode) -> list[int]:
    return [int(k == mode.taxonomy) for k in range(4)]


def _write_png(path: Path, image: np.ndarray) -> None:
    path.write_bytes(encode_png(image, PNG).tobytes())
