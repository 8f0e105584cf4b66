"""Origin of a run's data, and its name."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest

from commands.errors import UsageError
from commands.origin import OWN_ROOMS, origin
from maps.settings import Origin, Settings
from pipeline import build
from schemas.files import FileTree
from stages.grasping import motion_read


@pytest.mark.parametrize("target", ["grasp-full", "grasp-play"])
def test_grasping_reads_no_source(target: str, tmp_path: Path) -> None:
    """Its objects are built in: a folder would only name the run."""
    with pytest.raises(UsageError, match=f"--source .*{target} .*reads no source"):
        origin(target, tmp_path, Settings(), lambda path: "")


def test_targets_do_not_overwrite_what_others_publish() -> None:
    """Targets with their own data have distinct names, which differ from that of the rendered clips."""
    names = {target: origin(target, None, Settings(), lambda path: "")[0].name for target in ("grasp", "grasp-full", "dataset")}
    assert names == {"grasp": "grasp", "grasp-full": "grasp-full", "dataset": "synthetic"}
    assert len(set(OWN_ROOMS.values())) == len(OWN_ROOMS)


@pytest.mark.parametrize("target", ["grasp-full", "grasp-play"])
def test_trainings_do_not_depend_on_the_name_of_the_run(target: str) -> None:
    """A training under another name is cached: no stage, parameter or leaf contains the name."""
    one, other = (build(target, Origin(name), Settings()).nodes for name in ("synthetic", target))
    shown = [[(node.sort, node.name, node.inputs, node.value, node.params) for node in nodes] for nodes in (one, other)]
    assert shown[0] == shown[1]


def motion_origin(source: Path, **settings: Any) -> Origin:
    """Origin of `run motions` with landmark networks."""
    networks = (("hand_landmarks", FileTree("networks", ())),)
    return origin("motions", source, replace(Settings.of(**settings), weights=networks), lambda path: "")[0]


@pytest.fixture
def video(tmp_path: Path) -> Path:
    """A folder with a video alone; its content is not read."""
    (tmp_path / "film.mp4").write_bytes(b"a")
    return tmp_path


def test_motions_of_a_folder_with_a_video_are_those_of_its_hands(video: Path) -> None:
    """The graph detects hands, publishes keypoint files and retargets."""
    found = motion_origin(video)
    assert found.bare and [one.files.name for one in found.videos] == ["film"]
    graph = build("motions", found, replace(Settings(), weights=(("hand_landmarks", FileTree("networks", ())),)))
    names = {node.name for node in graph.stages()}
    assert {"hand_landmarks", "hand_detect", "hand_motion", "keypoint_files", "motion_retarget"} <= names
    assert "motion_read" not in names and "hands_train" not in names
    assert {one.place for one in graph.published} >= {"keypoints/{source}", "motions/{source}"}


def test_motions_of_a_folder_with_keypoints_are_read(tmp_path: Path) -> None:
    """A picture beside them does not make them a video."""
    for name in ("a.npz", "preview.png", "remarks.txt"):
        (tmp_path / name).write_bytes(b"a")
    found = motion_origin(tmp_path)
    assert not found.videos and found.motions is not None and len(found.motions.files) == 3


def test_motions_of_an_ambiguous_source_are_refused(video: Path, tmp_path: Path) -> None:
    with pytest.raises(UsageError, match="is a video file; give the folder"):
        motion_origin(video / "film.mp4")
    with pytest.raises(UsageError, match="needs the landmark networks"):
        origin("motions", video, Settings(), lambda path: "")
    (tmp_path / "clip.npz").write_bytes(b"a")
    with pytest.raises(UsageError, match=r"both video and hand motion \(clip.npz\); put them into two folders"):
        motion_origin(video)
    assert motion_origin(video, motion_read=motion_read.Params(backend="oakink2")).motions is not None
