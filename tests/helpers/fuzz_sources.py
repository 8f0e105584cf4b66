"""Readers of sources: a valid sample and the declared errors of each."""

from __future__ import annotations

import json
import struct
import zipfile
import zlib
from collections.abc import Callable
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
from pycocotools import mask as coco_mask

from afford.common.errors import SourceError
from afford.common.folders import media_of
from afford.common.text import parse_json
from afford.common.video.frames import decode_video
from afford.common.video.probe import probe
from afford.dataset.load import Dataset, rows
from afford.extraction.sources.discover import discover
from afford.recording.check_content import check_content
from afford.recording.check_file import check_file
from afford.recording.summary import summarise
from schemas.files import FileTree
from schemas.video import Clip
from stages.extraction import clip_footage, dataset_pack, frame_decode, source_read
from stages.recording import stage_record
from tests.helpers import made_epic, tiny_root
from tests.helpers.bombs import Bomb
from tests.helpers.fuzzing import FuzzedReader
from tests.helpers.made_recordings import Ctx, outputs
from tests.helpers.made_samples import Scratch, clip

VIDEO = "P95_01"


def _tree(root: Path) -> FileTree:
    """The files of the only video of a source; nothing is hashed."""
    found = discover(root, lambda path: "")
    return found.videos[0]


def _clips(root: Path) -> tuple[Clip, ...]:
    return source_read.run(_tree(root), source_read.Params())


def _frames(root: Path) -> Any:
    files = _tree(root)
    footage = clip_footage.run(source_read.run(files, source_read.Params())[0], clip_footage.Params())
    return frame_decode.run(media_of(files), footage, frame_decode.Params())


# -- samples -----------------------------------------------------------------------------------------------------------


def _write_visor(root: Path) -> Path:
    tiny_root.write_root(root, VIDEO)
    glove = tiny_root.mask("glove", "g", on_which_hand=["left hand"], in_contact_object="m46")
    tiny_root.write_points(root, VIDEO, [tiny_root.image(VIDEO, 1), tiny_root.image(VIDEO, 16), tiny_root.image(VIDEO, 31),
                                         tiny_root.image(VIDEO, 40, [glove, tiny_root.mask("mug", "m46", (tiny_root.OTHER,))])])
    return root / "GroundTruth-SparseAnnotations" / "annotations" / "train" / f"{VIDEO}.json"


def _write_dense(root: Path) -> Path:
    _write_visor(root)
    packed = root / "Interpolations-DenseAnnotations" / "train" / f"{VIDEO}_interpolations.zip"
    packed.parent.mkdir(parents=True)
    with zipfile.ZipFile(packed, "w", zipfile.ZIP_DEFLATED) as archive:
        points = [tiny_root.image(VIDEO, 8, [tiny_root.mask("mug", "m8", ([[300, 200], [400, 200], [400, 300]],))])]
        archive.writestr(f"{VIDEO}_interpolations.json", json.dumps({"video_annotations": points}))
    return packed


def _coco() -> dict[str, Any]:
    images = [{"id": i, "file_name": f"frame_{15 * i - 14:06d}.png", "width": tiny_root.WIDTH, "height": tiny_root.HEIGHT}
              for i in (1, 2)]  # fmt: skip
    rle = {"size": [tiny_root.HEIGHT, tiny_root.WIDTH], "counts": [640, 32, tiny_root.HEIGHT * tiny_root.WIDTH - 672]}
    disc = np.asfortranarray(cv2.circle(np.zeros((tiny_root.HEIGHT, tiny_root.WIDTH), np.uint8), (60, 30), 14, 1, -1))
    code = {"size": [tiny_root.HEIGHT, tiny_root.WIDTH], "counts": coco_mask.encode(disc)["counts"].decode()}
    hands = [{"id": 10 * i, "image_id": i, "category_id": 1, "in_contact_object": "mug",
              "segmentation": [[5.5, 5, 25, 5, 25, 25, 5, 25]]} for i in (1, 2)]  # fmt: skip
    things = [{"id": 11, "image_id": 1, "category_id": 2, "segmentation": rle},
              {"id": 21, "image_id": 2, "category_id": 2, "segmentation": code}]  # fmt: skip
    names = [{"id": 1, "name": "left_hand"}, {"id": 2, "name": "mug"}]
    return {"images": images, "annotations": hands + things, "categories": names}


