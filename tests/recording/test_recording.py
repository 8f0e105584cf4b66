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

from afford.common.image_files import jpeg, mask_png
from afford.recording.check_content import check_content
from afford.recording.check_file import check_file
from afford.recording.difference import difference
from afford.recording.mcap_files import (
    EPOCH_NS,
    Channel,
    Message,
    Recording,
    merge_recordings,
    open_recording,
    write_recording,
)
from afford.recording.messages import slugs
from afford.recording.moments import moments
from afford.recording.summary import summarise
from schemas.files import FileRef, FileTree
from schemas.masks import Entity
from stages.recording import run_record, stage_record
from tests.helpers.made_recordings import HANDS, MUG, NARRATION, Ctx, T, outputs, recorded

ROOT = Path(__file__).resolve().parents[2]


def written(folder: Path, files: dict[str, bytes]) -> FileTree:
    """Files on disk as the output of a stage."""
    for name, data in files.items():
        (folder / name).parent.mkdir(parents=True, exist_ok=True)
        (folder / name).write_bytes(data)
    return FileTree("run", tuple(FileRef(name, "", len(data), folder / name) for name, data in sorted(files.items())))


@pytest.fixture(scope="module")
def recording(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return recorded(tmp_path_factory.mktemp("recording"))


def test_masks_come_back_exactly(recording: Path) -> None:
    """The displayed mask is the stage's mask, 0 and 255, at the media time of its frame."""
    tracks = outputs()["mask_densify"]
    found = list(moments(recording, ["/mask_densify/right_hand", "/mask_densify/mug_2"]))
    assert [m.time_ns for m in found] == [40_000_000 * n for n in range(1, T + 1)]
    for t, moment in enumerate(found):
        np.testing.assert_array_equal(moment.picture("/mask_densify/right_hand"), tracks.masks[1, t] * 255)
        np.testing.assert_array_equal(moment.picture("/mask_densify/mug_2"), tracks.masks[3, t] * 255)


def test_stages_have_topics_of_their_own(recording: Path) -> None:
    """One namespace per stage; the task is recorded as a message and as a log line."""
    with open_recording(recording) as found:
        topics = {channel.topic for channel in found.channels}
        metadata = dict(found.metadata)
    wanted = {"/frame_decode/image", "/mask_densify/left_hand", "/mask_densify/mug/state", "/mask_densify/tasse_groß",
              "/hand_inpaint/image", "/object_completion/mug", "/affordance/left", "/affordance/right", "/narration",
              "/narration/log", "/source_read/outlines", "/source_read/narration", "/source_read/log", "/sample_assemble/image",
              "/sample_assemble/left", "/sample_assemble/log"}  # fmt: skip
    assert wanted <= topics
    assert {f"provenance/{stage}" for stage in outputs()} <= set(metadata) and metadata["provenance"]["clip_id"] == "c1"
    said = [m.one("/narration").text for m in moments(recording, ["/narration"])]
    assert said == [NARRATION.text] * 4
    assert [m.one("/narration/log").message for m in moments(recording, ["/narration/log"])] == [NARRATION.text]


def test_outlines_are_drawn_where_they_were_annotated(recording: Path) -> None:
    """Decoded key frames only, at the size of the frames; a pixel's centre is half a pixel from Foxglove's origin."""
    (moment,) = moments(recording, ["/source_read/outlines"])
    drawn = moment.one("/source_read/outlines")
    assert moment.time_ns == 80_000_000 and [text.text for text in drawn.texts] == ["left hand", "mug"]
    assert [(p.x, p.y) for p in drawn.points[0].points] == [(10.25, 5.25), (60.25, 5.25), (60.25, 30.25)]
    assert len(drawn.points) == 3 and drawn.points[1].outline_color == drawn.points[2].outline_color
    said = [line.message for m in moments(recording, ["/source_read/log"]) for line in m.values["/source_read/log"]]
    assert said == [NARRATION.text, "frame 3 is odd"]


def test_samples_are_recorded_as_the_data_set_has_them(recording: Path) -> None:
    """The JPEG to the byte, the masks to the bit, at the time of their frames."""
    made = outputs()["sample_assemble"].samples
    found = list(moments(recording, ["/sample_assemble/image", "/sample_assemble/left"]))
    assert [m.time_ns for m in found] == [sample.time_ns for sample in made]
    for moment, sample in zip(found, made, strict=True):
        assert moment.one("/sample_assemble/image").data == sample.image_jpeg.tobytes()
        np.testing.assert_array_equal(moment.picture("/sample_assemble/left"), sample.masks[0] * 255)


def test_files_of_a_run_are_recorded_as_they_are(tmp_path: Path) -> None:
    """JSON and Markdown to the letter, pictures of any size, provenance; the rest is left out. Every check passes."""
    files = {"statistics.json": b'{"n": 1}', "README.md": "# Größe\n\ntwo\n\nthree".encode(), "data/x.parquet": b"PAR1",
             "plots/areas.png": mask_png(np.eye(9, dtype=bool)), "sheet.jpg": jpeg(np.zeros((20, 30, 3), np.uint8))}
    made = run_record.run(written(tmp_path / "files", files), run_record.Params("dataset_pack"), Ctx(tmp_path)).files[0].path
    (start, *later) = moments(made)
    assert start.one("/dataset_pack/statistics").text == '{"n": 1}' and "/dataset_pack/data/x" not in start.values
    assert start.one("/dataset_pack/plots/areas").data == files["plots/areas.png"]
    assert [m.one("/dataset_pack/log").message for m in (start, *later)] == ["# Größe", "two", "three"]
    assert check_file(made) == check_content(made) == [] and summarise(made).problem == ""


def test_files_without_anything_to_show_are_refused(tmp_path: Path) -> None:
    """A recording always shows something."""
    with pytest.raises(ValueError, match="none of 1 files is JSON, Markdown or a picture"):
        run_record.run(written(tmp_path, {"x.parquet": b""}), run_record.Params("dataset_pack"), Ctx(tmp_path))


def test_a_clip_without_samples_is_recorded(tmp_path: Path) -> None:
    """The topics are there and empty."""
    made = outputs() | {"sample_assemble": replace(outputs()["sample_assemble"], samples=())}
    parts = []
    for stage in ("frame_decode", "sample_assemble"):
        (tmp_path / stage).mkdir()
        tree = stage_record.run(made[stage], made["frame_decode"], stage_record.Params(stage), Ctx(tmp_path / stage))
        parts.append(tree.files[0].path)
    merge_recordings(parts, tmp_path / "c1.mcap", {})
    assert check_file(tmp_path / "c1.mcap") == check_content(tmp_path / "c1.mcap") == []
    topics = {topic.topic: topic.messages for topic in summarise(tmp_path / "c1.mcap").topics}
    assert topics["/frame_decode/image"] == T and topics["/sample_assemble/image"] == 0


def test_time_never_runs_backwards(recording: Path) -> None:
    """(log time, topic) ascends through the whole file."""
    with open_recording(recording) as found:
        order = [(message.time_ns, message.topic) for message in found.messages]
    assert all(a <= b for a, b in pairwise(order))


def test_a_frame_without_a_time_is_refused(tmp_path: Path) -> None:
    """A value about frames that were not decoded cannot be recorded; the message names the frame."""
    made = outputs()
    few = replace(made["frame_decode"], frame=made["frame_decode"].frame + 100)
    with pytest.raises(ValueError, match="frame 1 was not decoded"):
        stage_record.run(made["mask_densify"], few, stage_record.Params("mask_densify"), Ctx(tmp_path))


def test_two_processes_make_the_same_bytes(recording: Path, tmp_path: Path) -> None:
    """Another process, another hash seed, another folder: the same content, and with the same libraries the same bytes."""
    code = "import sys, pathlib; from tests.helpers.made_recordings import recorded; print(recorded(pathlib.Path(sys.argv[1])))"
    for seed in ("0", "1"):
        run = subprocess.run([sys.executable, "-c", code, str(tmp_path / seed)], cwd=ROOT, text=True, check=True,
                             capture_output=True, env={**os.environ, "PYTHONHASHSEED": seed, "TZ": "Asia/Tokyo"})  # fmt: skip
        made = Path(run.stdout.strip())
        assert made.read_bytes() == recording.read_bytes() and difference(made, recording) == []


def test_content_does_not_depend_on_layout(recording: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Other chunks, other order of registration: another file with the same content."""
    monkeypatch.setattr("afford.recording.mcap_files.CHUNK_BYTES", 4096)
    with open_recording(recording) as found:
        write_recording(tmp_path / "small.mcap", replace(found, channels=found.channels[::-1]))
    small = tmp_path / "small.mcap"
    assert small.read_bytes() != recording.read_bytes() and difference(recording, small) == []


def test_a_difference_is_named(recording: Path, tmp_path: Path) -> None:
    """One changed payload: its topic and its time."""
    with open_recording(recording) as found:
        messages = list(found.messages)
        at = next(i for i, m in enumerate(messages) if m.topic == "/affordance/left" and m.time_ns == EPOCH_NS + 80_000_000)
        messages[at] = messages[at]._replace(data=messages[at].data + b"\x00")
        write_recording(tmp_path / "other.mcap", replace(found, messages=messages))
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
    with open_recording(tree.files[0].path) as found:
        kept = [m for m in found.messages if not (m.topic == "/mask_densify/mug" and m.time_ns > late)]
        messages = [m._replace(time_ns=m.time_ns + (m.topic == "/mask_densify/overlay")) for m in kept]
        write_recording(tmp_path / "bad.mcap", replace(found, messages=sorted(messages)))
    assert check_file(tmp_path / "bad.mcap") == []
    said = " ".join(check_content(tmp_path / "bad.mcap"))
    assert "timestamp, log time and publish time differ" in said and "do not have the same frames" in said


def test_parts_that_clash_are_refused(recording: Path, tmp_path: Path) -> None:
    """One topic in two parts, or one schema with two meanings, cannot be merged."""
    with pytest.raises(ValueError, match="got it twice"):
        merge_recordings([recording, recording], tmp_path / "twice.mcap", {})
    for n, definition in enumerate((b"one", b"two")):
        one = Recording((Channel(f"/t{n}", "s.S", definition),), [Message(EPOCH_NS, f"/t{n}", b"")])
        write_recording(tmp_path / f"{n}.mcap", one)
    with pytest.raises(ValueError, match=r"schema s\.S: expected one definition"):
        merge_recordings([tmp_path / "0.mcap", tmp_path / "1.mcap"], tmp_path / "clash.mcap", {})


def test_messages_out_of_order_are_refused(tmp_path: Path) -> None:
    """A recorder must go forward in time; nothing is left under the final name when it does not."""
    backwards = [Message(EPOCH_NS + 5, "/t", b""), Message(EPOCH_NS, "/t", b"")]
    with pytest.raises(ValueError, match="time order"):
        write_recording(tmp_path / "r.mcap", Recording((Channel("/t", "s.S", b"d"),), backwards))
    assert not (tmp_path / "r.mcap").exists()


def test_topic_words_are_unique() -> None:
    """Entities that differ only in what a topic cannot hold keep different topics."""
    names = [Entity(name, name, -1, "object", "") for name in ("cup:tea", "cup tea", "Cup/Tea", "", "杯")]
    assert len(set(slugs(names))) == len(names) and slugs(HANDS + MUG)[:4] == ["left_hand", "right_hand", "mug", "mug_2"]
