"""Published files of EPIC-KITCHENS and VISOR: names, addresses, and their state in a source folder (there, partial, missing)."""

from __future__ import annotations

import os
import zipfile
from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

from afford.common.folders import Entry, entries
from afford.extraction.sources.discover import NO_PICTURES

BRIS = "https://data.bris.ac.uk/datasets"
VISOR, EPIC_100, EPIC_55 = (f"{BRIS}/{key}" for key in (
    "2v6cgv1x04ol22qp9rm9x2j6a7", "2g1n6qdydwa9u22shpxqzp0t8m", "3h91syskeag572hl6tvuovwv4d"))  # fmt: skip
TABLES = "https://raw.githubusercontent.com/epic-kitchens/epic-kitchens-100-annotations/master"
TABLE_NAMES = ("EPIC_100_train.csv", "EPIC_100_validation.csv", "EPIC_100_verb_classes.csv", "EPIC_100_noun_classes_v2.csv",
               "EPIC_100_video_info.csv")  # fmt: skip
LICENCE = "CC BY-NC 4.0"
ERRATA = {"P01/rgb_frames/P01_109.tar": "https://www.dropbox.com/s/mh7y0goc5x945nu/P01_109.tar?dl=1",
          "P27/rgb_frames/P27_103.tar": "https://www.dropbox.com/s/c1eo70v6dokr6cf/P27_103.tar?dl=1"}  # fmt: skip
KINDS = ("tables", "sparse", "dense", "key-frames", "frames", "videos")
"""tables: narrations, classes and frame mapping; sparse: VISOR's masks of key frames; dense: its interpolated masks; key-frames:
its key frames as images; frames: all frames of EPIC-KITCHENS as images, 456 x 256; videos: its videos"""
TRAIN = (
    "P01 01 03 05 07 09 103 104 14, P02 01 03 07 101 102 107 109 121 122 124 128 130 132 135, "
    "P03 03 04 05 101 11 112 113 123 13 17 23 24, P04 02 03 04 05 101 109 11 110 114 12 121 21 25 26 33, P05 01 08, "
    "P06 01 07 09 101 102 103 107 11 110 12 13 14, P07 08, P08 09 16 21, P10 04, P11 101 102 103 104 105 107 16, "
    "P12 02 03 101, P13 10, P14 05, P15 02, P17 01, P18 03 06 07, P20 03, P22 01 07 117, P23 02 05, P24 05 08, P25 107, "
    "P26 110, P27 101, P28 06 101 103 109 110 112 113 13 14, P30 05 101 107 111 112, P32 01, P35 105 109, P37 101 103")
VAL = (
    "P01 107, P02 02 09 12, P03 10 120 14 22, P04 06 13 24, P06 03 05 10 106 108, P07 101 103 110, P08 17, "
    "P09 02 07 103 104 106, P12 04, P18 01 02, P21 01, P22 107, P24 09, P25 09 101, P26 01 02 108, P27 105, P28 05, "
    "P29 04, P30 07 110, P32 07, P37 102")
IN_55_TEST = (
    "P01 14, P02 12, P03 22 23 24, P04 24 25 26 33, P06 10 11 12 13 14, P08 09 16 17, P09 02 07, P11 16, P12 03, "
    "P18 01 02 03 06 07, P22 01, P23 05, P24 09, P30 07, P32 01 07")
"""annotated videos in the test folders of EPIC-KITCHENS-55"""


def _ids(people: str) -> tuple[str, ...]:
    """Expand 'P01 01 03, P02 01' to P01_01, P01_03, P02_01."""
    rows = [row.split() for row in people.split(", ")]
    return tuple(f"{person}_{number}" for person, *numbers in rows for number in numbers)


SPLITS = {"train": _ids(TRAIN), "val": _ids(VAL)}
"""the videos that VISOR annotates"""
TEST_55 = frozenset(_ids(IN_55_TEST))


@dataclass(frozen=True)
class Published:
    """A published file."""

    name: str
    """path below the source folder"""
    url: str
    kind: str
    video: str
    """'' for a file that all videos share"""


