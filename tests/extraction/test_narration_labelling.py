"""Laws of narration_labelling: a frame is labelled by narrations that hold it, and by nothing else."""

from __future__ import annotations

import numpy as np
import pytest

from schemas.video import Clip, Frames, Narration
from stages.extraction import narration_labelling
from stages.extraction.narration_labelling import Params


def narration(key: str, start: int, stop: int, verb: str = "take", text: str = "take mug", verb_key: str = "") -> Narration:
    return Narration(key, start, stop, text, verb, 0, verb_key or verb, "mug", 13, "cup", ("mug",))


def label(narrations: list[Narration], frames: range, params: Params | None = None) -> dict[int, list[str]]:
    """Return frame -> ids of its narrations."""
    found = run(narrations, frames, params)
    out: dict[int, list[str]] = {}
    for frame, index in zip(found.frame.tolist(), found.narration.tolist(), strict=True):
        out.setdefault(frame, []).append(found.narrations[index].narration_id)
    return out


def run(narrations: list[Narration], frames: range, params: Params | None = None):  # type: ignore[no-untyped-def]
    clip = Clip("c", "c", "c", "", ("v.mp4",), "video", 30.0, False, frames[0], frames[-1], (), tuple(narrations), ())
    n = len(frames)
    pictures = Frames("c", np.array(frames, np.int64), np.arange(n, dtype=np.int64), np.zeros((n, 2, 2, 3), np.uint8))
    return narration_labelling.run(clip, pictures, params or Params())


A, B, C = narration("a", 1, 20), narration("b", 5, 10), narration("c", 8, 30)


def test_the_last_one_in_the_file_wins() -> None:
    """Rows (1-10, a), (5-20, b): frame 7 is labelled b, frame 3 a, and frame 21 has no label."""
    found = label([narration("a", 1, 10), narration("b", 5, 20)], range(1, 22))
    assert (found[7], found[3], 21 in found) == (["b"], ["a"], False)


def test_policy_shortest() -> None:
    """The shortest interval is chosen, the later one on a tie."""
    found = label([A, B, C], range(1, 31), Params(policy="shortest"))
    assert (found[4], found[9], found[15], found[25]) == (["a"], ["b"], ["a"], ["c"])
    assert label([narration("x", 1, 5), narration("y", 2, 6)], range(1, 7), Params(policy="shortest"))[3] == ["y"]


def test_policy_all() -> None:
    """Rows are sorted by frame, then in file order."""
    assert label([A, B, C], range(1, 31), Params(policy="all"))[9] == ["a", "b", "c"]


@pytest.mark.parametrize("policy", ["last", "shortest", "all"])
def test_labels_are_narrations_that_cover_the_frame(policy: str) -> None:
    """Each covered frame is labelled."""
    found = run([A, B, C], range(3, 40), Params(policy=policy))
    for frame, index in zip(found.frame, found.narration, strict=True):
        assert found.narrations[index].start_frame <= frame <= found.narrations[index].stop_frame
    assert set(found.frame.tolist()) == set(range(3, 31))


def test_narrations_between_the_frames_are_listed() -> None:
    """Frames far apart miss short narrations; so does a clip that ends early."""
    found = run([narration("a", 2, 9), narration("b", 10, 10), narration("c", 50, 60)], range(1, 22, 9))
    assert found.unmatched == ("a", "c") and [n.narration_id for n in found.narrations] == ["b"]


def test_excluded_verbs_neither_label_nor_hide_others() -> None:
    """'look' is dropped by its word or by its class, exactly; 'overlook' is not 'look'."""
    found = run([A, narration("l", 1, 20, "look"), narration("k", 1, 20, "peer", verb_key="look"),
                 narration("o", 1, 3, "overlook")], range(1, 21))
    assert found.excluded == ("l", "k") and {n.narration_id for n in found.narrations} == {"a", "o"}


def test_a_clip_without_narrations_has_no_labels() -> None:
    """The result has no rows."""
    for policy in ("last", "shortest", "all"):
        found = run([], range(1, 5), Params(policy=policy))
        assert len(found.frame) == 0 and found.narrations == ()


def test_long_and_unicode_sentences_survive() -> None:
    """40,000 characters, Greek, Chinese, emoji and a line break come out as they went in."""
    text = "κόψε το ψωμί 切面包 🍞\n" * 2500
    assert run([narration("a", 1, 5, text=text)], range(1, 6)).narrations[0].text == text


def test_the_words_do_not_say_which_hand() -> None:
    """A label carries no side, whatever the sentence says."""
    found = run([narration("a", 1, 5, text="take mug with left hand")], range(1, 6))
    assert not hasattr(found, "side") and not hasattr(found.narrations[0], "side")


def test_an_unknown_policy_is_refused_with_the_valid_names() -> None:
    """The message lists them."""
    with pytest.raises(KeyError, match="all, last, shortest"):
        run([A], range(1, 5), Params(policy="first"))
