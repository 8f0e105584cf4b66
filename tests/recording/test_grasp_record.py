"""The recording of grasps: whole, the numbers of the traces, the object's points where the trace has them."""

from __future__ import annotations

import json
import subprocess
import sys
from dataclasses import replace
from pathlib import Path
from typing import Any

import av
import cv2
import numpy as np
import pytest
from mcap.reader import make_reader
from mcap_protobuf.decoder import DecoderFactory

from afford.grasping.env.measures import nearest
from afford.grasping.env.rendering import pose_matrix
from afford.grasping.hand.link_meshes import link_meshes
from afford.recording.check_content import check_content
from afford.recording.check_file import check_file
from afford.recording.grasps import FIGURES, FORCE, GRASPS, IMAGE, LENS, OBJECT, PALM, POINTS, SCENE, STATE, TRANSFORMS
from afford.recording.mcap_files import EPOCH_NS
from afford.recording.spatial import POINT
from schemas.files import FileTree
from stages.recording import grasp_record
from tests.helpers.made_hands import PINCER, hand_of, shadow, written
from tests.helpers.made_samples import Scratch
from tests.helpers.made_traces import episodes, hammer

SMALL = grasp_record.Params(width=96, height=72, supersample=1, columns=2)
STEP_NS, ROW = 200_000_000, 5


@pytest.fixture(scope="module")
def files(tmp_path_factory: pytest.TempPathFactory) -> FileTree:
    return grasp_record.run(shadow(), ((hammer(),),), episodes(), SMALL, Scratch(tmp_path_factory.mktemp("recorded")))


@pytest.fixture(scope="module")
def said(files: FileTree) -> dict[str, list[tuple[int, Any]]]:
    """Topic -> (media time in ns, message)."""
    found: dict[str, list[tuple[int, Any]]] = {}
    with files.files[0].path.open("rb") as stream:
        for _, channel, message, value in make_reader(stream, decoder_factories=[DecoderFactory()]).iter_decoded_messages():
            found.setdefault(channel.topic, []).append((message.log_time - EPOCH_NS, value))
    return found


def test_recording_is_intact(files: FileTree) -> None:
    """No problem found by `inspect --strict` and Rerun."""
    assert [file.name for file in files.files] == [f"script-train-mujoco.{kind}" for kind in ("mcap", "mp4", "png")]
    recorded = files.files[0].path
    assert check_file(recorded) == [] and check_content(recorded) == []
    rerun = Path(sys.executable).with_name("rerun")
    if rerun.exists():
        done = subprocess.run([rerun, "mcap", "check", recorded], capture_output=True, text=True, check=False)
        assert done.returncode == 0, done.stdout + done.stderr


def test_the_numbers_are_those_of_the_traces(said: dict[str, list[tuple[int, Any]]]) -> None:
    """Joints, poses, forces and rewards of every row of every episode, to the last digit; episodes a second apart."""
    hand, traces = shadow(), episodes().traces
    rows = len(traces[0].q)
    when = [time for time, _ in said[STATE]]
    assert when == [k * STEP_NS for k in range(rows)] + [(rows - 1) * STEP_NS + 10**9 + k * STEP_NS for k in range(rows)]
    names = [name for name, kind in zip(hand.joints.name, hand.joints.kind, strict=True) if kind != "fixed"]
    joints = np.array([[value.value for _, value in said[f"{GRASPS}/joints/{name}"]] for name in names]).T
    assert np.array_equal(joints, np.concatenate([trace.q for trace in traces]))
    for topic, field in ((PALM, "palm"), (OBJECT, "body")):
        poses = np.array([_pose(value.pose) for _, value in said[topic]])
        assert np.array_equal(poses, np.concatenate([getattr(trace, field) for trace in traces]))
    for term, name in enumerate(traces[0].terms):
        values = [value.value for _, value in said[f"{GRASPS}/reward/{name}"]]
        assert values == [x for trace in traces for x in trace.reward[:, term].tolist()]
    fingers = [*hand.fingers.name, "rest"]
    force = np.array([[getattr(value, f"{name}_n") for name in fingers] for _, value in said[FORCE]])
    assert np.array_equal(force, np.concatenate([trace.force for trace in traces]))
    assert said[STATE][-1][1].penetration_mm == 1000 * traces[-1].penetration_m[-1]


def test_figures_cover_all_episodes(said: dict[str, list[tuple[int, Any]]]) -> None:
    """JSON, with the name of each figure."""
    told, found = json.loads(said[FIGURES][0][1].text), episodes()
    assert told["policy"] == "script" and [one["task"] for one in told["episodes"]] == list(found.task)
    assert [one["goal_m"] for one in told["episodes"]] == found.figure("goal_m").tolist()


