"""Readers of models, of pictures and of static samples: a valid file and the declared errors of each."""

from __future__ import annotations

import io
import json
import struct
import zipfile
from collections.abc import Callable
from functools import partial
from pathlib import Path

import cv2
import numpy as np
import torch
from safetensors.torch import save_file

from afford.common.errors import SourceError
from afford.common.image_files import read_depth, read_image
from afford.extraction.hands import network as hand_network
from afford.extraction.hands.model import PLAIN, HandFinder, HandFinderConfig
from afford.grasping.candidates.read_scene import read_mask
from afford.models.importing.source import Source, open_source
from afford.models.tensor_files import read_tensors
from afford.rgbd.model import checkpoint
from afford.rgbd.model.layers import CONVOLUTIONS, Encoder
from afford.rgbd.readers import Umd, iit_aff, umd
from afford.rgbd.readers.static_set import PictureEntry
from schemas.interaction import StaticSample
from tests.helpers import made_interactions
from tests.helpers.bombs import Bomb
from tests.helpers.fuzzing import FuzzedReader
from tests.helpers.packed import black_png, zip_of, zlib_stream

WIDTHS = (2, 2, 3, 3)
ZEROS = 2_500_000_000


def tensors() -> dict[str, torch.Tensor]:
    """Tensors of several types."""
    return {"a.weight": torch.arange(12.0).view(3, 4), "a.bias": torch.zeros(3, dtype=torch.float16), "count": torch.tensor(7)}


def write_safetensors(folder: Path) -> Path:
    """Tensors as safetensors."""
    save_file(tensors(), folder / "model.safetensors")
    return folder / "model.safetensors"


def write_checkpoint(folder: Path) -> Path:
    """Tensors beside what a trainer keeps, as torch saves them."""
    torch.save({"state_dict": tensors(), "epoch": 3, "callbacks": {"best": [0.5, "x"]}}, folder / "model.pt")
    return folder / "model.pt"


def write_pickle(folder: Path) -> Path:
    """The pickle of a checkpoint alone; `zipped` puts it back."""
    path = write_checkpoint(folder)
    with zipfile.ZipFile(path) as archive:
        (folder / "data.pkl").write_bytes(archive.read("model/data.pkl"))
    path.rename(folder / "whole.zip")
    return folder / "data.pkl"


def read_pickle(path: Path) -> object:
    """The tensors of a checkpoint with this pickle."""
    out = path.with_name("model.pt")
    with zipfile.ZipFile(path.with_name("whole.zip")) as whole, zipfile.ZipFile(out, "w") as archive:
        for name in whole.namelist():
            archive.writestr(name, path.read_bytes() if name.endswith("data.pkl") else whole.read(name))
    return read_tensors(out)


def write_published(folder: Path, zipped: bool) -> Path:
    """Tensors by name as torch saves them, in the form of today or of before torch 1.6."""
    torch.save(tensors(), folder / "pytorch_model.bin", _use_new_zipfile_serialization=zipped)
    return folder / "pytorch_model.bin"


def write_index(folder: Path) -> Path:
    """The index of a checkpoint in shards."""
    write_published(folder, zipped=True)
    index = folder / "pytorch_model.bin.index.json"
    index.write_text(json.dumps({"metadata": {}, "weight_map": dict.fromkeys(tensors(), "pytorch_model.bin")}))
    return index


def open_one(path: Path) -> Source:
    """A checkpoint that is one file, or one folder."""
    return open_source([path])


def encoder() -> Encoder:
    """A small one."""
    return Encoder(3, WIDTHS, "none")


def write_vgg(folder: Path, zipped: bool) -> Path:
    """Weights under the names of a VGG16, in the small encoder's shapes."""
    befores = [3, *(width for width, count in zip(WIDTHS, CONVOLUTIONS, strict=True) for _ in range(count))]
    found = {}
    for number, before, after in zip(checkpoint.LAYERS, befores, befores[1:], strict=False):
        found |= {f"features.{number}.weight": torch.ones(after, before, 3, 3), f"features.{number}.bias": torch.ones(after)}
    torch.save(found, folder / "vgg16.pth", _use_new_zipfile_serialization=zipped)
    return folder / "vgg16.pth"