def published_files(videos: Iterable[str], kinds: Iterable[str]) -> Iterator[Published]:
    """List the files of these kinds for these videos of `SPLITS`, shared files first."""
    wanted = [kind for kind in KINDS if kind in set(kinds)]
    if "tables" in wanted:
        yield from (Published(name, f"{TABLES}/{name}", "tables", "") for name in TABLE_NAMES)
        yield Published("frame_mapping.json", f"{VISOR}/frame_mapping.json", "tables", "")
    for video in videos:
        for kind in wanted:
            if kind != "tables":
                name, url = _place(video, kind)
                yield Published(name, url, kind, video)


def _place(video: str, kind: str) -> tuple[str, str]:
    """Path below the source folder, and address, of a file of one video."""
    split, person = next(split for split, videos in SPLITS.items() if video in videos), video[:3]
    if kind in ("frames", "videos"):
        return _epic_file(video, kind)
    name = {"sparse": f"GroundTruth-SparseAnnotations/annotations/{split}/{video}.json",
            "key-frames": f"GroundTruth-SparseAnnotations/rgb_frames/{split}/{person}/{video}.zip",
            "dense": f"Interpolations-DenseAnnotations/{split}/{video}_interpolations.zip"}[kind]
    return name, f"{VISOR}/{name}"


def _epic_file(video: str, kind: str) -> tuple[str, str]:
    person, folder = video[:3], "test" if video in TEST_55 else "train"
    name = f"{person}/rgb_frames/{video}.tar" if kind == "frames" else f"{person}/videos/{video}.MP4"
    if len(video) == len("PXX_1YY"):
        return name, ERRATA.get(name, f"{EPIC_100}/{name}")
    above = "frames_rgb_flow/rgb" if kind == "frames" else "videos"
    return name, f"{EPIC_55}/{above}/{folder}/{person}/{name.rpartition('/')[2]}"


State = Literal["there", "partial", "missing"]
UNFINISHED = (".aria2", ".part", ".partial", ".crdownload")
"""suffixes of the files that downloaders keep next to, or instead of, an incomplete file"""


def file_states(root: Path, wanted: Iterable[Published]) -> Iterator[tuple[Published, State]]:
    """Yield each file with its state, found anywhere below `root`, frames also unpacked. Only the ends of files are read."""
    found: dict[str, list[Entry]] = {}
    for entry in entries(root) if root.is_dir() else ():
        if not entry.odd and not set(NO_PICTURES) & set(entry.name.split("/")[:-1]):
            found.setdefault(entry.name.rpartition("/")[2].lower(), []).append(entry)
            found.setdefault(entry.folder.lower(), [])
    for file in wanted:
        base = file.name.rpartition("/")[2].lower()
        unpacked = file.kind in ("frames", "key-frames") and file.video.lower() in found
        yield file, "there" if unpacked else _state(found.get(base, []))


def _state(places: list[Entry]) -> State:
    if not places:
        return "missing"
    return "there" if any(_is_complete(entry.path) for entry in places) else "partial"


def _is_complete(path: Path) -> bool:
    """Test for a complete file by its end."""
    size = os.stat(path).st_size
    if size == 0 or any(path.with_name(path.name + suffix).exists() for suffix in UNFINISHED):
        return False
    suffix = path.suffix.lower()
    if suffix == ".zip":
        return zipfile.is_zipfile(path)
    if suffix == ".mp4":
        return _boxes_end(path) == size
    tail = _tail(path, size)
    if suffix == ".tar":
        return size % 512 == 0 and not any(tail)
    return tail.rstrip()[-1:] in (b"}", b"]") if suffix == ".json" else True


def _tail(path: Path, size: int) -> bytes:
    with path.open("rb") as stream:
        stream.seek(max(size - 1024, 0))
        return stream.read()


def _boxes_end(path: Path) -> int:
    """Compute the end of an MP4 file from its outermost boxes (ISO 14496-12)."""
    at, size = 0, os.stat(path).st_size
    with path.open("rb") as stream:
        while at < size:
            stream.seek(at)
            head = stream.read(16)
            length = int.from_bytes(head[:4], "big")
            if length == 1:
                length = int.from_bytes(head[8:16], "big")
            if length == 0:
                return size  # to the end of the file, whatever that is
            if length < 8:
                return -1
            at += length
    return at
