"""Codecs: lossless storage of every schema, and content digests that depend on the value only."""

from __future__ import annotations

import ast
import dataclasses
import subprocess
import sys
import typing
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from blake3 import blake3
from hypothesis import given, settings
from hypothesis import strategies as st

from afford.codecs import CODEC, digest, load, load_folder, save
from afford.codecs.kinds import LazyTuple, kinds, schema_version
from runner.fingerprint import fingerprint
from runner.modules import Modules
from runner.store import Store, prepare_store
from schemas.files import FileRef, FileTree
from schemas.scene import RenderedClip
from schemas.spec import Bundle
from schemas.video import Annotation, Clip, Frames, KeyFrame, Polygon

ROOT = Path(__file__).resolve().parents[2]
SIZES = {"t": 3, "h": 6, "w": 8, "n": 2, "m": 4, "s": 5, "b": 7}


LIMITS = {("HandLessons", "labels"): 5}
"""(schema, field) -> exclusive upper limit of its values, where a schema checks one"""


def test_the_catalogue_lists_every_schema() -> None:
    """The catalogue contains each dataclass of `schemas/` that is a Schema, and is part of no key."""
    written = {node.name for path in (ROOT / "schemas").rglob("*.py") for node in ast.parse(path.read_text()).body
               if isinstance(node, ast.ClassDef) and any(ast.unparse(base) in ("Schema", "Bundle") for base in node.bases)}
    assert kinds().keys() == written - {"Bundle"}
    found = fingerprint(Modules(ROOT), "afford.codecs:CODEC", {}, excluded=("schemas",))
    assert not any(name.startswith("schemas.") for name in found.definitions)


def example(kind: type, seed: int) -> Any:
    """Build a value of any schema from its field declarations."""
    rng = np.random.default_rng(seed)
    hints = typing.get_type_hints(kind, vars(sys.modules[kind.__module__]) | {"np": np})
    fields = dataclasses.fields(kind)
    limit = {f.name: LIMITS.get((kind.__name__, f.name), 100) for f in fields}
    return kind(**{f.name: array(f.metadata, rng, limit[f.name]) if "shape" in f.metadata else plain(hints[f.name], seed)
                   for f in fields})  # fmt: skip


def array(meta: Any, rng: np.random.Generator, limit: int) -> np.ndarray:
    shape = [int(word) if word.isdigit() else SIZES.get(word, 2) for word in meta["shape"].split()]
    if meta["dtype"] == "bool":
        return rng.random(shape) < 0.5
    values = rng.integers(0, limit, shape).astype(meta["dtype"])
    if values.dtype.kind == "f" and values.size:
        values.flat[0] = np.nan
    return values


def plain(hint: Any, seed: int) -> Any:
    origin, parts = typing.get_origin(hint), typing.get_args(hint)
    if origin is tuple:
        inner = parts[:1] * 2 if parts[-1] is Ellipsis else parts
        return tuple(plain(part, seed + i) for i, part in enumerate(inner))
    if origin is typing.Literal:
        return parts[0]
    if dataclasses.is_dataclass(hint):
        return example(hint, seed)
    return {str: f"tëxt {seed}", int: seed, float: 0.1 + seed, bool: True}[hint]


PLAIN = sorted({name for name, kind in kinds().items() if not issubclass(kind, Bundle)} - {"FileRef", "FileTree"})


@pytest.mark.parametrize("name", PLAIN)
def test_round_trip_of_each_schema(name: str, tmp_path: Path) -> None:
    """Save and load keep the content digest; arrays are read-only, and another value has another digest."""
    value = example(kinds()[name], 1)
    save(value, tmp_path)
    again = load_folder(tmp_path)
    assert digest(again) == digest(value) != digest(example(kinds()[name], 2))
    for field in dataclasses.fields(value):
        found = getattr(again, field.name)
        if isinstance(found, np.ndarray):
            assert not found.flags.writeable
            np.testing.assert_array_equal(found, getattr(value, field.name))


@settings(max_examples=20, deadline=None)
@given(st.integers(0, 2**32 - 1), st.integers(1, 4), st.integers(1, 33), st.integers(1, 33))
def test_frames_are_lossless_at_any_size(seed: int, t: int, h: int, w: int) -> None:
    """Frames of noise, odd sizes and single pixels are restored exactly."""
    import tempfile

    rgb = np.random.default_rng(seed).integers(0, 256, (t, h, w, 3), np.uint8)
    frames = Frames("c", np.arange(t), np.arange(t, dtype=np.int64), rgb)
    with tempfile.TemporaryDirectory() as folder:
        save(frames, Path(folder))
        assert load_folder(Path(folder)).rgb.tobytes() == rgb.tobytes()


def test_empty_frame_stack_keeps_its_shape(tmp_path: Path) -> None:
    """An empty stack keeps its shape."""
    empty = Frames("c", np.zeros(0, np.int64), np.zeros(0, np.int64), np.zeros((0, 4, 6, 3), np.uint8))
    save(empty, tmp_path)
    assert load_folder(tmp_path).rgb.shape == (0, 4, 6, 3)


