"""The verb `check`: shows how `run` would read a source, refuses the same input, and writes nothing."""

from __future__ import annotations

import json
import os
from pathlib import Path
from typing import Any

import pytest

from afford.extraction.sources.discover import discover
from stages.extraction import source_read
from tests.extraction.test_own_video import coco, compressed, read_own
from tests.helpers import made_epic
from tests.helpers.command import call
from tests.helpers.mesh_files import box
from tests.helpers.tiny_root import digest, image, mask, write_root, write_video


def own(folder: Path, **more: Any) -> Path:
    """A user's video with masks and a narration."""
    folder.mkdir(parents=True, exist_ok=True)
    read_own(folder, coco(compressed(), **more))
    return folder


def checked(folder: Path, code: int = 0) -> dict[str, Any]:
    """Output of `check --json`."""
    result = call("check", folder, "--json")
    assert result.code == code, result.words
    found: dict[str, Any] = result.json
    return found


def test_the_report_agrees_with_the_reader(tmp_path: Path) -> None:
    """Clips, frames, masks by category, contacts, narrations and warnings are those of source_read."""
    root = own(tmp_path / "mine", in_contact_object="bogus")
    (clip,) = source_read.run(discover(root, digest).videos[0], source_read.Params())
    found = checked(root)
    (video,) = found["videos"]
    assert (found["kind"], found["ok"], video["size"], video["grids"]) == ("own", True, [128, 64], [[128, 64]])
    assert video["clips"] == [{"clip": clip.clip_id, "first_frame": 1, "last_frame": 26, "key_frames": [1, 16]}]
    assert video["categories"] == [
        {"name": "left_hand", "role": "left hand", "masks": 2}, {"name": "mug", "role": "object", "masks": 2}]  # fmt: skip
    assert video["contacts"] == {"left hand": {"inconclusive": 2}}
    assert clip.warnings and video["warnings"] == list(clip.warnings)
    assert [(n["verb"], n["noun"], n["start_frame"]) for n in video["narrations"]] == [("pick-up", "mug:red", 1)]


def test_the_plain_text_has_warnings_and_refusals(tmp_path: Path) -> None:
    """One line each."""
    result = call("check", own(tmp_path / "mine", in_contact_object="bogus"))
    assert result.code == 0 and "left_hand 2 (left hand); mug 2 (object)" in result.words
    assert "touches 'bogus', which is no mask of this frame" in result.words and "1 usable, 0 refused, 2 warning(s)" in result.words


def test_a_check_writes_and_hashes_nothing(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """The source and its neighbours are unchanged."""
    root = own(tmp_path / "mine")
    monkeypatch.chdir(tmp_path)
    before = {path: path.stat().st_mtime_ns for path in tmp_path.rglob("*")}
    checked(root)
    assert {path: path.stat().st_mtime_ns for path in tmp_path.rglob("*")} == before


def test_one_refused_video_is_exit_1_and_the_others_are_shown(tmp_path: Path) -> None:
    """The sentence is that of a failing run."""
    write_root(tmp_path, "P95_01")
    write_root(tmp_path, "P95_02", points=[image("P95_02", 1, [mask("hand", "h")])])
    found = checked(tmp_path, code=1)
    assert [video["video"] for video in found["videos"] if not video["refusal"]] == ["P95_01"] and not found["ok"]
    assert [one["name"] for one in found["refused"]] == ["P95_02"] and "'left hand'" in found["refused"][0]["reason"]


def test_a_folder_that_is_no_source_is_refused_and_a_wrong_call_is_exit_2(tmp_path: Path) -> None:
    """Two videos, a missing folder, an unknown clip."""
    write_video(tmp_path / "two" / "a.mp4", 3)
    write_video(tmp_path / "two" / "b.mp4", 3)
    assert "exactly one video" in checked(tmp_path / "two", code=1)["refused"][0]["reason"]
    assert call("check", tmp_path / "none").code == 2
    wrong = call("check", own(tmp_path / "mine"), "--clip", "yours")
    assert wrong.code == 2 and "unknown clip 'yours'" in wrong.err


def test_videos_without_masks_and_packs_are_understood(tmp_path: Path) -> None:
    """The kinds of source that `run dataset --source` accepts."""
    write_video(tmp_path / "bare" / "a.mp4", 12)
    made_epic.write_tables(tmp_path / "tar")
    made_epic.write_tar(tmp_path / "tar")
    assert checked(tmp_path / "bare")["kind"] == "bare" and "hands are looked for" in call("check", tmp_path / "bare").words
    (video,) = checked(tmp_path / "tar")["videos"]
    assert (video["frames"], video["size"]) == (40, [128, 64])


def test_masks_of_another_shape_than_the_pictures_are_remarked_on(tmp_path: Path) -> None:
    """A stated size that differs from the video's stretches the masks."""
    document = coco([[5, 5, 25, 5, 25, 25]])
    for one in document["images"]:
        one["height"] = 96
    (tmp_path / "mine").mkdir()
    read_own(tmp_path / "mine", document)
    assert any("128x96 against 128x64" in text for text in checked(tmp_path / "mine")["videos"][0]["warnings"])


def test_parameters_of_the_reader_count(tmp_path: Path) -> None:
    """`--set` cuts the video as a run would."""
    result = call("check", own(tmp_path / "mine"), "--json", "--set", "source_read.max_gap_s=0.1")
    assert result.code == 0 and len(result.json["videos"][0]["clips"]) == 2


def test_meshes_are_listed(tmp_path: Path) -> None:
    """Sizes of each object; a broken one is refused alone."""
    box().export(tmp_path / "cube.obj")
    assert [mesh["object"] for mesh in checked(tmp_path)["meshes"]] == ["cube"]
    (tmp_path / "broken.obj").write_text("v 0 0 0\nf 1 2 3\n")
    found = checked(tmp_path, code=1)
    assert [mesh["object"] for mesh in found["meshes"]] == ["cube"] and found["refused"][0]["name"] == "broken"


def test_a_pipe_in_the_folder_does_not_stop_it(tmp_path: Path) -> None:
    """The pipe is refused instead of read."""
    root = own(tmp_path / "mine")
    (root / "My clip ü.mp4").unlink()
    os.mkfifo(root / "My clip ü.mp4")
    assert "expected a file, got a named pipe" in checked(root, code=1)["refused"][0]["reason"]
    assert json.dumps(checked(root, code=1))
