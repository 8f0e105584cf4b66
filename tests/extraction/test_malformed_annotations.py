"""Whatever one value of a mask file is replaced by, it is read or refused in a sentence; nothing crashes."""

from __future__ import annotations

import copy
import json
import random
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from pycocotools import mask as coco_mask

from afford.common.errors import SourceError
from afford.extraction.sources.key_frames import read_keys
from afford.extraction.sources.outlines import boxed_mask, run_lengths
from schemas.files import FileRef, FileTree
from tests.extraction.test_own_video import coco, compressed
from tests.helpers.tiny_root import OTHER, image, mask

GLOVED = image("v", 16, [mask("glove", "g", on_which_hand=["left hand"], in_contact_object="m"), mask("mug", "m", (OTHER,))])
DOCUMENTS = [{"video_annotations": [image("v", 1), GLOVED]}, coco(compressed()),
             coco([[10, 10, 40, 10, 40, 40]], attributes={"in_contact_object": "mug"})]
VALUES = [None, 7, -3, "x", [], {}, True, 1e30, [[1, 2]], "\u0000", ["a"], {"a": 1}, 0.5]


def places(value: Any, path: tuple[Any, ...] = ()) -> Iterator[tuple[Any, ...]]:
    """Paths to everything inside a document."""
    inside = value.items() if isinstance(value, dict) else enumerate(value) if isinstance(value, list) else ()
    for key, child in inside:
        yield (*path, key)
        yield from places(child, (*path, key))


def spoilt(rng: random.Random) -> Any:
    """A document with one value replaced."""
    document = copy.deepcopy(rng.choice(DOCUMENTS))
    *way, last = rng.choice(list(places(document)))
    inner = document
    for key in way:
        inner = inner[key]
    inner[last] = rng.choice(VALUES)
    return document


@pytest.mark.filterwarnings("ignore::DeprecationWarning")
def test_a_wrong_value_never_crashes_the_reader(tmp_path: Path) -> None:
    """The reader gets 600 corrupted documents, VISOR and COCO."""
    rng, path = random.Random(7), tmp_path / "masks.json"
    refused = 0
    for _ in range(600):
        path.write_text(json.dumps(spoilt(rng)))
        try:
            read_keys(FileTree("v", (FileRef("masks.json", "", 1, path),)), [])
        except SourceError:
            refused += 1
    assert 100 < refused < 600


@pytest.mark.parametrize("seed", range(5))
def test_compressed_run_lengths_are_read_as_written(seed: int) -> None:
    """Decoding the output of the reference encoder gives the same mask."""
    noise = np.random.default_rng(seed).random((37, 53)) > 0.2 + 0.15 * seed
    code = coco_mask.encode(np.asfortranarray(noise.astype(np.uint8)))
    found = boxed_mask(run_lengths(code["counts"].decode(), 37, 53), 37)
    mask = np.zeros((37, 53), bool)
    mask[found.y : found.y + found.mask.shape[0], found.x : found.x + found.mask.shape[1]] = found.mask
    assert np.array_equal(mask, noise)


@pytest.mark.parametrize("counts", ["x", "\u0000", "", None, [5, -5, 100], [1.5], [99]])
def test_malformed_run_lengths_are_refused(counts: Any) -> None:
    """Malformed counts never reach a decoder that would read out of bounds."""
    with pytest.raises(ValueError, match="counts"):
        run_lengths(counts, 10, 10)