def write_config(folder: Path) -> Path:
    """A small trained finder of hands."""
    model = HandFinder(HandFinderConfig(16, 16, (2, 3)))
    described = {"format": hand_network.FORMATS[PLAIN], "height_px": 16, "width_px": 16, "widths": [2, 3]}
    (folder / hand_network.CONFIG).write_text(json.dumps(described))
    save_file({name: tensor.contiguous() for name, tensor in model.state_dict().items()}, folder / hand_network.WEIGHTS)
    return folder / hand_network.CONFIG


def write_umd(folder: Path, ending: str) -> Path:
    """A root of UMD with one tool; gives the first file of that ending."""
    made_interactions.umd(folder)
    for extra in folder.rglob("*00000002*"):
        extra.unlink()
    return sorted(folder.rglob(f"*{ending}"))[0]


def write_iit(folder: Path, where: str) -> Path:
    """A root of IIT-AFF; gives the file at `where`."""
    made_interactions.iit_aff(folder)
    return folder / where


def read_static(path: Path, listed: Callable[..., tuple[PictureEntry, ...]], own: Umd | None = None) -> list[StaticSample]:
    """Every picture of the root that a file is in; one that cannot be used is an error here."""
    root = next(parent for parent in path.parents if any((parent / name).is_dir() for name in ("tools", "affordances_labels")))
    return [one.read() for one in listed(made_interactions.folder(root), 16, 1, own)]


def write_picture(folder: Path, ending: str, *, deep: bool = False) -> Path:
    """A picture with edges; `deep`: of 16 bits, in millimetres."""
    rows, columns = np.mgrid[:24, :32]
    image = (600 + 5 * rows).astype(np.uint16) if deep else np.stack([rows * 9, columns * 7, rows], -1).astype(np.uint8)
    cv2.imwrite(str(folder / f"one{ending}"), image)
    return folder / f"one{ending}"


def write_depth(folder: Path) -> Path:
    """Depth in metres."""
    np.save(folder / "depth.npy", np.linspace(0.5, 1, 12, dtype=np.float32).reshape(3, 4))
    return folder / "depth.npy"


def weights(name: str, write: Callable[[Path], Path], read: Callable[[Path], object]) -> FuzzedReader:
    """A reader of weights, whose errors are ValueErrors with a sentence."""
    return FuzzedReader(name, write, read, (ValueError,))


def source(name: str, write: Callable[[Path], Path], read: Callable[[Path], object]) -> FuzzedReader:
    """A reader of a source."""
    return FuzzedReader(name, write, read, (SourceError,))


READERS: list[FuzzedReader] = [
    weights("safetensors", write_safetensors, read_tensors),
    weights("checkpoint zip", write_checkpoint, read_tensors),
    weights("checkpoint data.pkl", write_pickle, read_pickle),
    weights("published .bin", partial(write_published, zipped=True), open_one),
    weights("published .bin of old", partial(write_published, zipped=False), open_one),
    weights("published index", write_index, lambda path: open_one(path.parent)),
    weights("VGG .pth", partial(write_vgg, zipped=True), lambda path: checkpoint.load_vgg16(encoder(), path)),
    weights("VGG .pth of old", partial(write_vgg, zipped=False), lambda path: checkpoint.load_vgg16(encoder(), path)),
    weights("config of a finder", write_config, lambda path: hand_network.read_network(path.parent)),
    source("UMD splits", partial(write_umd, ending="split.txt"), partial(read_static, listed=umd.list_pictures, own=Umd())),
    source("UMD .mat", partial(write_umd, ending=".mat"), partial(read_static, listed=umd.list_pictures, own=Umd())),
    source("UMD depth", partial(write_umd, ending=".png"), partial(read_static, listed=umd.list_pictures, own=Umd())),
    source("UMD picture", partial(write_umd, ending=".jpg"), partial(read_static, listed=umd.list_pictures, own=Umd())),
    *(source(f"IIT-AFF {where}", partial(write_iit, where=where), partial(read_static, listed=iit_aff.list_pictures))
      for where in ("affordances_labels/a.txt", "depth/a.txt", "object_labels/a.txt", "val.txt")),
    *(source(f"picture to predict {ending}", partial(write_picture, ending=ending), read_image)
      for ending in (".png", ".jpg", ".webp", ".bmp", ".tiff")),
    source("depth .npy", write_depth, read_depth),
    source("depth PNG", partial(write_picture, ending=".png", deep=True), read_depth),
    source("mask PNG", partial(write_picture, ending=".png"), lambda path: read_mask(path, (24, 32))),
]  # fmt: skip


