"""Plan of objects: disjoint splits, held-out categories, independent random streams."""

from __future__ import annotations

from collections import Counter

import pytest

from afford.synthetic.splits import TRAINED_CATEGORIES, UNSEEN_CATEGORIES, object_specs
from stages.synthetic import object_plan
from stages.synthetic.object_plan import Params


def test_unseen_categories_are_in_no_other_split() -> None:
    """Training, validation and seen objects are of trained categories only, and no two objects are the same."""
    plan = object_plan.run(Params())
    by_split = {split: {spec.category for spec in plan if spec.split == split} for split in ("train", "val", "seen", "unseen")}
    assert by_split["train"] == by_split["val"] == by_split["seen"] == set(TRAINED_CATEGORIES)
    assert by_split["unseen"] == set(UNSEEN_CATEGORIES) and len(UNSEEN_CATEGORIES) == 6
    assert len({spec.name for spec in plan}) == len({spec.seed for spec in plan}) == len(plan)


def test_counts_per_split_and_look() -> None:
    """Looks alternate within every category, so half of the evaluation objects have a single material."""
    plan = object_plan.run(Params(train_per_category=4, val_per_category=1, seen_per_category=2, unseen_per_category=4))
    counts = Counter((spec.split, spec.look) for spec in plan)
    assert counts["seen", "plain"] == counts["seen", "mixed"] == len(TRAINED_CATEGORIES)
    assert counts["unseen", "plain"] == counts["unseen", "mixed"] == 2 * len(UNSEEN_CATEGORIES)
    assert counts["train", "plain"] == len(TRAINED_CATEGORIES) and counts["train", "mixed"] == 3 * len(TRAINED_CATEGORIES)
    assert not any(spec.look == "plain" for spec in object_plan.run(Params(train_plain_every=0)) if spec.split == "train")


def test_splits_and_categories_have_independent_seeds() -> None:
    """Splits and categories have their own random stream; the seed changes all."""
    few, many = (object_plan.run(Params(train_per_category=n)) for n in (1, 5))
    assert {spec for spec in few if spec.split != "train"} == {spec for spec in many if spec.split != "train"}
    assert set(few) < set(many)
    assert object_specs("val", ("mug",), 2, 3, 2) == object_specs("val", ("knife", "mug"), 2, 3, 2)[2:]
    assert not {s.seed for s in few} & {s.seed for s in object_plan.run(Params(seed=1, train_per_category=1))}


def test_selected_splits_and_categories_are_a_subset_of_the_plan() -> None:
    """Objects equal those of the whole plan; an unknown split or category is an error that contains it."""
    plan = object_plan.run(Params())
    some = object_plan.run(Params(splits=("val", "unseen"), categories=("mug", "axe")))
    assert some == tuple(s for s in plan if s.split in ("val", "unseen") and s.category in ("mug", "axe"))
    for wrong in (Params(splits=("spoon",)), Params(categories=("spoon",))):
        with pytest.raises(ValueError, match="got spoon"):
            object_plan.run(wrong)


@pytest.mark.parametrize("wrong", [{"val_per_category": -1}, {"train_plain_every": -2},
                                   dict.fromkeys(("train_per_category", "val_per_category", "seen_per_category",
                                                  "unseen_per_category"), 0)])  # fmt: skip
def test_empty_plan_and_negative_counts_are_refused(wrong: dict[str, int]) -> None:
    """The error states the expected counts."""
    with pytest.raises(ValueError, match="expected counts of 0 or more and at least one object"):
        object_plan.run(Params(**wrong))