def _write_own(root: Path) -> Path:
    tiny_root.write_video(root / "mine.mp4", 30)
    (root / "words.csv").write_text("start,stop,narration,verb,noun\n0,0:00:00.5,pick up the red mug,,\n0.5,1.0,pour,pour,tea\n")
    path = root / "masks.json"
    path.write_text(json.dumps(_coco()))
    return path


def _write_words(root: Path) -> Path:
    _write_own(root)
    return root / "words.csv"


def _of_root(name: str) -> Callable[[Path], Path]:
    def write(root: Path) -> Path:
        tiny_root.write_root(root, VIDEO)
        (root / "EPIC_100_video_info.csv").write_text(f"video_id,duration,fps,resolution\n{VIDEO},1.3333,30.0,128x64\n")
        (root / "corrections.json").write_text(json.dumps({f"{VIDEO}_frame_0000000001.jpg": {"left hand": "m1"}}))
        return root / name

    return write


def _write_mapping(root: Path) -> Path:
    made_epic.write_tables(root)
    made_epic.write_tar(root)
    return root / "frame_mapping.json"


def _write_tar(root: Path) -> Path:
    made_epic.write_tables(root)
    return made_epic.write_tar(root)


def _write_zip(root: Path) -> Path:
    made_epic.write_tables(root)
    return made_epic.write_zip(root)


def _write_picture(root: Path) -> Path:
    folder = root / "frames"
    folder.mkdir(parents=True)
    for number in (1, 2, 3):
        cv2.imwrite(str(folder / f"frame_{number:06d}.png"), tiny_root.picture(number))
    return folder / "frame_000002.png"


def _write_video(root: Path) -> Path:
    return tiny_root.write_video(root / "a.mp4", 30)


def _write_dataset(root: Path) -> Path:
    dataset_pack.run((clip(VIDEO, 12, split="train", height=32, width=48),), dataset_pack.Params(sheet_samples=1), Scratch(root))
    return next((root / "dataset" / "data").glob("*.parquet"))


def _write_shard(root: Path) -> Path:
    """A data set without its manifest, so that Arrow alone notices what is wrong."""
    path = _write_dataset(root)
    (root / "dataset" / "manifest.json").unlink()
    return path


def _read_dataset(path: Path) -> object:
    samples = list(Dataset(path.parents[1]))
    list(rows(path.parents[1], "train", ("sample_id", "motion", "mask_left")))
    return samples


def _json(path: Path) -> object:
    return parse_json(path.read_bytes(), path.name)


def _write_json(root: Path) -> Path:
    path = root / "a.json"
    path.write_text(json.dumps({"numbers": [1, 2.5, -3e8, 2**40], "words": ["a", "\u00fc", None, True], "deep": [[[[{}]]]]}))
    return path


def _write_recording(root: Path) -> Path:
    (root / "scratch").mkdir()
    value, ctx = outputs(0)["narration_labelling"], Ctx(root / "scratch")
    stage_record.run(value, outputs(0)["frame_decode"], stage_record.Params("narration_labelling"), ctx)  # type: ignore[arg-type]
    return next((root / "scratch").rglob("*.mcap"))


def _inspected(path: Path) -> object:
    """Run `inspect --strict` on a file and return its problems."""
    found = summarise(path)
    problems = ([found.problem] if found.problem else []) + (check_file(path) or check_content(path))
    if problems:
        raise ValueError(problems[0])
    return found


READERS: list[FuzzedReader] = [
    FuzzedReader("VISOR", _write_visor, lambda path: _clips(path.parents[3]), (SourceError,)),
    FuzzedReader("VISOR interpolations, zip", _write_dense, lambda path: _clips(path.parents[2]), (SourceError,)),
    FuzzedReader("COCO", _write_own, lambda path: _clips(path.parent), (SourceError,)),
    FuzzedReader("own narrations, CSV", _write_words, lambda path: _clips(path.parent), (SourceError,)),
    FuzzedReader("EPIC narrations, CSV", _of_root("EPIC_100_train.csv"), lambda path: _clips(path.parent), (SourceError,)),
    FuzzedReader("EPIC classes, CSV", _of_root("EPIC_100_noun_classes_v2.csv"), lambda path: _clips(path.parent), (SourceError,)),
    FuzzedReader("EPIC video info, CSV", _of_root("EPIC_100_video_info.csv"), lambda path: _clips(path.parent), (SourceError,)),
    FuzzedReader("corrections, JSON", _of_root("corrections.json"), lambda path: _clips(path.parent), (SourceError,)),
    FuzzedReader("frame mapping, JSON", _write_mapping, lambda path: _clips(path.parent), (SourceError,)),
    FuzzedReader("strict JSON", _write_json, _json, (SourceError,)),
    FuzzedReader("tar of frames", _write_tar, lambda path: _frames(path.parents[2]), (SourceError,)),
    FuzzedReader("zip of frames", _write_zip, lambda path: _frames(path.parents[4]), (SourceError,)),
    FuzzedReader("frame picture", _write_picture, lambda path: _frames(path.parents[1]), (SourceError,)),
    FuzzedReader("video probe", _write_video, probe, (SourceError,)),
    FuzzedReader("video decode", _write_video, lambda path: decode_video(path, 1, 30, None, (456, 256)), (SourceError,)),
    FuzzedReader("recording, summary", _write_recording, summarise, ()),
    FuzzedReader("recording, strict", _write_recording, _inspected, (ValueError,)),
    FuzzedReader("Parquet data set", _write_dataset, _read_dataset, (SourceError,)),
    FuzzedReader("Parquet without manifest", _write_shard, _read_dataset, (SourceError,)),
]


