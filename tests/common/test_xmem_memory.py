"""Laws of XMem's memory: weights of a reading, exact recall, bounds, and which elements survive."""

from __future__ import annotations

import pytest
import torch
from torch import Tensor

from afford.models.xmem_memory import Memory, MemorySize, most_used, similarity, top_weights
from afford.models.xmem_network import Keys

ROWS, COLUMNS, KEY, VALUE = 3, 4, 6, 5
PLACES = ROWS * COLUMNS


def frame(seed: int, objects: int = 2) -> tuple[Keys, Tensor]:
    """Random keys of 12 places, and values of the objects there."""
    chance = torch.Generator().manual_seed(seed)
    key, shrinkage, selection = (torch.randn(PLACES, wide, generator=chance) for wide in (KEY, 1, KEY))
    keys = Keys(key, shrinkage**2 + 1, selection.sigmoid())
    return keys, torch.randn(objects, VALUE, ROWS, COLUMNS, generator=chance)


def test_similarity_is_the_formula_of_the_paper() -> None:
    """-s sum_c e_c (k_c - q_c)^2 / sqrt(C), written as a loop."""
    memory, query = frame(0)[0], frame(1)[0]
    found = similarity(memory, query)
    for j in range(PLACES):
        for i in range(PLACES):
            apart = sum(query.selection[j, c] * (memory.key[i, c] - query.key[j, c]) ** 2 for c in range(KEY))
            assert torch.isclose(found[j, i], -memory.shrinkage[i, 0] * apart / KEY**0.5, atol=1e-4)


@pytest.mark.parametrize("count", [1, 5, 50])
def test_top_weights_sum_to_one(count: int) -> None:
    """The largest similarities get the weights; a memory smaller than `count` is read whole."""
    similar = similarity(frame(0)[0], frame(1)[0])
    weights, at = top_weights(similar, count)
    assert weights.shape == (PLACES, min(count, PLACES)) and (weights >= 0).all()
    assert torch.allclose(weights.sum(dim=1), torch.ones(PLACES))
    assert torch.equal(at[:, 0], similar.argmax(dim=1))


def test_a_memory_of_one_frame_returns_its_values_at_its_keys() -> None:
    """Exactly where one element is read; nearly where 30 are and keys are far apart."""
    keys, value = frame(2)
    for size, scale in ((MemorySize(top_k=1), 1.0), (MemorySize(), 100.0)):
        memory = Memory(size)
        far = keys._replace(key=keys.key * scale)
        memory.add(far, value, pinned=True)
        assert torch.allclose(memory.read(far), value, atol=1e-5)


def test_a_reading_is_a_weighted_mean() -> None:
    """The same as the dense product of weights and values, and the usage is the sum of the weights."""
    memory = Memory(MemorySize(top_k=4))
    for seed in range(3):
        memory.add(*frame(seed))
    kept, query = memory.elements, frame(9)[0]
    assert kept is not None
    weights, at = top_weights(similarity(kept, query), 4)
    dense = torch.zeros(PLACES, len(memory)).scatter_(1, at, weights)
    wanted = (dense @ kept.value).view(ROWS, COLUMNS, 2, VALUE).permute(2, 3, 0, 1)
    assert torch.allclose(memory.read(query), wanted, atol=1e-5)
    assert torch.allclose(kept.used, dense.sum(dim=0), atol=1e-6) and (kept.shown == 1).all()


@pytest.mark.parametrize("size", [MemorySize(3, 2, 4, 7, 20), MemorySize(3, 1, 2, 5, 5), MemorySize(3, 1, 9, 500, 600)])
def test_memory_is_bounded_and_pinned_frames_stay(size: MemorySize) -> None:
    """Long-term and working memory keep their bounds in a video of any length; key frames are unchanged, the latest is there."""
    memory, keys = Memory(size), [frame(seed) for seed in (100, 101)]
    for one in keys:
        memory.add(*one, pinned=True)
    largest = 0
    for seed in range(60):
        memory.read(frame(seed)[0])
        memory.add(*frame(seed))
        assert memory.elements is not None
        largest = max(largest, memory.long)
        assert memory.long <= size.long_term
        assert len(memory) - memory.long - memory.pinned <= (size.most_frames - 1) * PLACES
        pinned = memory.elements.key[memory.long : memory.long + memory.pinned]
        assert torch.equal(pinned, torch.cat([one.key for one, _ in keys]))
        if size.least_frames > 1:
            assert torch.equal(memory.elements.key[-PLACES:], frame(seed)[0].key)
    assert largest > 0 and (size.long_term > 100 or largest > size.long_term - size.prototypes)


def test_prototypes_are_the_most_used_and_the_least_used_are_dropped() -> None:
    """Keys of prototypes are among the most used; of equally used elements the earlier stays."""
    memory = Memory(MemorySize(2, 1, 3, 4, 4))
    memory.add(*frame(0))
    for _ in range(3):
        memory.read(frame(7)[0])
    assert memory.elements is not None
    wanted = most_used(memory.elements, 4)
    assert wanted.usage().min() >= memory.elements.usage().sort(descending=True).values[4]
    memory.add(*frame(1))
    assert memory.long == len(memory) == 4 and torch.equal(memory.elements.key, wanted.key)
    assert (memory.elements.used == 0).all() and (memory.elements.shrinkage >= 1).all()
    tied = most_used(memory.elements, 2)
    assert torch.equal(tied.key, memory.elements.key[:2])


def test_a_prototype_of_equal_elements_keeps_their_value() -> None:
    """Potentiation takes means: a video that stands still gives prototypes with the values of its frames."""
    memory, (keys, value) = Memory(MemorySize(1, 1, 3, 12, 12)), frame(3)
    far = keys._replace(key=keys.key * 100)
    for _ in range(2):
        memory.add(far, value)
    assert memory.long == len(memory) == 12
    assert torch.allclose(memory.read(far), value, atol=1e-4)


@pytest.mark.parametrize(("bad", "words"), [
    ({"least_frames": 10}, "least_frames < most_frames, got 10 and 10"), ({"prototypes": 20_000}, "prototypes <= long_term"),
    ({"top_k": 0}, "top_k of 1 or more"), ({"least_frames": 0}, "got 0 and 10")])  # fmt: skip
def test_bounds_that_exclude_each_other_are_refused(bad: dict[str, int], words: str) -> None:
    with pytest.raises(ValueError, match=words):
        MemorySize(**bad)
