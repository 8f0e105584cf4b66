"""Reader of UniDexGrasp's lists: three splits that must not overlap."""

from __future__ import annotations

from pathlib import Path

import pytest

from afford.common.errors import SourceError
from afford.grasping.motion.unidexgrasp import read
from tests.helpers.made_motions import tree

LISTS = {"train": "'core/bottle-a1': [0.06, 0.08]\n# more\n'sem/Mug-b2': [0.15]\n", "unseen_objects": "core/bottle-c3: [0.1]\n",
         "unseen_categories": '"mujoco/Camera-d4": [0.12]\n'}  # fmt: skip


def lists(folder: Path, **changes: str) -> Path:
    for split, text in (LISTS | changes).items():
        (folder / f"{split}.yaml").write_text(text)
    return folder


def test_rows_of_objects_and_sizes(tmp_path: Path) -> None:
    found = read(tree(*lists(tmp_path).iterdir()))
    assert list(zip(found.code, found.category, found.split, found.scale.tolist(), strict=True)) == [
        ("core/bottle-a1", "bottle", "train", 0.06), ("core/bottle-a1", "bottle", "train", 0.08),
        ("sem/Mug-b2", "mug", "train", 0.15),
        ("core/bottle-c3", "bottle", "unseen_objects", 0.1), ("mujoco/Camera-d4", "camera", "unseen_categories", 0.12)]  # fmt: skip


@pytest.mark.parametrize(("changes", "message"), [
    ({"train": ""}, r"train.yaml: expected objects, each size once, got nothing"),
    ({"train": "a-1: [0.1, 0.1]"}, "got a-1 at 0.1 twice"),
    ({"train": "a-1: 0.1"}, r"train.yaml, line 1: expected 'code': \[scale, ...\]"),
    ({"train": "a-1: [x]"}, "line 1: expected 'code'"),
    ({"train": "a-1: [12]"}, "with scales of 0.01 to 1.0"),
    ({"unseen_objects": "core/bottle-a1: [0.1]"}, r"unseen_objects.yaml: expected objects of no other split, got core/bottle-a1"),
    ({"unseen_categories": "core/bottle-z9: [0.1]"}, r"expected categories that train.yaml lacks, got core/bottle-z9"),
])  # fmt: skip
def test_errors_of_invalid_lists(tmp_path: Path, changes: dict[str, str], message: str) -> None:
    with pytest.raises(SourceError, match=message):
        read(tree(*lists(tmp_path, **changes).iterdir()))


def test_a_missing_split(tmp_path: Path) -> None:
    lists(tmp_path).joinpath("unseen_objects.yaml").unlink()
    with pytest.raises(SourceError, match=r"expected a file unseen_objects.yaml, got no such file"):
        read(tree(*tmp_path.iterdir()))