def tree(folder: Path, name: str = "v") -> FileTree:
    folder.mkdir(parents=True)
    (folder / "a.txt").write_text("hello")
    return FileTree(name, (FileRef("sub/a.txt", "d1", 5, folder / "a.txt"),))


def test_file_identity_is_name_and_digest(tmp_path: Path) -> None:
    """A tree at another path is the same tree; its files are linked, not copied."""
    one, two = tree(tmp_path / "one"), tree(tmp_path / "two")
    assert digest(one) == digest(two)
    (tmp_path / "out").mkdir()
    save(one, tmp_path / "out")
    assert (tmp_path / "out" / "files" / "sub" / "a.txt").is_symlink()
    again = load("FileTree", {p.relative_to(tmp_path / "out").as_posix(): p for p in (tmp_path / "out").rglob("*") if p.is_file()})
    assert again.files[0].path.read_text() == "hello" and digest(again) == digest(one)


def test_bundles_split_into_their_fields(tmp_path: Path) -> None:
    """A rendered clip splits into three artifacts and is rebuilt from them."""
    bundle = RenderedClip(*(tree(tmp_path / name, "P91_01") for name in ("files", "media", "truth")))
    parts = CODEC.children(bundle)
    assert parts is not None and [name for name, _ in parts] == ["files", "media", "truth"]
    assert CODEC.combine("RenderedClip", parts) == bundle
    assert CODEC.children((bundle,)) == [("P91_01", bundle)]


def test_a_file_in_two_parts_of_an_output_is_stored_once(tmp_path: Path) -> None:
    """The file is moved out of the scratch folder once, and found again for the second reference."""
    scratch = tmp_path / "scratch"
    part = tree(scratch, "P91_01")
    file = replace(part.files[0], digest=blake3(b"hello").hexdigest())
    part = replace(part, files=(file,))
    prepare_store(tmp_path / "store")
    store = Store(tmp_path / "store", CODEC)
    again = store.load(store.put(RenderedClip(part, part, replace(part, files=())), scratch))
    assert isinstance(again, RenderedClip) and again.files == again.media
    assert again.media.files[0].path.read_text() == "hello" and not file.path.exists()


def test_long_list_is_loaded_lazily(tmp_path: Path) -> None:
    """A lazy list keeps its length and order, can be iterated repeatedly, and is saved with the same digest."""
    value = example(kinds()["Samples"], 1)
    (tmp_path / "a").mkdir()
    save(value, tmp_path / "a")
    again = load_folder(tmp_path / "a")
    assert isinstance(again.samples, LazyTuple) and len(again.samples) == len(value.samples) == 2
    for _ in range(2):
        assert [digest(sample) for sample in again.samples] == [digest(sample) for sample in value.samples]
    assert digest(again.samples[-1]) == digest(again.samples[::-1][0]) == digest(value.samples[1])
    with pytest.raises(IndexError):
        again.samples[2]
    (tmp_path / "b").mkdir()
    save(again, tmp_path / "b")
    assert digest(load_folder(tmp_path / "b")) == digest(value)


def test_a_thousand_polygons_stay_a_few_files(tmp_path: Path) -> None:
    """Arrays are pooled: the number of files does not grow with the number of arrays."""
    polygons = tuple(Polygon(np.full((5, 2), i, np.float32)) for i in range(1000))
    key = KeyFrame(1, 1920, 1080, (Annotation("a", "mug", 13, "", "", "y", polygons),))
    clip = Clip("c", "c", "P", "", ("v.mp4",), "video", 30.0, False, 1, 2, (key,), (), ())
    save(clip, tmp_path)
    assert len(list(tmp_path.iterdir())) == 2
    assert digest(load_folder(tmp_path)) == digest(clip)


def test_digests_do_not_depend_on_the_process() -> None:
    """Another process with another hash seed gives the same digest and the same schema version."""
    code = "from tests.common.test_codecs import *; print(digest(example(Clip, 3)), schema_version('Clip'))"
    found = {
        subprocess.run([sys.executable, "-c", code], cwd=ROOT, capture_output=True, text=True, check=True,
                       env={"PYTHONHASHSEED": seed, "PATH": "", "PYTHONPATH": str(ROOT)}).stdout
        for seed in ("0", "1")
    }  # fmt: skip
    assert found == {f"{digest(example(Clip, 3))} {schema_version('Clip')}\n"}


def test_foreign_values_are_refused(tmp_path: Path) -> None:
    """A path, a list and a foreign object have no digest and are not saved."""
    for value in (tmp_path, [1], object()):
        with pytest.raises(TypeError):
            digest(value)
    with pytest.raises(TypeError):
        CODEC.kind([1])


def test_files_of_another_kind_are_refused(tmp_path: Path) -> None:
    """Files of one schema are not loaded as another."""
    save(example(Clip, 1), tmp_path)
    with pytest.raises(ValueError, match="expected a Frames, got Clip"):
        load("Frames", {path.name: path for path in tmp_path.iterdir()})
