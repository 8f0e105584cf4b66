"""Samples of every form come in, batches that are a function of (seed, number) come out."""

from __future__ import annotations

from collections import Counter
from dataclasses import replace
from pathlib import Path

import datasets
import numpy as np
import pytest
from PIL import Image

from afford.dataset import export_2hands
from afford.dataset.load import Dataset, Item
from afford.training.sampler import BalancedSampler
from afford.twohands.train import samples as data
from afford.twohands.train.augment import Augmentation, augment, benchmark_crop, mask_centre, replace_nouns, uncropped
from afford.twohands.train.sample_stream import shrink
from afford.twohands.train.task import Batches, InputSize
from afford.twohands.train.validation import THRESHOLDS, iou_and_precision
from stages.extraction import dataset_pack
from tests.helpers.made_samples import Scratch, clip
from tests.helpers.read_samples import read_items

SIZE = (48, 64)


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("packed")
    clips = [clip(f"P01_{n:02d}", 12, split="val" if n == 3 else "train") for n in range(1, 4)]
    dataset_pack.run(tuple(clips), dataset_pack.Params(sheet_samples=1), Scratch(folder))
    return folder / "dataset"


@pytest.fixture(scope="module")
def packed(folder: Path) -> data.Files:
    return data.files_below(folder)


def test_our_own_data_set(packed: data.Files, folder: Path) -> None:
    """The same items as `afford.dataset.load` gives, but for the motion."""
    found, wanted = list(read_items(packed, "train")), list(Dataset(folder, "train"))
    assert len(found) == len(wanted) == 24 and data.splits(packed) == ["train", "val"]
    for a, b in zip(found, wanted, strict=True):
        assert np.array_equal(a.image, b.image) and np.array_equal(a.masks, b.masks)
        assert (a.sample_id, a.narration, a.taxonomy, a.video, a.verb) == (b.sample_id, b.narration, b.taxonomy, b.video, b.verb)


def test_the_released_form(packed: data.Files, folder: Path, tmp_path: Path) -> None:
    """h5 and json of 2HANDS: the words, the taxonomy, the outer contours."""
    export_2hands.export(folder, tmp_path)
    made = data.files_below(tmp_path)
    found, wanted = list(read_items(made, "train")), list(read_items(packed, "train"))
    assert data.splits(made) == ["train", "val"]
    for a, b in zip(found, wanted, strict=True):
        assert (a.narration, a.taxonomy, a.verb, a.noun, a.video) == (b.narration, b.taxonomy, b.verb, b.noun, b.video)
        assert np.array_equal(a.image, b.image) and not (b.masks & ~a.masks).any()


@pytest.mark.parametrize("form", ["disk", "parquet"])
def test_any_folder_of_datasets(form: str, tmp_path: Path) -> None:
    """Image, masks and narration are enough; the taxonomy follows from the masks."""
    grey = np.zeros((20, 30), np.uint8)
    grey[5:9, 5:9] = 3
    rows = {"image": [Image.new("RGB", (30, 20), (200, 10, 10))] * 2, "mask_left": [Image.fromarray(grey)] * 2,
            "mask_right": [Image.new("L", (30, 20)), Image.fromarray(grey)], "narration": ["open jar", "lift pot"]}
    kinds = {"image": datasets.Image(), "mask_left": datasets.Image(), "mask_right": datasets.Image(),
             "narration": datasets.Value("string")}  # fmt: skip
    made = datasets.Dataset.from_dict(rows, features=datasets.Features(kinds))
    if form == "disk":
        datasets.DatasetDict({"train": made, "validation": made}).save_to_disk(str(tmp_path))
    else:
        made.to_parquet(tmp_path / "train.parquet")
    found = list(read_items(data.files_below(tmp_path), "train"))
    assert [(item.narration, item.taxonomy) for item in found] == [("open jar", 0), ("lift pot", 2)]
    assert found[0].masks.sum((1, 2)).tolist() == [16, 0, 0, 0] and found[0].image[0, 0, 0] > 190
    assert data.splits(data.files_below(tmp_path)) == (["train", "val"] if form == "disk" else ["train"])


def test_unreadable_data_sets_are_refused(tmp_path: Path) -> None:
    """No files, a missing column, a mask of another size, a damaged picture."""
    with pytest.raises(ValueError, match=r"expected \*.parquet or \*.arrow files"):
        data.splits(data.files_below(tmp_path))
    datasets.Dataset.from_dict({"image": ["x"], "narration": ["y"]}).to_parquet(tmp_path / "train.parquet")
    with pytest.raises(ValueError, match=r"train.parquet: expected the columns .* found no mask_left, mask_right"):
        list(read_items(data.files_below(tmp_path), "train"))
    good = {"bytes": b"no picture", "path": ""}
    with pytest.raises(ValueError, match="open jar: expected image to be a JPEG or PNG, got 10 other bytes"):
        data.item_of_row({"narration": "open jar", "image": good, "mask_left": good, "mask_right": good})
    with pytest.raises(ValueError, match="P1: expected image with the bytes of a picture"):
        data.item_of_row({"sample_id": "P1", "narration": "open jar", "image": {"bytes": None, "path": "a.jpg"}})


