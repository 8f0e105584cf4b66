"""Samples that are read from their files on demand are those of the data set, to the byte, and in bounded memory."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.ipc as ipc
import pyarrow.parquet as pq
import pytest
from blake3 import blake3

from afford.common.errors import SourceError
from afford.dataset import export_2hands
from afford.dataset.load import Dataset, Item
from afford.training.sampler import BalancedSampler
from afford.twohands.train.augment import Augmentation
from afford.twohands.train.sample_stream import LABELS, SHARDS, Bounded, SampleStream, label_rows, shrink, write_samples
from afford.twohands.train.samples import NUMBERS, WORDS, Files, Split, files_below, group_of, is_validation, taxonomy_of
from afford.twohands.train.task import Batches, InputSize
from stages.extraction import dataset_pack
from tests.helpers.made_samples import Scratch, clip

LARGEST = (40, 64)


@pytest.fixture(scope="module")
def data(tmp_path_factory: pytest.TempPathFactory) -> Files:
    """A data set of four videos in our own format."""
    folder = tmp_path_factory.mktemp("set")
    clips = [clip(f"P01_{n:02d}", 12, split="val" if n == 3 else "train") for n in range(1, 5)]
    dataset_pack.run(tuple(clips), dataset_pack.Params(sheet_samples=1), Scratch(folder))
    return files_below(folder / "dataset")


def root_of(data: Files) -> Path:
    """Folder of the data set."""
    return next(path for name, path in data.items() if name.endswith(".parquet")).parents[1]


def both(data: Files, folder: Path, division: Split, part: str) -> tuple[list[Item], SampleStream]:
    """Samples as the reader of data sets gives them, in the size of the stream, and the stream."""
    items = [item for split in ((part,) if division.by == "given" else ("train", "val")) for item in Dataset(root_of(data), split)]
    chosen = [shrink(item, LARGEST) for item in items
              if division.by == "given" or is_validation(group_of(item, division.by), division) == (part == "val")]
    write_samples(data, division, part, folder / "stream" / part, LARGEST)
    return chosen, SampleStream(folder / "stream" / part)


def equal(one: Item, other: Item) -> bool:
    """Equal words, numbers, pictures and masks."""
    same = all(getattr(one, name) == getattr(other, name) for name in (*WORDS, *NUMBERS))
    return same and np.array_equal(one.image, other.image) and np.array_equal(one.masks, other.masks)


@pytest.mark.parametrize("part", ["train", "val"])
@pytest.mark.parametrize("by", ["given", "video", "object"])
def test_streamed_samples_are_those_of_the_data_set(data: Files, tmp_path: Path, by: str, part: str) -> None:
    """Samples in any order, twice; their labels; for every way to divide."""
    wanted, streamed = both(data, tmp_path, Split(by, 0.4, 1), part)
    assert len(wanted) == len(streamed) > 0
    order = np.random.default_rng(0).permutation(len(wanted)).tolist()
    assert all(equal(wanted[n], streamed[n]) for n in [*order, *order])
    names = ("video", "narration", "verb", "noun", "taxonomy")
    assert list(label_rows(streamed, *names)) == [tuple(getattr(item, name) for name in names) for item in wanted]


def test_batches_are_the_same_to_the_byte(data: Files, tmp_path: Path) -> None:
    """Cropped, mirrored and coloured batches of a training, from either."""
    def digests(samples: list[Item] | SampleStream) -> list[str]:
        sampler = BalancedSampler([(item.verb, item.taxonomy) for item in samples], 0.5, 0)
        batches = Batches(samples, sampler, Augmentation(), InputSize((32, 64)), 4, 0, coarse=2)
        return [blake3(b"".join(part.tobytes() if isinstance(part, np.ndarray) else repr(part).encode() for part in batches(n)))
                .hexdigest() for n in range(6)]  # fmt: skip

    wanted, streamed = both(data, tmp_path, Split(), "train")
    assert digests(wanted) == digests(streamed)


def test_pictures_are_read_in_place(data: Files, tmp_path: Path) -> None:
    """Our shards have JPEGs uncompressed, so that a group has their places and no copy; compressed shards are read as well."""
    _, streamed = both(data, tmp_path, Split(), "train")
    group = streamed._group(0, 0)
    assert group.places and not group.pictures
    squeezed = tmp_path / "squeezed" / "data"
    squeezed.mkdir(parents=True)
    for name, path in data.items():
        if name.endswith(".parquet"):
            pq.write_table(pq.read_table(path), squeezed / Path(name).name, compression="snappy", row_group_size=3)
    again = files_below(tmp_path / "squeezed")
    write_samples(again, Split(), "train", tmp_path / "again", LARGEST)
    other = SampleStream(tmp_path / "again")
    assert other._group(0, 0).places is None
    assert all(equal(one, two) for one, two in zip(streamed, other, strict=True))


def test_no_decoded_copy_is_written(data: Files, tmp_path: Path) -> None:
    """The index takes some hundred bytes a sample."""
    _, streamed = both(data, tmp_path, Split(), "train")
    written = sum(path.stat().st_size for path in (tmp_path / "stream").rglob("*") if path.is_file())
    assert written < 4000 + 300 * len(streamed)


def test_memory_is_bounded(data: Files, tmp_path: Path) -> None:
    """Samples are read again with room for two of them and one group, and are the same."""
    wanted, _ = both(data, tmp_path, Split(), "train")
    small = SampleStream(tmp_path / "stream" / "train", encoded_bytes=1, decoded_bytes=2 * 40 * 64 * 4)
    for n in (*range(len(small)), *range(len(small))):
        assert equal(small[n], wanted[n])
        assert small._decoded.used <= small._decoded.limit and small._groups.used <= 1
        assert small._images.used <= small._images.limit


def test_samples_of_one_picture_share_its_pixels(data: Files, tmp_path: Path) -> None:
    """Decoded pixels are kept once for all samples that show them."""
    wanted, streamed = both(data, tmp_path, Split(), "train")
    read = [[streamed[n].image for n in range(len(streamed))] for _ in range(2)][1]
    different = {one.image.tobytes() for one in wanted}
    assert len({id(image) for image in read}) == len(different)
    assert streamed._images.used == sum(map(len, different))


def test_the_oldest_value_is_dropped_first() -> None:
    """Sizes count, and a value that was asked for stays longer."""
    kept: Bounded[str] = Bounded(10)
    kept.put("a", "a", 4)
    kept.put("b", "b", 4)
    assert kept.get("a") == "a"
    kept.put("c", "c", 4)
    assert kept.get("b") is None and kept.get("a") == "a" and kept.used == 8
    kept.put("a", "larger", 9)
    assert kept.get("c") is None and kept.get("a") == "larger" and kept.used == 9


def test_an_index_is_made_once(data: Files, tmp_path: Path) -> None:
    """A resumed training reads the index that is there; half an index is none."""
    write_samples(data, Split(), "train", tmp_path / "one", LARGEST)
    before = (tmp_path / "one" / SHARDS).stat().st_mtime_ns
    write_samples(data, Split(), "train", tmp_path / "one", LARGEST)
    assert (tmp_path / "one" / SHARDS).stat().st_mtime_ns == before
    (tmp_path / "one" / SHARDS).unlink()
    write_samples(data, Split(), "train", tmp_path / "one", LARGEST)
    assert len(SampleStream(tmp_path / "one"))


def test_damage_is_named(data: Files, tmp_path: Path) -> None:
    """A shard with a flipped byte in its pictures is refused by its name when the sample is read."""
    for name, path in data.items():
        (tmp_path / "bad" / name).parent.mkdir(parents=True, exist_ok=True)
        (tmp_path / "bad" / name).write_bytes(path.read_bytes())
    shard = next(path for name, path in files_below(tmp_path / "bad").items() if "train" in name and name.endswith(".parquet"))
    whole = shard.read_bytes()
    at = whole.index(b"\xff\xd8\xff") + 200
    shard.write_bytes(whole[:at] + bytes([whole[at] ^ 255]) + whole[at + 1 :])
    write_samples(files_below(tmp_path / "bad"), Split(), "train", tmp_path / "index", LARGEST)
    with pytest.raises(SourceError, match=r"train-00000.*a whole shard"):
        list(SampleStream(tmp_path / "index"))


def test_undecodable_pictures_are_named(data: Files, tmp_path: Path) -> None:
    """The sample is in the error, when it is read."""
    table = pq.read_table(next(path for name, path in data.items() if "train" in name and name.endswith(".parquet"))).slice(0, 2)
    rows = table.to_pylist()
    rows[1]["image"] = {"bytes": b"not a picture", "path": None}
    (tmp_path / "data").mkdir()
    pq.write_table(type(table).from_pylist(rows, table.schema), tmp_path / "data" / "train-0.parquet")
    write_samples(files_below(tmp_path), Split(), "train", tmp_path / "index", LARGEST)
    with pytest.raises(ValueError, match=f"{rows[1]['sample_id']}: expected image to be a JPEG or PNG"):
        list(SampleStream(tmp_path / "index"))


def as_arrow(data: Files, folder: Path, **options: Any) -> Files:
    """The training split as streams of three rows a batch, without its numbers."""
    folder.mkdir()
    for n, path in enumerate(path for name, path in sorted(data.items()) if "train-" in name):
        table = pq.read_table(path).drop_columns(["taxonomy", "frame"])
        with pa.OSFile(str(folder / f"data-{n}.arrow"), "wb") as sink, ipc.new_stream(sink, table.schema, **options) as writer:
            writer.write_table(table, max_chunksize=3)
    return files_below(folder)


def test_samples_of_arrow_streams_are_read_in_place(data: Files, tmp_path: Path) -> None:
    """Samples in any order are those of the shards; the taxonomy is that of the masks; only the index is written."""
    wanted, _ = both(data, tmp_path, Split(), "train")
    write_samples(as_arrow(data, tmp_path / "arrow"), Split(), "train", tmp_path / "index", LARGEST)
    found = SampleStream(tmp_path / "index", decoded_bytes=1)
    before = pa.total_allocated_bytes()
    for n in np.random.default_rng(0).permutation(len(wanted)).tolist():
        assert np.array_equal(found[n].image, wanted[n].image) and np.array_equal(found[n].masks, wanted[n].masks)
        assert (found[n].sample_id, found[n].noun) == (wanted[n].sample_id, wanted[n].noun)
        assert found[n].taxonomy == found.column("taxonomy")[n] == taxonomy_of(wanted[n].masks)
    assert len(found) == len(wanted) and pa.total_allocated_bytes() - before < 1 << 20
    assert {path.name for path in (tmp_path / "index").iterdir()} == {LABELS, SHARDS}


def test_samples_of_released_videos_are_read_one_by_one(data: Files, tmp_path: Path) -> None:
    """Samples in any order, divided by videos, with one video's outlines in memory: pictures and words are those of the shards."""
    export_2hands.export(root_of(data), tmp_path / "set")
    files, division = files_below(tmp_path / "set"), Split("video", 0.4, 1)
    wanted, _ = both(data, tmp_path, division, "train")
    write_samples(files, division, "train", tmp_path / "index", LARGEST)
    found = SampleStream(tmp_path / "index", encoded_bytes=1, decoded_bytes=1)
    for n in np.random.default_rng(0).permutation(len(wanted)).tolist():
        assert np.array_equal(found[n].image, wanted[n].image) and not (wanted[n].masks & ~found[n].masks).any()
        assert (found[n].video, found[n].verb, found[n].narration) == (wanted[n].video, wanted[n].verb, wanted[n].narration)
    assert len(found) == len(wanted) and {path.name for path in (tmp_path / "index").iterdir()} == {LABELS, SHARDS}


def test_files_that_cannot_be_read_one_by_one_are_refused(data: Files, tmp_path: Path) -> None:
    """Compressed and damaged streams, a video without outlines, and one that is no HDF5: one sentence each."""
    squeezed = as_arrow(data, tmp_path / "squeezed", options=ipc.IpcWriteOptions(compression="zstd"))
    broken, video, outlines = tmp_path / "broken.arrow", tmp_path / "0-1_P1.h5", tmp_path / "0-1_P1.json"
    broken.write_bytes(b"no stream")
    video.write_bytes(b"no video")
    outlines.write_text("{}")
    for files, hint in ((squeezed, "data-0.arrow: expected an Arrow stream without compression"),
                        ({"train/broken.arrow": broken}, "broken.arrow: expected an Arrow stream, as save_to_disk writes it"),
                        ({"train/h5/0-1_P1.h5": video}, "expected its outlines in train/jsons/0-1_P1.json"),
                        ({"train/h5/0-1_P1.h5": video, "train/jsons/0-1_P1.json": outlines}, "expected a video of the released")):
        with pytest.raises(ValueError, match=hint):
            write_samples(files, Split(), "train", tmp_path / "index", LARGEST)
