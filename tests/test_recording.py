"""Recordings say what the stages made, in media time; they are the same every time, and damage is found."""

from __future__ import annotations

import os
import subprocess
import sys
from dataclasses import replace
from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest

from afford.recording.check_content import check_content
from afford.recording.check_file import check_file
from afford.recording.content import EPOCH_NS, Channel, Message, Recording, content_digest
from afford.recording.difference import difference
from afford.recording.files import opened, write
from afford.recording.merge import merge
from afford.recording.moments import moments
from afford.recording.topics import slugs
from schemas.masks import Entity
from stages import stage_record
from tests.made_recordings import HANDS, MUG, NARRATION, Ctx, T, outputs, recorded

ROOT = Path(__file__).resolve().parent.parent


@pytest.fixture(scope="module")
def recording(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return recorded(tmp_path_factory.mktemp("recording"))


def test_masks_come_back_exactly(recording: Path) -> None:
    """What a viewer shows is the mask of the stage, 0 and 255, at the media time of its frame."""
    tracks = outputs()["mask_densify"]
    found = list(moments(recording, ["/mask_densify/right_hand", "/mask_densify/mug_2"]))
    assert [m.time_ns for m in found] == [40_000_000 * n for n in range(1, T + 1)]
    for t, moment in enumerate(found):
        np.testing.assert_array_equal(moment.picture("/mask_densify/right_hand"), tracks.masks[1, t] * 255)
        np.testing.assert_array_equal(moment.picture("/mask_densify/mug_2"), tracks.masks[3, t] * 255)


def test_every_stage_has_its_topics(recording: Path) -> None:
    """One namespace per stage; the words of the task are there for programs and for people."""
    with opened(recording) as found:
        topics = {channel.topic for channel in found.channels}
        metadata = dict(found.metadata)
    wanted = {"/frame_decode/image", "/mask_densify/left_hand", "/mask_densify/mug/state", "/mask_densify/tasse_groß",
              "/hand_inpaint/image", "/object_completion/mug", "/affordance/left", "/affordance/right", "/narration",
              "/narration/log"}  # fmt: skip
    assert wanted <= topics
    assert {f"provenance/{stage}" for stage in outputs()} <= set(metadata) and metadata["provenance"]["clip_id"] == "c1"
    said = [m.one("/narration").text for m in moments(recording, ["/narration"])]
    assert said == [NARRATION.text] * 4
    assert [m.one("/narration/log").message for m in moments(recording, ["/narration/log"])] == [NARRATION.text]


def test_time_never_runs_backwards(recording: Path) -> None:
    """(log time, topic) ascends through the whole file."""
    with opened(recording) as found:
        order = [(message.time_ns, message.topic) for message in found.messages]
    assert all(a < b for a, b in pairwise(order))


def test_a_frame_without_a_time_is_refused(tmp_path: Path) -> None:
    """A value about frames that were not decoded cannot be recorded; the message names the frame."""
    made = outputs()
    few = replace(made["frame_decode"], frame=made["frame_decode"].frame + 100)
    with pytest.raises(ValueError, match="frame 1 was not decoded"):
        stage_record.run(made["mask_densify"], few, stage_record.Params("mask_densify"), Ctx(tmp_path))


def test_two_processes_make_the_same_bytes(recording: Path, tmp_path: Path) -> None:
    """Another process, another hash seed, another folder: the same content, and with the same libraries the same bytes."""
    code = "import sys, pathlib; from tests.made_recordings import recorded; print(recorded(pathlib.Path(sys.argv[1])))"
    digests = set()
    for seed in ("0", "1"):
        run = subprocess.run([sys.executable, "-c", code, str(tmp_path / seed)], cwd=ROOT, text=True, check=True,
                             capture_output=True, env={**os.environ, "PYTHONHASHSEED": seed, "TZ": "Asia/Tokyo"})  # fmt: skip
        made = Path(run.stdout.strip())
        assert made.read_bytes() == recording.read_bytes() and difference(made, recording) == []
        with opened(made) as found:
            digests.add(content_digest(found))
    assert len(digests) == 1


def test_content_does_not_depend_on_layout(recording: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Other chunks, other order of registration: another file with the same content digest."""
    monkeypatch.setattr("afford.recording.files.CHUNK_BYTES", 4096)
    with opened(recording) as found:
        write(tmp_path / "small.mcap", replace(found, channels=found.channels[::-1]))
    small = tmp_path / "small.mcap"
    with opened(recording) as one, opened(small) as two:
        assert content_digest(one) == content_digest(two)
    assert small.read_bytes() != recording.read_bytes() and difference(recording, small) == []


def test_a_difference_is_named(recording: Path, tmp_path: Path) -> None:
    """One changed payload: its topic and its time."""
    with opened(recording) as found:
        messages = list(found.messages)
        at = next(i for i, m in enumerate(messages) if m.topic == "/affordance/left" and m.time_ns == EPOCH_NS + 80_000_000)
        messages[at] = messages[at]._replace(data=messages[at].data + b"\x00")
        write(tmp_path / "other.mcap", replace(found, messages=messages))
    (said,) = difference(recording, tmp_path / "other.mcap")
    assert "/affordance/left at 0.080000 s" in said


def test_a_whole_recording_passes_every_check(recording: Path) -> None:
    """Our own checks find nothing."""
    assert check_file(recording) == [] and check_content(recording) == []


def test_any_flipped_bit_is_found(recording: Path, tmp_path: Path) -> None:
    """Wherever one bit is flipped, and wherever the file is cut, the checks say so."""
    whole, path = recording.read_bytes(), tmp_path / "damaged.mcap"
    rng = np.random.default_rng(0)
    places = sorted({*rng.integers(0, len(whole), 60).tolist(), 0, len(whole) - 1, len(whole) - 20})
    for at in places:
        damaged = bytearray(whole)
        damaged[at] ^= 1 << int(rng.integers(8))
        path.write_bytes(damaged)
        assert check_file(path), f"a flipped bit at byte {at} of {len(whole)} was not found"
    for size in (0, 5, 16, len(whole) // 2, len(whole) - 1):
        path.write_bytes(whole[:size])
        assert check_file(path), f"a file cut to {size} bytes was not found"


def test_wrong_content_is_found(tmp_path: Path) -> None:
    """A whole file whose payloads are wrong: time stamps, missing frames."""
    made, late = outputs(), EPOCH_NS + 200_000_000
    tree = stage_record.run(made["mask_densify"], made["frame_decode"], stage_record.Params("mask_densify"), Ctx(tmp_path))
    with opened(tree.files[0].path) as found:
        kept = [m for m in found.messages if not (m.topic == "/mask_densify/mug" and m.time_ns > late)]
        messages = [m._replace(time_ns=m.time_ns + (m.topic == "/mask_densify/overlay")) for m in kept]
        write(tmp_path / "bad.mcap", replace(found, messages=sorted(messages)))
    assert check_file(tmp_path / "bad.mcap") == []
    said = " ".join(check_content(tmp_path / "bad.mcap"))
    assert "timestamp, log time and publish time differ" in said and "do not have the same frames" in said


def test_parts_that_clash_are_refused(recording: Path, tmp_path: Path) -> None:
    """One topic in two parts, or one schema with two meanings, cannot be merged."""
    with pytest.raises(ValueError, match="got it twice"):
        merge([recording, recording], tmp_path / "twice.mcap", {})
    for n, definition in enumerate((b"one", b"two")):
        write(tmp_path / f"{n}.mcap", Recording((Channel(f"/t{n}", "s.S", definition),), [Message(EPOCH_NS, f"/t{n}", b"")]))
    with pytest.raises(ValueError, match=r"schema s\.S: expected one definition"):
        merge([tmp_path / "0.mcap", tmp_path / "1.mcap"], tmp_path / "clash.mcap", {})


def test_messages_out_of_order_are_refused(tmp_path: Path) -> None:
    """A recorder must go forward in time; nothing is left under the final name when it does not."""
    backwards = [Message(EPOCH_NS + 5, "/t", b""), Message(EPOCH_NS, "/t", b"")]
    with pytest.raises(ValueError, match="time order"):
        write(tmp_path / "r.mcap", Recording((Channel("/t", "s.S", b"d"),), backwards))
    assert not (tmp_path / "r.mcap").exists()


def test_topic_words_are_unique() -> None:
    """Entities that differ only in what a topic cannot hold keep different topics."""
    names = [Entity(name, name, -1, "object", "") for name in ("cup:tea", "cup tea", "Cup/Tea", "", "杯")]
    assert len(set(slugs(names))) == len(names) and slugs(HANDS + MUG)[:4] == ["left_hand", "right_hand", "mug", "mug_2"]
