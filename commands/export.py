"""The verb `export`: write the last data set, or the rendered clips, in a format that other tools read."""

from __future__ import annotations

import shutil
import sys
from pathlib import Path
from typing import TYPE_CHECKING, Any

from afford.common.errors import SourceError
from afford.common.registry import load
from commands.errors import UsageError, unknown
from commands.origin import origin
from commands.outputs import PART
from commands.session import open_runner
from commands.settings import settings
from commands.targets import build
from runner import LostError, Runner, StoreError

if TYPE_CHECKING:
    from schemas.video import Frames

FORMATS = {
    "2hands": "afford.dataset.export_2hands:export",
    "coco": "afford.dataset.exports:export_coco",
    "webdataset": "afford.dataset.exports:export_webdataset",
    "epic": "afford.synthetic.kitchens.epic_files:write_root",
}
WITH_ORIGINALS = ("coco", "webdataset")
ORIGINAL_QUALITY = 95
"""JPEG quality of original frames, 0..100"""


class OriginalFrames:
    """Frames with hands behind the samples of a data set, read from the store one clip at a time."""

    def __init__(self, runner: Runner) -> None:
        self._runner = runner
        self._traces = sorted((trace for trace in runner.traces.all() if "frames" in trace.inputs),
                              key=lambda trace: trace.finished, reverse=True)  # fmt: skip
        self._provenance = ""
        self._frames: Frames | None = None

    def jpeg(self, provenance: str, frame: int) -> bytes:
        """Encode one frame of the clip whose Samples have this digest; StoreError when the store lacks it."""
        from afford.common.image_files import encode_jpeg

        if self._provenance != provenance or self._frames is None:
            self._frames = None  # two clips are never in memory together
            self._frames, self._provenance = self._load(provenance), provenance
        index = self._frames.frame.tolist().index(frame) if frame in self._frames.frame else -1
        if index < 0:
            raise _missing(provenance, f"frame {frame} is not among the frames of the clip")
        return encode_jpeg(self._frames.rgb[index], ORIGINAL_QUALITY).tobytes()

    def _load(self, provenance: str) -> Frames:
        why = "no record of the stage that computed the samples from frames"
        for trace in self._traces:
            if trace.output == provenance:
                try:
                    return self._runner.load(trace.inputs["frames"])
                except LostError as error:
                    why = str(error)
        raise _missing(provenance, why)


def _missing(provenance: str, why: str) -> StoreError:
    return StoreError(f"the original frames of samples {provenance[:12]} are not in the store ({why}); run the data set again with "
                      "--force frame_decode, or export without --original-frames")


def export(format: str, folder: Path, source: Path | None, store: Path | None, polygons: bool = False,
           original_frames: bool = False) -> int:  # fmt: skip
    """Write into a new or empty folder; a failed export of a data set leaves it empty.

    `epic` writes the rendered clips with their ground truth; the other formats write the last data set. `polygons`: masks as
    polygons (coco only). `original_frames`: also write the frames with hands (coco and webdataset only).
    """
    if format not in FORMATS:
        raise unknown("format", format, FORMATS)
    if polygons and format != "coco":
        raise UsageError(f"--polygons: only for the format coco, not for {format}")
    if original_frames and format not in WITH_ORIGINALS:
        raise UsageError(f"--original-frames: only for the formats {' and '.join(WITH_ORIGINALS)}, not for {format}")
    if folder.exists() and (not folder.is_dir() or any(folder.iterdir())):
        raise UsageError(f"{folder}: the folder is not empty; give a new or empty one")
    runner = open_runner(store)
    with runner.reading():
        return _export(runner, format, folder, source, polygons, original_frames)


def _export(runner: Runner, format: str, folder: Path, source: Path | None, polygons: bool, original_frames: bool) -> int:
    if format == "epic":
        place, _ = origin("scenes", source, settings((), None), lambda path: runner.hash_file(path)[0])
        report = runner.run(build("scenes", place, settings((), None)), "scenes")
        clips = [runner.load(digest) for _, digest in next(iter(report.outputs.values()))]
        load(FORMATS, format)([tree for clip in clips for tree in (clip.files, clip.truth)], folder)
        for clip in clips:
            sys.stdout.write(f"{folder}: {clip.files.name}\n")
        return 0 if report.ok else 1
    name = source.resolve().name if source else "synthetic"
    dataset = runner.store.root / "datasets" / name
    if not dataset.is_dir():
        part = dataset.with_name(f"{name}{PART}")
        hint = f"; {part} is partial, `run dataset --replace` publishes it as {name}" if part.is_dir() else ""
        make = f"make dataset{f' SOURCE={source}' if source else ''}"
        raise UsageError(f"{dataset}: no data set there; run `{make}` first{hint}")
    options: dict[str, Any] = {"polygons": True} if polygons else {}
    if original_frames:
        options["original_frame"] = OriginalFrames(runner).jpeg
    folder.mkdir(parents=True, exist_ok=True)
    try:
        files = load(FORMATS, format)(dataset, folder, **options)
    except BaseException as error:
        for path in folder.iterdir():
            shutil.rmtree(path) if path.is_dir() else path.unlink()
        if isinstance(error, SourceError):
            sys.stderr.write(f"error: {error}\n")
            return 1
        raise
    sys.stdout.write(f"{len(files)} files in {folder}\n")
    return 0