# -- bombs -------------------------------------------------------------------------------------------------------------


def _deep(root: Path) -> Path:
    path = root / "a.json"
    path.write_text("[" * 200_000)
    return path


def _masks(size_px: int, annotations: int, segmentation: Any) -> Callable[[Path], Path]:
    """User video whose only image declares a size, with masks."""
    def write(root: Path) -> Path:
        path = _write_own(root)
        image = {"id": 1, "file_name": "frame_000001.png", "width": size_px, "height": size_px}
        rows = [{"id": n, "image_id": 1, "category_id": 1, "segmentation": segmentation} for n in range(annotations)]
        path.write_text(json.dumps({"images": [image], "annotations": rows, "categories": [{"id": 1, "name": "left hand"}]}))
        return path

    return write


def _square(size_px: int) -> list[list[int]]:
    return [[0, 0, size_px, 0, size_px, size_px, 0, size_px]]


def _isolated(root: Path) -> Path:
    """Key frames far apart, one to a clip, a narration and a remark about each."""
    count, held = 20_000, [tiny_root.mask("left hand", "h", ([[-20, 1], [90, 5], [90, 90]],))]
    path = _write_visor(root)
    (root / "videos" / f"{VIDEO}.MP4").unlink()
    frames = [1 + 100 * n for n in range(count)]
    tiny_root.write_points(root, VIDEO, [tiny_root.image(VIDEO, frame, held) for frame in frames])
    folder = root / "rgb_frames"
    folder.mkdir()
    with zipfile.ZipFile(folder / f"{VIDEO}.zip", "w") as archive:
        for frame in frames:
            archive.writestr(f"{VIDEO}_frame_{frame:010d}.jpg", "x")
    tiny_root.write_rows(root / "EPIC_100_train.csv", [tiny_root.row(VIDEO, n, start_frame=n, stop_frame=n) for n in range(2000)])
    return path


def _stated_zip(root: Path) -> Path:
    """The second frame states 2.5 GB."""
    return _patched(_write_zip(root), 2_500_000_000)


def _lying_zip(root: Path) -> Path:
    """The second frame states 1,000 bytes and unpacks to 600 MB."""
    path = _write_zip(root)
    with zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED, compresslevel=1) as archive:
        for key in (1, 16, 31):
            with archive.open(f"{made_epic.VIDEO}_frame_{key:010d}.jpg", "w") as stream:
                for _ in range(600 if key == 16 else 1):
                    stream.write(bytes(1_000_000) if key == 16 else made_epic.jpeg())
    return _patched(path, 1000)


def _patched(path: Path, size: int) -> Path:
    """Write another uncompressed size into the headers of the second file of a zip."""
    data = bytearray(path.read_bytes())
    for mark, offset in ((b"PK\x01\x02", 24), (b"PK\x03\x04", 22)):
        at = data.index(mark, data.index(mark) + 1)
        data[at + offset : at + offset + 4] = size.to_bytes(4, "little")
    path.write_bytes(bytes(data))
    return path


def _stated_json(root: Path) -> Path:
    """Interpolated masks whose JSON states 2.5 GB."""
    path = _write_dense(root)
    with zipfile.ZipFile(path, "a", zipfile.ZIP_DEFLATED) as archive:
        archive.writestr("readme.txt", "")
    data = bytearray(path.read_bytes())
    at = data.index(b"PK\x01\x02") + 24
    data[at : at + 4] = (2_500_000_000).to_bytes(4, "little")
    path.write_bytes(bytes(data))
    return path