def large_checkpoint(folder: Path, stated: int = ZEROS) -> Path:
    """A checkpoint whose pickle is 2.5 GB of zeros in 2 MiB, and states so many bytes."""
    return zip_of(folder / "model.pt", "model/data.pkl", b"\x80\x02", ZEROS - 2, stated)


def many_opcodes(folder: Path) -> Path:
    """A pickle of 32 million empty mappings, stored as it is."""
    with zipfile.ZipFile(folder / "model.pt", "w") as archive:
        archive.writestr("model/data.pkl", b"\x80\x02" + b"}" * (1 << 25))
    return folder / "model.pt"


def nested(folder: Path) -> Path:
    """A pickle of a million mappings, each in the one before."""
    with zipfile.ZipFile(folder / "model.pt", "w") as archive:
        archive.writestr("model/data.pkl", b"\x80\x02" + b"}X\x01\x00\x00\x00a" * 1_000_000 + b"Ns" + b"s" * 999_999 + b".")
    return folder / "model.pt"


def npy_header(shape: tuple[int, ...]) -> bytes:
    """The header of an .npy, without an array behind it."""
    out = io.BytesIO()
    np.lib.format.write_array_header_1_0(out, {"descr": "<f8", "fortran_order": False, "shape": shape})
    return out.getvalue()


def large_label(folder: Path, stated: int) -> Path:
    """A root of UMD whose label unpacks to 2.5 GB of zeros; its tag states so many bytes."""
    path = write_umd(folder, ".mat")
    body = zlib_stream(struct.pack("<II", 14, stated), ZEROS)
    path.write_bytes(path.read_bytes()[:128] + struct.pack("<II", 15, len(body)) + body)
    return path


def written(name: str, content: Callable[[], bytes]) -> Callable[[Path], Path]:
    """Return a function that writes one file."""

    def write(folder: Path) -> Path:
        (folder / name).write_bytes(content())
        return folder / name

    return write


BOMBS: list[Bomb] = [
    Bomb("checkpoint whose pickle is 2.5 GB in 2 MiB", large_checkpoint, read_tensors, (ValueError,)),
    Bomb("checkpoint whose pickle is larger than stated", partial(large_checkpoint, stated=1000), read_tensors, (ValueError,)),
    Bomb("checkpoint of 32 million opcodes", many_opcodes, read_tensors, (ValueError,)),
    Bomb("checkpoint nested a million times", nested, read_tensors, (ValueError,)),
    Bomb("published checkpoint of 2.5 GB in 2 MiB", large_checkpoint, open_one, (ValueError,)),
    Bomb("VGG of 2.5 GB in 2 MiB", large_checkpoint, lambda path: checkpoint.load_vgg16(encoder(), path), (ValueError,)),
    Bomb("safetensors that state 2^60 bytes", written("model.safetensors", lambda: struct.pack("<Q", 1 << 60)), read_tensors,
         (ValueError,)),
    Bomb("npy that states 10^6 x 10^6", written("depth.npy", lambda: npy_header((10**6, 10**6))), read_depth, (SourceError,)),
    Bomb("depth of 30000 x 30000 of 16 bits", written("depth.png", lambda: black_png(30_000, 30_000, 16)), read_depth,
         (SourceError,)),
    Bomb("picture of 30000 x 30000", written("one.png", lambda: black_png(30_000, 30_000)), read_image, (SourceError,)),
    *(Bomb(f"UMD label of 2.5 GB that states {stated} bytes", partial(large_label, stated=stated),
           partial(read_static, listed=umd.list_pictures, own=Umd()), (SourceError,)) for stated in (ZEROS, 1000)),
]  # fmt: skip