def test_parts_never_meet(packed: data.Files) -> None:
    """Divided by video or by object, no group is in both parts, nothing is lost, and the hash decides for each group alone."""
    everything = {item.sample_id for split in ("train", "val") for item in read_items(packed, split)}
    for by, label in (("video", "video"), ("object", "noun")):
        division = next(d for d in (data.Split(by, 0.4, seed) for seed in range(99)) if all(parts(packed, d)))
        train, val = parts(packed, division)
        assert not {getattr(item, label) for item in train} & {getattr(item, label) for item in val}
        assert {item.sample_id for item in [*train, *val]} == everything
    with pytest.raises(ValueError, match="expected given, video or object, got 'luck'"):
        data.Split("luck")


def parts(files: data.Files, division: data.Split) -> tuple[list[Item], list[Item]]:
    return list(read_items(files, "train", division)), list(read_items(files, "val", division))


def test_larger_samples_are_shrunk(packed: data.Files) -> None:
    """The aspect ratio is kept; smaller samples stay as they are."""
    whole = next(read_items(packed, "train"))
    small = shrink(whole, (16, 96))
    assert small.image.shape == (16, 24, 3) and small.masks.shape == (4, 16, 24)
    assert abs(small.masks[2].mean() - whole.masks[2].mean()) < 0.02 and shrink(whole, (64, 96)) is whole


def test_order_is_a_function_of_seed_and_position() -> None:
    """Asked in any order; without balance an epoch is a permutation; other epochs and seeds are others."""
    labels = ["a"] * 50 + ["b"] * 7
    one, two = BalancedSampler(labels, 0.0, 1), BalancedSampler(labels, 0.0, 1)
    forward = [one.sample(n) for n in range(150)]
    assert [two.sample(n) for n in reversed(range(150))] == forward[::-1]
    assert sorted(index for epoch, index in forward if epoch == 0) == list(range(57))
    assert forward[:57] != [(0, i) for _, i in forward[57:114]]
    assert forward != [BalancedSampler(labels, 0.0, 2).sample(n) for n in range(150)]


def test_balance_makes_classes_equal() -> None:
    """Balance 1 draws two classes equally often, with equal shares of their samples; 0.5 is in between."""
    labels = ["common"] * 90 + ["rare"] * 10
    share = {}
    for balance in (0.0, 0.5, 1.0):
        order = BalancedSampler(labels, balance, 0)
        drawn = Counter(order.sample(n)[1] for n in range(100 * 40))
        share[balance] = sum(count for index, count in drawn.items() if index >= 90) / 4000
        assert len(drawn) == 100 and max(drawn[i] for i in range(90)) - min(drawn[i] for i in range(90)) <= 40
    assert share[0.0] == pytest.approx(0.1) and share[0.5] == pytest.approx(0.25, abs=0.01)
    assert share[1.0] == pytest.approx(0.5, abs=0.01)


def test_batches_are_a_function_of_their_number(packed: data.Files) -> None:
    """The same batch at any time; two batches of two are the one of four; tasks and pictures of one sample stay together."""
    samples = list(read_items(packed, "train"))
    order = BalancedSampler([item.taxonomy for item in samples], 0.5, 3)
    batches = Batches(samples, order, Augmentation(), InputSize(SIZE), 4, 3)
    first = batches(7)
    batches(2)
    again = batches(7)
    assert all(np.array_equal(a, b) for a, b in zip(first, again, strict=True))
    halves = [replace(batches, size=2)(n) for n in (14, 15)]
    assert np.array_equal(np.concatenate([half.masks for half in halves]), first.masks)
    assert halves[0].task + halves[1].task == first.task
    assert first.image.shape == (4, *SIZE, 3) and first.masks.dtype == bool and first.taxonomy.dtype == np.int64


