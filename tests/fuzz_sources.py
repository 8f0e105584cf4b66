"""Readers of sources: a valid sample and the declared errors of each."""

from __future__ import annotations

import json
import zipfile
from collections.abc import Callable
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from pycocotools import mask as coco_mask

from afford.dataset.load import Dataset, rows
from afford.readers.discover import discover
from afford.readers.errors import SourceError
from afford.readers.folder import media_of
from afford.readers.strict_json import parse
from afford.video.decode import decode_video
from afford.video.probe import probe
from schemas.clip import Clip
from schemas.files import FileTree
from stages import clip_footage, dataset_pack, frame_decode, source_read
from tests import made_epic, tiny_root
from tests.bombs import Bomb
from tests.fuzzing import FuzzedReader
from tests.made_samples import Scratch, clip

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
    return parse(path.read_bytes(), path.name)


def _write_json(root: Path) -> Path:
    path = root / "a.json"
    path.write_text(json.dumps({"numbers": [1, 2.5, -3e8, 2**40], "words": ["a", "\u00fc", None, True], "deep": [[[[{}]]]]}))
    return path


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
    FuzzedReader("Parquet data set", _write_dataset, _read_dataset, (SourceError,)),
    FuzzedReader("Parquet without manifest", _write_shard, _read_dataset, (SourceError,)),
]
BOMBS: list[Bomb] = []