def _png(width_px: int, height_px: int, kind: bytes) -> bytes:
    """A PNG that states a size and holds next to nothing."""
    def chunk(name: bytes, data: bytes) -> bytes:
        return struct.pack(">I", len(data)) + name + data + struct.pack(">I", zlib.crc32(name + data))

    head = struct.pack(">II", width_px, height_px) + kind
    return b"\x89PNG\r\n\x1a\n" + chunk(b"IHDR", head) + chunk(b"IDAT", zlib.compress(bytes(10**6))) + chunk(b"IEND", b"")


def _large_picture(root: Path) -> Path:
    path = _write_picture(root)
    path.write_bytes(_png(32_000, 32_000, bytes((8, 2, 0, 0, 0))))
    return path


def _rewritten(path: Path, column: str, value: pa.Array) -> Path:
    """A shard of one row, without a manifest, with one column replaced."""
    table = pq.read_table(path).slice(0, 1)
    at = table.schema.get_field_index(column)
    pq.write_table(table.set_column(at, table.schema.field(at), value), path, compression="zstd", use_dictionary=False,
                   write_statistics=False)  # fmt: skip
    return path


def _large_mask(root: Path) -> Path:
    path = _write_shard(root)
    mask = {"bytes": _png(60_000, 60_000, bytes((1, 0, 0, 0, 0))), "path": "a.png"}
    return _rewritten(path, "mask_left", pa.array([mask], pq.read_schema(path).field("mask_left").type))


def _large_group(root: Path) -> Path:
    """A shard of some kilobytes whose row group states 3 GB."""
    path = _write_shard(root)
    data, stated = path.read_bytes(), pq.ParquetFile(path).metadata.row_group(0).total_byte_size
    length = int.from_bytes(data[-8:-4], "little")
    pages, footer = data[: -8 - length], data[-8 - length : -8]
    head, tail = footer.rsplit(_thrift(stated), 1)
    footer = head + _thrift(3_000_000_000) + tail
    path.write_bytes(pages + footer + len(footer).to_bytes(4, "little") + b"PAR1")
    return path


def _thrift(number: int) -> bytes:
    """A whole number as the footers of Parquet have it: zigzag, 7 bits a byte."""
    left, out = number << 1, bytearray()
    while left > 127:
        out.append(left & 127 | 128)
        left >>= 7
    return bytes([*out, left])


def _endless(root: Path) -> Path:
    path = _write_words(root)
    path.write_text("start,stop,narration\n0,1e999,pick up the mug\n")
    return path


def _of(levels: int) -> Callable[[Path], object]:
    return lambda path: _clips(path.parents[levels])


ZIGZAG = [[16_000 if n // 2 % 2 else -16_000 for n in range(100_000)]]
"""corners of a polygon of a few hundred kilobytes that is 1,600 million px long"""
REFUSED = (SourceError,)
BOMBS: list[Bomb] = [
    Bomb("JSON, 200,000 brackets", _deep, _json, REFUSED),
    Bomb("COCO, 16384 x 16384", _masks(16_384, 200, _square(16_384)), _of(0), REFUSED),
    Bomb("COCO, 2,000 masks of 8000 x 8000", _masks(8_000, 2_000, _square(8_000)), _of(0), REFUSED),
    Bomb("COCO, zigzag", _masks(8_000, 1, ZIGZAG), _of(0), REFUSED),
    Bomb("COCO, counts without end", _masks(64, 1, {"size": [64, 64], "counts": "o" * 2_000_000}), _of(0), REFUSED),
    Bomb("COCO, 5,000 small masks of 8000 x 8000", _masks(8_000, 5_000, [[9, 9, 40, 9, 40, 40]]), _of(0), ()),
    Bomb("VISOR, 20,000 clips", _isolated, _of(3), ()),
    Bomb("zip, a frame of 2.5 GB", _stated_zip, lambda path: _frames(path.parents[4]), REFUSED),
    Bomb("zip, a frame that unpacks to more than it states", _lying_zip, lambda path: _frames(path.parents[4]), REFUSED),
    Bomb("zip, JSON of 2.5 GB", _stated_json, _of(2), REFUSED),
    Bomb("frame, PNG of 32000 x 32000", _large_picture, lambda path: _frames(path.parents[1]), REFUSED),
    Bomb("data set, mask of 60000 x 60000", _large_mask, _read_dataset, REFUSED),
    Bomb("data set, row group of 3 GB", _large_group, _read_dataset, REFUSED),
    Bomb("narration until 1e999 s", _endless, _of(0), REFUSED),
]