def test_coarse_batches_come_first_and_lose_no_sample(packed: data.Files) -> None:
    """Coarse batches have twice as many samples at half the size, then the sequence continues; odd sizes are refused."""
    samples = list(read_items(packed, "train"))
    fine = Batches(samples, BalancedSampler([0] * len(samples), 0, 3), Augmentation(), InputSize((64, 96)), 4, 3)
    coarse = replace(fine, coarse=2)
    assert [coarse(n).image.shape for n in (1, 2)] == [(8, 32, 48, 3), (4, 64, 96, 3)]
    wanted = [fine(n) for n in range(6)]
    assert sum((coarse(n).task for n in range(4)), ()) == sum((batch.task for batch in wanted), ())
    assert np.array_equal(coarse(2).image, wanted[4].image)
    assert np.array_equal(coarse(1).centre, np.concatenate([batch.centre for batch in wanted[2:4]]))
    areas = [coarse(0).masks.mean((2, 3)), np.concatenate([batch.masks.mean((2, 3)) for batch in wanted[:2]])]
    assert np.allclose(*areas, atol=0.01)
    with pytest.raises(ValueError, match="expected multiples of 32 when some steps are at half the size"):
        replace(coarse, input_size=InputSize((48, 96)))(0)


def test_views_are_seeded_and_keep_picture_and_masks_together(packed: data.Files) -> None:
    """The same position gives the same view; a mirrored view swaps sides and words; a crop holds the objects whole."""
    samples = list(read_items(packed, "train"))
    plain = Augmentation(colour_share=0, stretch_share=0)
    for n, item in enumerate(samples):
        painted = replace(item, image=np.where(item.masks[2:].any(0)[..., None], np.uint8(255), np.uint8(0)).repeat(3, 2))
        seen = augment(painted, plain, 1, n).item
        assert np.array_equal(seen.image, augment(painted, plain, 1, n).item.image)
        assert np.array_equal(seen.image[..., 0] > 0, seen.masks[2:].any(0))
        assert sorted(seen.masks.sum((1, 2))) == sorted(item.masks.sum((1, 2)))
    mirrored = augment(samples[0], Augmentation(1, 0, colour_share=0, stretch_share=0), 1, 0).item
    assert mirrored.narration == "pick up the right mug with the left hand" and mirrored.taxonomy == 1
    assert np.array_equal(mirrored.masks[1], samples[0].masks[0, :, ::-1])
    box = benchmark_crop(samples[0], Augmentation(margin=0)).item.masks[2:].any(0)
    assert box[0].any() and box[-1].any() and box[:, 0].any() and box[:, -1].any()
    nothing = replace(samples[0], masks=np.zeros_like(samples[0].masks))
    found = benchmark_crop(nothing, Augmentation())
    assert found.item.image.shape == nothing.image.shape and np.isnan(found.centre).all()


def test_change_width_keeps_height_and_shares(packed: data.Files) -> None:
    """The width changes by at most the factors; height and the share of each mask are kept."""
    item = next(iter(read_items(packed, "train")))
    for n in range(8):
        widened = Augmentation(0, 0, stretch_share=1, stretch_range=(0.5, 2.0), colour_share=0)
        seen = augment(item, widened, 1, n).item
        (height, width), (before, across) = seen.image.shape[:2], item.image.shape[:2]
        assert height == before and across // 2 <= width <= 2 * across and seen.masks.shape == (4, height, width)
        assert np.allclose(seen.masks.mean((1, 2)), item.masks.mean((1, 2)), atol=0.02)


def test_a_view_knows_where_it_is_in_the_picture(packed: data.Files) -> None:
    """The centre is that of the objects in the whole picture, cropped or not, and is mirrored with it."""
    assert mask_centre(np.array([[False, False, True, True]])).tolist() == [0.5, 0.0]
    for n, item in enumerate(read_items(packed, "train")):
        wanted = uncropped(item).centre
        assert np.array_equal(benchmark_crop(item, Augmentation()).centre, wanted)
        mirrored = augment(item, Augmentation(flip_share=1), 1, n).centre
        assert np.allclose(mirrored, wanted * [-1, 1], atol=1e-6) and np.abs(wanted).max() <= 1


def test_nouns_are_replaced_by_random_words(packed: data.Files) -> None:
    """Each noun becomes its own random word, and other words are kept."""
    item = replace(next(iter(read_items(packed, "train"))), narration="pour from can into mug, canned", object_left="can",
                   object_right="mug", noun="can")  # fmt: skip
    words = replace_nouns(item, np.random.default_rng(0)).narration.split()
    assert words[:2] + words[3:4] + words[5:] == ["pour", "from", "into", "canned"]
    assert words[2] != words[4].rstrip(",") and not {"can", "mug"} & {words[2], words[4].rstrip(",")}


