"""Reading of the data set, and augmentation at load time."""

from __future__ import annotations

import copy
import pickle
import random
import shutil
from dataclasses import fields, replace

import cv2
import numpy as np
import pyarrow.parquet as pq
import pytest

from afford.common.errors import SourceError
from afford.common.files import MANIFEST
from afford.dataset import augment, load
from stages.extraction import dataset_pack
from tests.helpers.made_samples import Scratch, clip

CLIP = clip("P01_01", 230, split="train", height=32, width=48)


@pytest.fixture(scope="module")
def data(tmp_path_factory) -> load.Dataset:
    folder = tmp_path_factory.mktemp("packed")
    dataset_pack.run((CLIP,), dataset_pack.Params(samples_per_shard=120, sheet_samples=1), Scratch(folder))
    return load.Dataset(folder / "dataset", "train")


def same(a: load.Item, b: load.Item) -> bool:
    pairs = ((getattr(a, field.name), getattr(b, field.name)) for field in fields(a))
    return all(np.array_equal(x, y, equal_nan=x.dtype.kind == "f") if isinstance(x, np.ndarray) else x == y for x, y in pairs)


def test_items_are_the_samples(data):
    """Masks, decoded JPEG, text and motion of every item equal those of its sample."""
    assert len(data) == len(CLIP.samples)
    for item, sample in zip(data, CLIP.samples, strict=True):
        assert np.array_equal(item.masks, sample.masks)
        assert np.array_equal(item.image, cv2.imdecode(sample.image_jpeg, cv2.IMREAD_COLOR)[..., ::-1])
        assert np.array_equal(item.motion, sample.motion, equal_nan=True)
        assert np.array_equal(item.motion_time_ns, sample.motion_time_ns)
        assert (item.narration, item.object_left, item.taxonomy) == (sample.narration.text, sample.object_left, sample.taxonomy)


def test_random_access_equals_iteration(data):
    """Indices across row groups and shards, from both ends, give the same items."""
    items = list(data)
    for index in (0, 99, 100, 119, 120, 229, -1, -230):
        assert same(data[index], items[index])
    with pytest.raises(IndexError):
        data[230]


def test_a_copy_reads_the_same_items(data):
    """A data loader sends copies of the data set to its workers; a deep copy is pickled the same way."""
    assert same(copy.deepcopy(data)[150], data[150])


@pytest.mark.parametrize("workers", [0, 1])
@pytest.mark.filterwarnings("error:The given NumPy array is not writable")
def test_a_data_loader_gives_batches(data, workers):
    """A torch data loader collates arrays and numbers to tensors, text to lists, with and without workers."""
    from torch.utils.data import DataLoader

    named = load.Dataset(str(data.files[0].parents[1]), "train")
    batch = next(iter(DataLoader(named, batch_size=3, num_workers=workers, collate_fn=load.collate)))
    items = [data[n] for n in range(3)]
    assert batch.keys() == {field.name for field in fields(load.Item)}
    for name in ("image", "masks", "motion", "motion_time_ns", "taxonomy", "quality"):
        expected = np.stack([getattr(item, name) for item in items])
        assert np.array_equal(batch[name].numpy(), expected, equal_nan=expected.dtype.kind == "f"), name
    assert batch["narration"] == [item.narration for item in items]
    with pytest.raises(ValueError, match=r"'image': expected one shape in a batch, got \(16, 48, 3\) and \(32, 48, 3\)"):
        load.collate([items[0], replace(items[1], image=items[1].image[:16])])


@pytest.mark.parametrize("workers", [0, 1])
@pytest.mark.filterwarnings("error:The given NumPy array is not writable")
def test_default_collate_gives_the_same_batches(data, workers):
    """A data loader without `collate_fn`, on the data set or on a subset of it."""
    from torch.utils.data import DataLoader, Subset

    for samples in (data, Subset(data, [0, 1, 2])):
        batch = next(iter(DataLoader(samples, batch_size=3, num_workers=workers)))
        expected = load.collate([data[n] for n in range(3)])
        assert batch.keys() == expected.keys()
        for name, values in expected.items():
            words = isinstance(values, list)
            assert batch[name] == values if words else batch[name].dtype == values.dtype and np.array_equal(
                batch[name].numpy(), values.numpy(), equal_nan=values.is_floating_point()), name


def test_an_item_is_a_mapping_of_its_fields(data):
    item = data[0]
    assert list(item) == [field.name for field in fields(load.Item)] and len(item) == len(fields(load.Item))
    assert item["narration"] == item.narration and "nothing" not in item and dict(item)["image"] is item.image


def test_class_names_belong_to_labels(data):
    """A label is an index into the list of class names."""
    assert data.class_names("noun_class")[data[2].noun_class] == "wire"


def test_a_missing_split_is_named(data):
    """The message lists the splits of the data set."""
    with pytest.raises(ValueError, match=r"expected test-\*\.parquet, found the splits train"):
        load.Dataset(data.files[0].parents[1], "test")


def test_flip_twice_is_the_identity(data):
    """Pictures, masks, motion, text and taxonomy are restored by a second flip."""
    for item in list(data)[:8]:
        back = augment.flip(augment.flip(item))
        np.testing.assert_allclose(back.motion, item.motion, atol=1e-4)
        assert same(replace(back, motion=item.motion), item)


