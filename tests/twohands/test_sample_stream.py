"""Samples that are read from Parquet shards on demand are those of the decoded cache, to the byte, and in bounded memory."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pyarrow.parquet as pq
import pytest
from blake3 import blake3

from afford.common.errors import SourceError
from afford.dataset.load import Item
from afford.training.sampler import BalancedSampler
from afford.twohands.train.augment import Augmentation
from afford.twohands.train.sample_cache import SampleCache, write_cache
from afford.twohands.train.sample_stream import SHARDS, Bounded, SampleStream, label_rows, open_samples, write_samples
from afford.twohands.train.samples import NUMBERS, WORDS, Files, Split, files_below, read_split
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


def both(data: Files, folder: Path, division: Split, part: str) -> tuple[SampleCache, SampleStream]:
    """The decoded cache, and the stream."""
    write_cache(read_split(data, division, part), folder / "cache" / part, LARGEST)
    write_samples(data, division, part, folder / "stream" / part, LARGEST)
    streamed = open_samples(folder / "stream" / part)
    assert isinstance(streamed, SampleStream)
    return SampleCache(folder / "cache" / part), streamed


def equal(one: Item, other: Item) -> bool:
    """Equal words, numbers, pictures and masks."""
    same = all(getattr(one, name) == getattr(other, name) for name in (*WORDS, *NUMBERS))
    return same and np.array_equal(one.image, other.image) and np.array_equal(one.masks, other.masks)


@pytest.mark.parametrize("part", ["train", "val"])
@pytest.mark.parametrize("by", ["given", "video", "object"])
def test_streamed_samples_are_those_of_the_cache(data: Files, tmp_path: Path, by: str, part: str) -> None:
    """Samples in any order, twice; their labels; for every way to divide."""
    cached, streamed = both(data, tmp_path, Split(by, 0.4, 1), part)
    assert len(cached) == len(streamed) > 0
    order = np.random.default_rng(0).permutation(len(cached)).tolist()
    assert all(equal(cached[n], streamed[n]) for n in [*order, *order])
    names = ("video", "narration", "verb", "noun", "taxonomy")
    assert list(label_rows(cached, *names)) == list(label_rows(streamed, *names))


def test_batches_are_the_same_to_the_byte(data: Files, tmp_path: Path) -> None:
    """Cropped, mirrored and coloured batches of a training, from either."""
    def digests(samples: SampleCache | SampleStream) -> list[str]:
        sampler = BalancedSampler(list(label_rows(samples, "verb", "taxonomy")), 0.5, 0)
        batches = Batches(samples, sampler, Augmentation(), InputSize((32, 64)), 4, 0, coarse=2)
        return [blake3(b"".join(part.tobytes() if isinstance(part, np.ndarray) else repr(part).encode() for part in batches(n)))
                .hexdigest() for n in range(6)]  # fmt: skip

    cached, streamed = both(data, tmp_path, Split(), "train")
    assert digests(cached) == digests(streamed)


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
    other = open_samples(tmp_path / "again")
    assert isinstance(other, SampleStream) and other._group(0, 0).places is None
    assert all(equal(one, two) for one, two in zip(streamed, other, strict=True))


def test_no_decoded_copy_is_written(data: Files, tmp_path: Path) -> None:
    """The index takes some hundred bytes a sample."""
    _, streamed = both(data, tmp_path, Split(), "train")
    written = sum(path.stat().st_size for path in (tmp_path / "stream").rglob("*") if path.is_file())
    assert written < 4000 + 300 * len(streamed)


def test_memory_is_bounded(data: Files, tmp_path: Path) -> None:
    """Samples are read again with room for two of them and one group, and are the same."""
    cached, _ = both(data, tmp_path, Split(), "train")
    small = SampleStream(tmp_path / "stream" / "train", encoded_bytes=1, decoded_bytes=2 * 40 * 64 * 4)
    for n in (*range(len(small)), *range(len(small))):
        assert equal(small[n], cached[n])
        assert small._decoded.used <= small._decoded.limit and small._groups.used <= 1


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
    assert len(open_samples(tmp_path / "one"))


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
        list(open_samples(tmp_path / "index"))


def test_undecodable_pictures_are_named(data: Files, tmp_path: Path) -> None:
    """The sample is in the error, when it is read."""
    table = pq.read_table(next(path for name, path in data.items() if "train" in name and name.endswith(".parquet"))).slice(0, 2)
    rows = table.to_pylist()
    rows[1]["image"] = {"bytes": b"not a picture", "path": None}
    (tmp_path / "data").mkdir()
    pq.write_table(type(table).from_pylist(rows, table.schema), tmp_path / "data" / "train-0.parquet")
    write_samples(files_below(tmp_path), Split(), "train", tmp_path / "index", LARGEST)
    with pytest.raises(ValueError, match=f"{rows[1]['sample_id']}: expected image to be a JPEG or PNG"):
        list(open_samples(tmp_path / "index"))