def test_transforms_put_points_where_the_trace_has_them(said: dict[str, list[tuple[int, Any]]]) -> None:
    """The object's cloud, moved by its frame, is its points at the trace's pose; fingertips are near the cloud of their link."""
    trace, hand = episodes().traces[0], shadow()
    frames = {one.child_frame_id: _matrix(one) for one in said[TRANSFORMS][ROW][1].transforms}
    cloud = np.frombuffer(said[POINTS][0][1].data, POINT)
    assert said[POINTS][0][1].frame_id == "object" and len(cloud) == len(hammer().body.points)
    moved = cloud["xyz"] @ frames["object"][:3, :3].T + frames["object"][:3, 3]
    centre = np.append(hammer().body.com_m, 1)
    assert np.linalg.norm(moved.mean(axis=0) - (frames["object"] @ centre)[:3]) < 0.1
    red = np.isin(hammer().body.point_part, [hammer().body.parts.index(part) for part in hammer().negative])
    assert np.array_equal(cloud["rgba"][:, 0] > 2 * cloud["rgba"][:, 1].astype(int), red)
    assert np.allclose(frames["object"][:3, 3], trace.body[ROW, :3], atol=1e-12)
    tips = zip(hand.fingers.tip_link.tolist(), trace.tips[ROW], strict=True)
    for link, tip in tips:
        (_, message), = said[f"{GRASPS}/points/{hand.links[link]}"]
        T, spots = frames[message.frame_id], np.frombuffer(message.data, POINT)["xyz"].astype(float)
        assert nearest(tip[None, None], (spots @ T[:3, :3].T + T[:3, 3])[None])[0].item() < 0.013


def test_meshes_are_in_their_frames(said: dict[str, list[tuple[int, Any]]]) -> None:
    """Links with a shape, then object and goal again with each episode; the object's triangles by part."""
    hand, scenes = shadow(), [value for _, value in said[SCENE]]
    assert [one.id for one in scenes[0].entities] == [f"hand/{hand.links[skin.link]}" for skin in link_meshes(hand)]
    assert [[one.id for one in value.entities] for value in scenes[1:]] == [["object", "goal"]] * 2
    thing = scenes[1].entities[0]
    assert thing.frame_id == "object" and thing.frame_locked and len(thing.triangles) == len(hammer().body.hull_part)
    corners = np.array([(p.x, p.y, p.z) for p in thing.triangles[0].points])
    assert np.array_equal(corners, hammer().body.hulls()[0])


def test_pictures_have_their_camera(said: dict[str, list[tuple[int, Any]]]) -> None:
    """One picture and one calibration a row; the goal is in the middle third of what the camera sees."""
    assert len(said[IMAGE]) == len(said[LENS]) == sum(len(trace.q) for trace in episodes().traces)
    picture = cv2.imdecode(np.frombuffer(said[IMAGE][0][1].data, np.uint8), cv2.IMREAD_COLOR)
    assert picture.shape == (72, 96, 3)
    K = np.array(said[LENS][0][1].K).reshape(3, 3)
    camera = next(_matrix(one) for one in said[TRANSFORMS][0][1].transforms if one.child_frame_id == "camera")
    x, y, z = K @ (np.linalg.inv(camera) @ np.append(episodes().traces[0].goal, 1))[:3]
    assert z > 0 and 32 < x / z < 64 and 0 < y / z < 36


def test_film_and_sheet(files: FileTree) -> None:
    """Two episodes side by side; the last picture stays; the sheet has titles and five moments of each."""
    with av.open(str(files.files[1].path)) as film:
        frames = list(film.decode(video=0))
    assert len(frames) == len(episodes().traces[0].q) + 4 and (frames[0].width, frames[0].height) == (192, 72)
    sheet = cv2.imread(str(files.files[2].path))
    assert sheet.shape == (30 + 2 * 76, 190 + 5 * 100, 3) and sheet[30:, :190].std() > 10


def test_recording_is_deterministic(files: FileTree, tmp_path: Path) -> None:
    """The same bytes, all three files."""
    again = grasp_record.run(shadow(), ((hammer(),),), episodes(), SMALL, Scratch(tmp_path))
    assert [file.digest for file in again.files] == [file.digest for file in files.files]


def test_mismatched_inputs_are_refused(tmp_path: Path) -> None:
    """No trace, no task, another hand."""
    found, ctx = episodes(), Scratch(tmp_path)
    with pytest.raises(ValueError, match="expected traces of the tasks that are given, got no trace"):
        grasp_record.run(shadow(), ((hammer(),),), replace(found, traces=()), SMALL, ctx)
    with pytest.raises(ValueError, match="got task hammer/drive a nail"):
        grasp_record.run(shadow(), (), found, SMALL, ctx)
    with pytest.raises(ValueError, match="expected 9 joints and 3 forces of the hand"):
        grasp_record.run(hand_of(written(tmp_path, PINCER)), ((hammer(),),), found, SMALL, ctx)


def _pose(found: Any) -> list[float]:
    p, q = found.position, found.orientation
    return [p.x, p.y, p.z, q.x, q.y, q.z, q.w]


def _matrix(one: Any) -> np.ndarray:
    t, q = one.translation, one.rotation
    return pose_matrix(np.array([t.x, t.y, t.z, q.x, q.y, q.z, q.w]))
