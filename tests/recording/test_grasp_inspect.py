"""`inspect` on a recording of grasps: its sheet, its file for Rerun, its layout for Foxglove; all by topics that are there."""

from __future__ import annotations

import json
import subprocess
import sys
from pathlib import Path

import cv2
import numpy as np
import pytest

from afford.common.drawing import GAP, TITLE_H
from afford.recording.foxglove_layout import IN_PANELS
from afford.recording.messages import MESSAGES
from afford.recording.strips import GRASP_MOMENTS, GRASP_SIDE
from afford.recording.summary import summarise
from pipeline import main
from stages.recording import grasp_record
from tests.helpers.made_hands import shadow
from tests.helpers.made_samples import Scratch
from tests.helpers.made_traces import episodes, hammer


@pytest.fixture(scope="module")
def recording(tmp_path_factory: pytest.TempPathFactory) -> Path:
    small = grasp_record.Params(width=96, height=72, supersample=1)
    made = grasp_record.run(shadow(), ((hammer(),),), episodes(), small, Scratch(tmp_path_factory.mktemp("recorded")))
    return made.files[0].path


def test_inspect_summarises_a_recording_of_grasps(recording: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """--strict finds no problem; the provenance is listed."""
    assert main(["inspect", str(recording), "--strict", "--json"]) == 0
    (told,) = json.loads(capsys.readouterr().out)["recordings"]
    assert told["ok"] and {"provenance/grasp_evaluate", "provenance/hand_model"} == set(told["metadata"])


def test_sheet_has_a_strip_for_each_episode(recording: Path, tmp_path: Path) -> None:
    """A title and a strip of moments; the hand moves from one to the next."""
    assert main(["inspect", str(recording), "--sheet", str(tmp_path / "sheet.png")]) == 0
    sheet = cv2.imread(str(tmp_path / "sheet.png")).astype(int)
    tall = TITLE_H + round(72 * GRASP_SIDE / 96) + GAP
    assert sheet.shape == (2 * tall, GRASP_MOMENTS * (GRASP_SIDE + GAP), 3)
    strip = sheet[TITLE_H : tall - GAP].reshape(tall - TITLE_H - GAP, GRASP_MOMENTS, GRASP_SIDE + GAP, 3)
    assert all(np.abs(strip[:, k] - strip[:, k + 1]).mean() > 0.5 for k in range(4))


def test_rerun_file_has_meshes_and_curves(recording: Path, tmp_path: Path) -> None:
    """--save: links and object with their transforms and meshes, the camera with its picture, curves, text."""
    out = tmp_path / "grasps.rrd"
    assert main(["inspect", str(recording), "--save", str(out)]) == 0
    from rerun.chunk import RrdReader

    found: dict[str, set[str]] = {}
    for chunk in RrdReader(out).stream():
        found.setdefault(str(chunk.entity_path), set()).update(chunk.to_record_batch().schema.names)
    for mesh in ("/world/hand/palm/mesh", "/world/hand/ffdistal/mesh", "/world/object/mesh"):
        assert "Mesh3D:vertex_positions" in found[mesh] and "Transform3D:translation" in found[mesh.removesuffix("/mesh")]
    assert {"Pinhole:image_from_camera", "EncodedImage:blob", "Transform3D:quaternion"} <= found["/world/camera"]
    assert {"/plots/how/goal_m", "/plots/force/thumb", "/plots/negative/rest", "/plots/reward/goal", "/log"} <= set(found)


def test_layout_has_3d_panel_and_curves(recording: Path, tmp_path: Path) -> None:
    """--layout: a 3D panel that shows the meshes, the picture, plots of message fields."""
    out = tmp_path / "layout.json"
    assert main(["inspect", str(recording), "--layout", str(out)]) == 0
    panels, topics = json.loads(out.read_text())["configById"], {topic.topic for topic in summarise(recording).topics}
    assert {"Image!grasp_evaluate_image", "3D!space", "Plot!grasp_evaluate_state", "Plot!grasp_evaluate_force"} <= set(panels)
    room = panels["3D!space"]["topics"]
    assert set(room) <= topics and [topic for topic, how in room.items() if how["visible"]] == ["/grasp_evaluate/scene"]
    assert all(MESSAGES[name.rpartition(".")[2]][number] == "double" for name, numbers in IN_PANELS.items() for number in numbers)


def test_rerun_reads_the_file_itself(recording: Path, tmp_path: Path) -> None:
    """Its own loader of MCAP: points hang on frames that transforms move, the camera has its pinhole."""
    rerun = Path(sys.executable).with_name("rerun")
    if not rerun.exists():
        pytest.skip("no rerun beside this python")
    out = tmp_path / "own.rrd"
    subprocess.run([rerun, "mcap", "convert", recording, "-o", out], check=True, capture_output=True)
    from rerun.chunk import RrdReader

    clouds, moved, pinholes = set[str](), set[str](), 0
    for chunk in RrdReader(out).stream():
        batch = chunk.to_record_batch()
        names = set(batch.schema.names)
        if "Points3D:positions" in names:
            clouds |= {name for names in batch["CoordinateFrame:frame"].to_pylist() for name in names}
        if "Transform3D:child_frame" in names:
            moved |= {name for names in batch["Transform3D:child_frame"].to_pylist() for name in names}
        pinholes += "Pinhole:image_from_camera" in names
    assert "object" in clouds and "hand/palm" in clouds and clouds <= moved and pinholes
