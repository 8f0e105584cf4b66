"""The verb `inspect`: summaries of recordings, their problems, and views of them."""

from __future__ import annotations

import json
import re
import subprocess
import sys
from pathlib import Path

import cv2
import pytest
from mcap.reader import make_reader

from afford.recording.foxglove_layout import CURVES, layout
from afford.recording.mcap_files import read_recording, write_recording
from afford.recording.messages import MESSAGES
from afford.recording.summary import Summary, Topic, summarise
from pipeline import main
from tests.helpers.command import call
from tests.helpers.made_recordings import T, recorded

ROOT = Path(__file__).resolve().parents[2]


@pytest.fixture(scope="module")
def recording(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return recorded(tmp_path_factory.mktemp("inspect"))


def last_json(capsys: pytest.CaptureFixture[str]) -> dict:
    """Last line of a command's output as JSON."""
    return json.loads(capsys.readouterr().out.splitlines()[-1])


def test_a_summary_counts_messages(recording: Path) -> None:
    """Messages, rates, times and bytes per topic, from the indexes alone, agree with the recording."""
    found = summarise(recording)
    topics = {topic.topic: topic for topic in found.topics}
    image = topics["/frame_decode/image"]
    assert (image.messages, image.start_s, image.end_s) == (T, 0.04, 0.24) and image.hz == pytest.approx(25)
    assert found.messages == sum(topic.messages for topic in found.topics) and not found.problem
    assert image.bytes > topics["/affordance/state"].bytes > 0


def test_a_summary_loads_nothing_heavy(recording: Path) -> None:
    """The terminal summary imports no viewer, no learning library and no picture library."""
    code = ("import sys; from pipeline import main; main(['inspect', sys.argv[1]]); "
            "heavy = 'rerun', 'torch', 'cv2', 'numpy', 'av', 'pydantic', 'runner.runner'; "
            "print([m for m in heavy if m in sys.modules])")  # fmt: skip
    run = subprocess.run([sys.executable, "-c", code, recording], cwd=ROOT, capture_output=True, text=True, check=True)
    assert run.stdout.splitlines()[-1] == "[]"
    assert "/affordance/left" in run.stdout and "provenance/mask_densify" in run.stdout and "no problem in the index" in run.stdout


def test_json_has_the_same_content(recording: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """One object, with every topic and the provenance."""
    assert main(["inspect", str(recording), "--json", "--strict"]) == 0
    result = last_json(capsys)
    (one,) = result["recordings"]
    assert result["ok"] and one["problems"] == [] and len(one["topics"]) > 20
    assert one["metadata"]["provenance/hand_inpaint"]["schema"] == "Inpainted"


def test_damage_makes_it_exit_1(recording: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """--strict: a flipped bit and a truncation are problems, in one recording or among many."""
    whole = recording.read_bytes()
    flipped = bytearray(whole)
    flipped[len(whole) // 2] ^= 1
    for name, data in {"flipped": bytes(flipped), "cut": whole[: len(whole) * 2 // 3], "empty": b"", "good": whole}.items():
        (tmp_path / f"{name}.mcap").write_bytes(data)
        assert main(["inspect", "--strict", str(tmp_path / f"{name}.mcap")]) == (0 if name == "good" else 1), name
    capsys.readouterr()
    assert main(["inspect", str(tmp_path), "--strict", "--json", "--sort", "problem"]) == 1
    assert {Path(r["path"]).stem: r["ok"] for r in last_json(capsys)["recordings"]} == {
        "cut": False, "empty": False, "flipped": False, "good": True}  # fmt: skip


def test_an_invalid_recording_is_reported_in_a_sentence(recording: Path, tmp_path: Path) -> None:
    """Too short, another format, cut short, damaged at its end, with and without --strict; no name of an exception."""
    whole = recording.read_bytes()
    broken = whole[:-200] + b"\xff" * 160 + whole[-40:]
    words = {"too short": b"", "another kind": b"a picture, say, of a kettle " * 9, "cut short": whole[:-100],
             "--strict says where": broken}  # fmt: skip
    for hint, data in words.items():
        (tmp_path / "a.mcap").write_bytes(data)
        problem = summarise(tmp_path / "a.mcap").problem
        assert hint in problem and not re.search("[a-z][A-Z]|Error|unpack|buffer", problem), problem
    for cut in range(16, len(whole) - 1, 997):
        (tmp_path / "a.mcap").write_bytes(whole[:cut])
        assert summarise(tmp_path / "a.mcap").problem.startswith("cut short")


def test_a_recording_that_cannot_be_opened_says_why(recording: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def refused(self: Path, *mode: str) -> None:
        raise PermissionError(13, "Permission denied")

    monkeypatch.setattr(Path, "open", refused)
    assert summarise(recording).problem == "cannot be read: Permission denied"


def test_a_folder_is_a_table(recording: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """One line per recording."""
    for name in ("a", "b"):
        (tmp_path / f"{name}.mcap").write_bytes(recording.read_bytes())
    assert main(["inspect", str(tmp_path), "--sort", "bytes"]) == 0
    result = capsys.readouterr().out
    assert str(tmp_path / "a.mcap") in result and str(tmp_path / "b.mcap") in result and "2 recordings" in result


def test_wrong_calls_exit_2(recording: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """A missing path, an empty folder, one recording to compare, two to view, an unknown order."""
    (tmp_path / "empty").mkdir()
    two = [str(recording), str(recording)]
    calls = [
        [str(tmp_path / "none.mcap"), str(recording)], [str(tmp_path / "empty")], ["--diff", str(recording)],
        [*two, "--save", str(tmp_path / "x.rrd")],
        [*two, "--layout", str(tmp_path / "x.json")], [*two, "--sort", "colour"],
        [two[0], "--sort", "colour"], ["--diff", *two, "--sort", "colour"], ["ffff", "--store", str(tmp_path / "s")],
    ]  # fmt: skip
    for arguments in calls:
        assert main(["inspect", *arguments]) == 2, arguments
        message = capsys.readouterr().err
        assert message.startswith("error: ") and message.count("\n") == 1


def test_differences_exit_1(recording: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """--diff: 0 for the same content; else 1, and the first topic and time that differ."""
    assert main(["inspect", "--diff", str(recording), str(recording)]) == 0
    assert "the same content" in capsys.readouterr().out
    other = recorded(tmp_path / "other", seed=1)
    assert main(["inspect", "--diff", str(recording), str(other)]) == 1
    result = capsys.readouterr().out
    assert "metadata provenance/frame_decode.artifact" in result and "first difference: /frame_decode/image at 0.040000 s" in result


def test_a_sheet_shows_every_column(recording: Path, tmp_path: Path) -> None:
    """--sheet: a picture with a row per moment, none of whose columns is empty."""
    assert main(["inspect", str(recording), "--sheet", str(tmp_path / "sheet.png")]) == 0
    sheet = cv2.imread(str(tmp_path / "sheet.png"))
    assert sheet is not None and sheet.shape[1] > 1500 and sheet.shape[0] > 228 * min(T, 8)
    for column in range(6):
        assert sheet[40:240, column * 308 + 4 : column * 308 + 240].std() > 5, column


def test_a_viewer_file_is_written(recording: Path, tmp_path: Path) -> None:
    """--save: Rerun reads the file back, with pictures, named masks, words, curves and a layout."""
    out = tmp_path / "clip.rrd"
    assert main(["inspect", str(recording), "--save", str(out)]) == 0
    from rerun.chunk import RrdReader

    paths = {str(chunk.entity_path) for chunk in RrdReader(out).stream()}
    assert {"/frame/image", "/frame/masks", "/clean/image", "/objects/masks", "/affordance/masks", "/task", "/log"} <= paths
    assert "/plots/confidence/left_hand" in paths and "/plots/sample/quality" in paths


def test_a_layout_shows_what_the_recording_has(recording: Path, tmp_path: Path) -> None:
    """--layout: every panel is placed once, every topic is shown, curves are numbers of their messages; the frame has outlines."""
    out = tmp_path / "layout.json"
    assert main(["inspect", str(recording), "--layout", str(out)]) == 0
    made, topics = json.loads(out.read_text()), {topic.topic for topic in summarise(recording).topics}
    assert sorted(placed(made["layout"])) == sorted(made["configById"])
    frame = made["configById"]["Image!frame_decode_image"]["imageMode"]
    assert frame == {"imageTopic": "/frame_decode/image", "annotations": {"/source_read/outlines": {"visible": True}}}
    assert {panel["imageMode"]["imageTopic"] for name, panel in made["configById"].items() if name.startswith("Image!")} <= topics
    curves = [path["value"].rsplit(".", 1) for path in made["configById"]["Plot!curves"]["paths"]]
    assert {topic for topic, _ in curves} <= topics and ["/affordance/state", "quality"] in curves
    assert all(MESSAGES[name.rpartition(".")[2]][number] == "double" for name, number in CURVES.items())


@pytest.mark.parametrize(("words", "result"), [
    (("--sheet", "{out}/s.png"), "--sheet: {path}: no pictures on /frame_decode/image"),
    (("--layout", "{out}/l.json"), "--layout: {path}: expected pictures, curves or words"),
    (("--sheet", "{out}/s.xyz"), "--sheet {out}/s.xyz: expected a name with one of the suffixes"),
    (("--sheet", "{out}/s"), "expected a name with one of the suffixes"),
    (("--sheet", "{out}/file/s.png"), "--sheet {out}/file/s.png: the file cannot be written"),
    (("--rerun",), "--rerun: no display, since neither DISPLAY nor WAYLAND_DISPLAY is set; write a file with "
                   "`--save made.rrd`, and open it in a browser with `{bin}/rerun made.rrd --web-viewer`"),
])  # fmt: skip
def test_an_impossible_view_is_refused_in_a_sentence(
    words: tuple[str, ...], result: str, recording: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch,
) -> None:
    """Exit 2, and no traceback."""
    for name in ("DISPLAY", "WAYLAND_DISPLAY"):
        monkeypatch.delenv(name, raising=False)
    (tmp_path / "file").touch()
    path = tmp_path / "made.mcap" if "{path}" in result or words[0] == "--rerun" else recording
    with recording.open("rb") as stream:
        outlines = read_recording(make_reader(stream), ("/source_read/outlines",))  # no view shows them alone
        write_recording(tmp_path / "made.mcap", outlines)
    refused = call("inspect", path, *(word.format(out=tmp_path) for word in words))
    assert refused.code == 2 and result.format(out=tmp_path, path=path, bin=Path(sys.executable).parent) in refused.words


def test_the_viewer_is_found_beside_python(recording: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Its environment need not be active."""
    import rerun

    opened: dict[str, object] = {}
    monkeypatch.setattr(rerun, "spawn", lambda **how: opened.update(how))
    monkeypatch.setenv("DISPLAY", ":0")
    monkeypatch.setenv("PATH", "/nowhere")
    assert call("inspect", recording, "--rerun").code == 0
    assert opened["executable_path"] == str(Path(sys.executable).parent / "rerun") and opened["recording"]


def test_pictures_alone_and_words_alone_are_laid_out() -> None:
    """Recordings of a training have one of them."""
    for schema, panel in (("foxglove.CompressedImage", "Image!previews"), ("affordance.v1.Document", "RawMessages!previews")):
        made = layout(Summary("x.mcap", 0, "", (Topic("/previews", schema, 1, 10, 0.0, 1.0, 1.0, 0.0),)))
        assert placed(made["layout"]) == [panel]


def placed(tree: str | dict) -> list[str]:
    """Panels of a layout."""
    return [tree] if isinstance(tree, str) else [*placed(tree["first"]), *placed(tree["second"])]


def test_a_recording_without_panels_is_refused() -> None:
    """One sentence with the content of the recording."""
    with pytest.raises(ValueError, match="expected pictures, curves or words to lay out, got no topic"):
        layout(Summary("x.mcap", 0, ""))