def test_flip_swaps_the_hands(data):
    """The left hand at x becomes the right hand at the mirrored x."""
    item = data[0]
    flipped = augment.flip(item)
    assert item.taxonomy == 0 and flipped.taxonomy == 1
    assert np.array_equal(flipped.masks[1], item.masks[0][:, ::-1])
    assert (flipped.object_left, flipped.object_right) == (item.object_right, item.object_left)
    assert flipped.narration == "pick up the right mug with the left hand"
    np.testing.assert_allclose(flipped.motion[1, :, 0], item.image.shape[1] - 1 - item.motion[0, :, 0])


def test_crop_keeps_masks_and_motion_together(data):
    """The object fills the frame, masks stay inside each other, and a point on the affordance stays on it."""
    item = data[0]
    ys, xs = np.nonzero(item.masks[0])
    middle = len(xs) // 2
    item = replace(item, motion=np.full_like(item.motion, 0) + np.float32([xs[middle], ys[middle]]))
    cut = augment.crop(item, 0.05)
    assert cut.image.shape == item.image.shape and cut.masks.shape == item.masks.shape
    assert cut.masks[2].sum() > item.masks[2].sum()
    assert not (cut.masks[0] & ~cut.masks[2]).any()
    x, y = np.rint(cut.motion[0, 0]).astype(int)
    assert cut.masks[0, y, x]


def test_crop_without_an_object_changes_nothing(data):
    """A sample without an object is not cropped."""
    item = replace(data[0], masks=np.zeros_like(data[0].masks))
    assert augment.crop(item, 0.05) is item


def test_neutral_colours_change_nothing(data):
    """Factors of one are the identity."""
    assert np.array_equal(augment.recolour(data[0].image, 1, 1, 1), data[0].image)


def test_augmentation_is_seeded_and_leaves_its_input_alone(data):
    """The same (seed, epoch, index) gives the same sample; another epoch gives other samples."""
    settings, before = augment.Settings(), pickle.dumps(data[3])
    first = [augment.augment(data[n], settings, 1, 0, n) for n in range(12)]
    again = [augment.augment(data[n], settings, 1, 0, n) for n in range(12)]
    other = [augment.augment(data[n], settings, 1, 1, n) for n in range(12)]
    assert all(map(same, first, again))
    assert not all(map(same, first, other))
    assert pickle.dumps(data[3]) == before


def test_vague_narrations_are_always_cropped(data):
    """A narration of "something" needs a crop around the object."""
    item = replace(data[0], narration="take Something")
    settings = augment.Settings(flip_share=0, crop_share=0, colour_share=0)
    assert same(augment.augment(item, settings, 0, 0, 0), augment.crop(item, settings.crop_margin))
    assert same(augment.augment(data[0], settings, 0, 0, 0), data[0])


@pytest.fixture(scope="module")
def small(tmp_path_factory):
    """Folder of a data set of six samples in one shard."""
    folder = tmp_path_factory.mktemp("small")
    params = dataset_pack.Params(sheet_samples=1)
    dataset_pack.run((clip("P01_02", 6, split="train", height=32, width=48),), params, Scratch(folder))
    return folder / "dataset"


@pytest.mark.parametrize("seed", range(4))
def test_one_flipped_bit_changes_no_sample(small, tmp_path, seed):
    """A flipped bit in pages, headers or footer gives the same samples and classes, or one sentence that names the file."""
    root = shutil.copytree(small, tmp_path / "dataset")
    path = next((root / "data").glob("*.parquet"))
    whole, rng, refused = path.read_bytes(), random.Random(seed), 0
    samples, features = list(load.Dataset(root)), load.Dataset(root).features
    for _ in range(40):
        flipped = bytearray(whole)
        flipped[rng.randrange(len(whole))] ^= 1 << rng.randrange(8)
        path.write_bytes(bytes(flipped))
        try:
            data = load.Dataset(root)
            assert data.features == features and all(map(same, data, samples))
        except SourceError as error:
            assert str(error).startswith(f"data/{path.name}: expected a whole shard")
            refused += 1
    assert refused > 20


def test_a_data_set_without_its_manifest_is_read(data, tmp_path):
    """A data set from another source has no manifest; its pages are verified."""
    root = shutil.copytree(data.files[0].parents[1], tmp_path / "copy")
    (root / MANIFEST).write_text('["a manifest of another kind"]')
    assert same(load.Dataset(root)[7], data[7])
    (root / MANIFEST).unlink()
    assert same(load.Dataset(root)[7], data[7])
    path = load.Dataset(root).files[0]
    flipped = bytearray(path.read_bytes())
    flipped[len(flipped) // 3] ^= 1
    path.write_bytes(bytes(flipped))
    with pytest.raises(SourceError, match="CRC checksum verification failed"):
        list(load.Dataset(root))


def test_a_shard_without_a_column_is_named(data, tmp_path):
    """Another table is no data set."""
    root = tmp_path / "other"
    (root / "data").mkdir(parents=True)
    pq.write_table(pq.read_table(data.files[0]).drop_columns(["motion"]), root / "data" / "train-00000-of-00001.parquet")
    with pytest.raises(SourceError, match="got no motion"):
        load.Dataset(root)[0]