def test_some_samples_are_asked_for_by_their_classes_alone(packed: data.Files) -> None:
    """Nouns become random words and the task is kept beside them; without classes, or without the classes, a task stays."""
    item = replace(next(iter(read_items(packed, "train"))), narration="pour from can into mug", object_left="can",
                   object_right="mug", noun="can")  # fmt: skip
    plain = Augmentation(0, 1, colour_share=0, stretch_share=0)
    unnamed, unseen = replace(plain, unnamed_share=1), replace(plain, unseen_share=1)
    seen = augment(item, unnamed, 1, 0)
    assert seen.asked == item.narration and [seen.item.narration.split()[n] for n in (0, 1, 3)] == ["pour", "from", "into"]
    assert seen.item.image.size < item.image.size and not {"can", "mug"} & set(seen.item.narration.split())
    assert augment(item, replace(unnamed, crop_share=0), 1, 0).item.narration == item.narration
    scissors = replace(item, narration="take scissors", object_left="scissors", object_right="", noun="scissors")
    assert augment(scissors, unnamed, 1, 0).item.narration == "take scissors"
    assert augment(item, unseen, 1, 0).asked == "" and augment(item, unseen, 1, 0).item.narration == item.narration
    assert augment(item, plain, 1, 0).asked == item.narration
    shares = replace(plain, unnamed_share=0.5, unseen_share=0.25)
    drawn = [augment(item, shares, 1, position) for position in range(200)]
    assert 70 < sum(one.item.narration != item.narration for one in drawn) < 130
    assert 30 < sum(one.asked == "" for one in drawn) < 70


def test_objects_are_shown_before_another_picture(packed: data.Files) -> None:
    """Inside the objects a sample keeps its pixels, elsewhere it has those of the other picture; labels stay."""
    item = next(iter(read_items(packed, "train")))
    masks = np.zeros((4, *item.image.shape[:2]), bool)
    masks[2, 10:40, 10:50] = True
    item, plain = replace(item, masks=masks), Augmentation(0, 0, colour_share=0, stretch_share=0)
    other = np.full((17, 23, 3), 255 - int(item.image.mean()), np.uint8)
    seen = augment(item, plain, 1, 0, other).item
    assert np.array_equal(seen.image[20:30, 20:40], item.image[20:30, 20:40]) and np.array_equal(seen.masks, masks)
    assert (seen.image[50:, 60:] == other[0, 0]).all() and seen.narration == item.narration
    nothing = replace(item, masks=np.zeros_like(masks))
    assert np.array_equal(augment(nothing, plain, 1, 0, other).item.image, item.image)


def test_wide_crops_show_more(packed: data.Files) -> None:
    item = next(iter(read_items(packed, "train")))
    close = Augmentation(0, 1, colour_share=0, stretch_share=0)
    views = close, replace(close, wide_share=1)
    near, far = ([augment(item, one, 1, position).item.image.size for position in range(20)] for one in views)
    assert np.mean(far) > np.mean(near)


def test_residue_changes_some_pixels_and_no_label(packed: data.Files) -> None:
    """A part of the picture is repainted, the same with the same seed, wherever the masks are."""
    item = next(iter(read_items(packed, "train")))
    left = Augmentation(0, 0, stretch_share=0, colour_share=0, residue_share=1)
    plain = augment(item, replace(left, residue_share=0.0), 1, 0).item
    moved = replace(item, masks=item.masks[:, ::-1])
    seen, again, elsewhere = (augment(one, left, 1, 0).item for one in (item, item, moved))
    changed = (seen.image != plain.image).any(2).mean()
    assert 0 < changed < 0.7 and np.array_equal(seen.masks, plain.masks)
    assert np.array_equal(seen.image, again.image) and np.array_equal(seen.image, elsewhere.image)


def test_scores_are_the_definitions() -> None:
    """IoU and precision of the union at every threshold, against the plain definitions; an empty prediction has none."""
    rng = np.random.default_rng(0)
    region, truth = rng.random((2, 9, 11), np.float32), rng.random((2, 9, 11)) > 0.7
    found = iou_and_precision(region, truth)
    for n, threshold in enumerate(THRESHOLDS):
        said, true = (region > np.float32(threshold)).any(0), truth.any(0)
        assert found[0, n] == pytest.approx((said & true).sum() / (said | true).sum())
        assert found[1, n] == pytest.approx((said & true).sum() / said.sum() if said.any() else 0)
    assert iou_and_precision(np.zeros((2, 4, 4), np.float32), truth[:, :4, :4]).max() == 0


def test_a_flipped_bit_is_not_learned(tmp_path: Path) -> None:
    """Pages are verified when a model is trained on them; the sentence names the shard."""
    dataset_pack.run((clip("P01_01", 3, split="train"),), dataset_pack.Params(sheet_samples=1), Scratch(tmp_path))
    path = next((tmp_path / "dataset" / "data").glob("*.parquet"))
    flipped = bytearray(path.read_bytes())
    flipped[flipped.index(b"JFIF") + 700] ^= 1  # in a picture
    path.write_bytes(bytes(flipped))
    with pytest.raises(ValueError, match=r"train-00000-of-00001\.parquet: expected a whole shard of a data set"):
        list(read_items({f"data/{path.name}": path}, "train"))
