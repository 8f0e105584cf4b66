"""Recorder of grasps, /grasp_evaluate/...: joints, links and object poses, forces, rewards, metrics, camera pictures.

Episodes follow each other, a second apart; row r of an episode is r / rate_hz after its start. Meshes are triangles in the frames
of links and object; the same shapes are also recorded as coloured points for viewers without triangles. The object is grey-blue,
ochre on the part to hold and red on negative parts.
"""

from __future__ import annotations

import json
from collections.abc import Iterator, Sequence

import numpy as np
from foxglove_schemas_protobuf.CameraCalibration_pb2 import CameraCalibration
from foxglove_schemas_protobuf.FrameTransforms_pb2 import FrameTransforms
from foxglove_schemas_protobuf.Log_pb2 import Log
from foxglove_schemas_protobuf.PointCloud_pb2 import PointCloud
from foxglove_schemas_protobuf.PoseInFrame_pb2 import PoseInFrame
from foxglove_schemas_protobuf.SceneUpdate_pb2 import SceneUpdate

from afford.common.geometry import sample_surface
from afford.common.image_files import jpeg
from afford.common.palette import Colour
from afford.grasping.env.rendering import (
    GOAL,
    NEGATIVE,
    DrawableEpisode,
    camera_of,
    colour_of,
    goal_ring,
    hand_colour,
    hull_pieces,
    pose_matrix,
)
from afford.grasping.evaluate.trace_metrics import TraceMetrics, trace_metrics
from afford.grasping.hand.kinematics import forward_kinematics, moving_joints
from afford.grasping.hand.link_meshes import LinkMesh, link_meshes
from afford.recording.mcap_files import EPOCH_NS, Channel, Message, Recording
from afford.recording.messages import (
    CAMERA,
    SECOND_NS,
    Document,
    GraspForce,
    GraspState,
    Scalar,
    channel,
    image,
    image_channel,
    log,
    stamped,
)
from afford.recording.spatial import WORLD, calibration, cloud, entity, loop, pose, scene, transforms, triangles
from afford.recording.trainings import Preview, record_training, step_time_ns
from schemas.episodes import GraspEpisodes, GraspTrace
from schemas.hand import FINGERS, HandModel
from schemas.training import TrainingLog

GRASPS = "/grasp_evaluate"
IMAGE, LENS, TRANSFORMS, SCENE = f"{GRASPS}/image", f"{GRASPS}/calibration", f"{GRASPS}/transforms", f"{GRASPS}/scene"
PALM, OBJECT, STATE, FORCE = f"{GRASPS}/palm", f"{GRASPS}/object", f"{GRASPS}/state", f"{GRASPS}/force"
POINTS, N_T, FIGURES, LOG = f"{GRASPS}/points/object", f"{GRASPS}/points/N_t", f"{GRASPS}/figures", f"{GRASPS}/log"
OBJECT_FRAME = "object"
"""frame_id of the object"""
GAP_NS = SECOND_NS
SPACING_M = 0.003
"""distance of points of the hand"""


def record_grasps(found: GraspEpisodes, episodes: Sequence[DrawableEpisode], hand: HandModel, seed: int) -> Recording:
    """Record the traces of `found` in their order; `seed` samples points on the hand.

    ValueError for a trace of another hand.
    """
    for one in episodes:
        _fits(one.trace, hand)
    return Recording(_channels(episodes, hand), _messages(found, episodes, hand, seed))


def times(trace: GraspTrace, start_ns: int) -> list[int]:
    """Log times of the rows of an episode."""
    return [start_ns + round(row * SECOND_NS / trace.rate_hz) for row in range(len(trace.q))]


def _fits(trace: GraspTrace, hand: HandModel) -> None:
    joints, fingers = len(moving_joints(hand.joints)), len(hand.fingers.name)
    if trace.q.shape[1] != joints or trace.force.shape[1] != fingers + 1:
        raise ValueError(f"trace {trace.name}: expected {joints} joints and {fingers + 1} forces of the hand {hand.name}, got "
                         f"{trace.q.shape[1]} and {trace.force.shape[1]}; give the hand that was evaluated")


def _channels(episodes: Sequence[DrawableEpisode], hand: HandModel) -> tuple[Channel, ...]:
    kinds = {TRANSFORMS: FrameTransforms, SCENE: SceneUpdate, PALM: PoseInFrame, OBJECT: PoseInFrame, STATE: GraspState,
             FORCE: GraspForce, LENS: CameraCalibration, POINTS: PointCloud, N_T: PointCloud, FIGURES: Document,
             LOG: Log}  # fmt: skip
    kinds |= {_points(hand, skin): PointCloud for skin in link_meshes(hand)}
    kinds |= {_joint(name): Scalar for name in _joints(hand)}
    kinds |= {_reward(name): Scalar for one in episodes for name in one.trace.terms}
    return (image_channel(IMAGE), *(channel(topic, kind) for topic, kind in kinds.items()))


def _messages(found: GraspEpisodes, episodes: Sequence[DrawableEpisode], hand: HandModel, seed: int) -> Iterator[Message]:
    start, colour = EPOCH_NS, hand_colour(hand)
    yield stamped(FIGURES, start, Document(name=found.name, media_type="application/json", text=_figures(found)))
    yield from _hand(hand, colour, start, seed)
    for one in episodes:
        rows = times(one.trace, start)
        yield from _begin(one, hand, start)
        yield from _rows(one, hand, rows)
        start = rows[-1] + GAP_NS


def _hand(hand: HandModel, colour: Colour, time_ns: int, seed: int) -> Iterator[Message]:
    """Meshes and points of the links, recorded once because links are rigid."""
    found, rng = link_meshes(hand), np.random.default_rng(seed)
    yield scene(SCENE, time_ns, [entity(_frame(hand, skin.link), _frame(hand, skin.link),
                                        [triangles(skin.vertices, skin.faces, colour)]) for skin in found])  # fmt: skip
    for skin in found:
        a, b, c = skin.vertices[skin.faces].swapaxes(0, 1)
        area = np.linalg.norm(np.cross(b - a, c - a), axis=1) / 2
        points, _ = sample_surface(skin.vertices, skin.faces, area, int(np.ceil(area.sum() / SPACING_M**2)), rng)
        yield cloud(_points(hand, skin), time_ns, _frame(hand, skin.link), points, _rgba([colour] * len(points)))


def _begin(one: DrawableEpisode, hand: HandModel, time_ns: int) -> Iterator[Message]:
    """Object, goal and text at the start of an episode."""
    task, trace = one.task, one.trace
    meshes = [triangles(piece.vertices, piece.faces, colour_of(task, piece.part)) for piece in hull_pieces(task.body)]
    goal = entity("goal", WORLD, lines=[loop(goal_ring(trace.goal), GOAL)])
    yield scene(SCENE, time_ns, [entity(OBJECT_FRAME, OBJECT_FRAME, meshes), goal])
    colours = _rgba([colour_of(task, part) for part in task.body.point_part.tolist()])
    yield cloud(POINTS, time_ns, OBJECT_FRAME, task.body.points, colours)
    yield cloud(N_T, time_ns, OBJECT_FRAME, task.N_t, _rgba([NEGATIVE] * len(task.N_t)))
    bad = ", ".join(task.negative) or "nothing"
    yield log(LOG, time_ns, f"{trace.name}: {task.use or 'any use'}; hold {task.hold or 'anything'}, not {bad}", task.name)


def _rows(one: DrawableEpisode, hand: HandModel, rows: Sequence[int]) -> Iterator[Message]:
    trace, metrics, T = one.trace, trace_metrics(one.trace, one.task), forward_kinematics(hand.joints, one.trace.q)
    height, width = one.draw(0).shape[:2]
    camera = camera_of(trace, hand, width, height)
    for row, time_ns in enumerate(rows):
        frames = {_frame(hand, link): T[row, link] for link in range(len(hand.links))}
        yield transforms(TRANSFORMS, time_ns, {**frames, OBJECT_FRAME: pose_matrix(trace.body[row]), CAMERA: camera.T_world_cam})
        yield calibration(LENS, time_ns, CAMERA, camera.K, camera.width, camera.height)
        yield image(IMAGE, time_ns, jpeg(one.draw(row)), "jpeg")
        yield pose(PALM, time_ns, trace.palm[row])
        yield pose(OBJECT, time_ns, trace.body[row])
        yield from _numbers(trace, metrics, hand, row, time_ns)


def _numbers(trace: GraspTrace, metrics: TraceMetrics, hand: HandModel, row: int, time_ns: int) -> Iterator[Message]:
    yield stamped(STATE, time_ns, GraspState(
        step=row, goal_m=metrics.goal_m[row], height_m=metrics.centre[row, 2], success=bool(metrics.success[row]),
        as_violation_pct=metrics.as_violation_pct[row], as_safe_count=metrics.as_safe_count[row],
        penetration_mm=1000 * trace.penetration_m[row], reward=trace.reward[row].sum()))  # fmt: skip
    yield stamped(FORCE, time_ns, GraspForce(step=row, **_forces(trace, hand, row)))
    for name, value in zip(_joints(hand), trace.q[row].tolist(), strict=True):
        yield stamped(_joint(name), time_ns, Scalar(step=row, value=value))
    for name, value in zip(trace.terms, trace.reward[row].tolist(), strict=True):
        yield stamped(_reward(name), time_ns, Scalar(step=row, value=value))


def _forces(trace: GraspTrace, hand: HandModel, row: int) -> dict[str, float]:
    """Newtons by source; a finger that the hand lacks has 0."""
    names = [name for name in FINGERS if name in hand.fingers.name]
    both = (("", trace.force[row]), ("_negative", trace.force_negative[row]))
    return {f"{name}{what}_n": float(value) for what, values in both for name, value in zip((*names, "rest"), values, strict=True)}


def _figures(found: GraspEpisodes) -> str:
    """Figures of every episode; NaN is null."""
    rows = [{"task": task, **{name: None if np.isnan(value) else value for name, value in zip(found.figures, row, strict=True)}}
            for task, row in zip(found.task, found.values.tolist(), strict=True)]  # fmt: skip
    about = {name: getattr(found, name) for name in ("policy", "level", "engine", "seed")}
    return json.dumps({**about, "episodes": rows}, sort_keys=True, allow_nan=False)


def _joints(hand: HandModel) -> list[str]:
    return [hand.joints.name[k] for k in moving_joints(hand.joints)]


def _joint(name: str) -> str:
    return f"{GRASPS}/joints/{name}"


def _reward(name: str) -> str:
    return f"{GRASPS}/reward/{name}"


def _points(hand: HandModel, skin: LinkMesh) -> str:
    return f"{GRASPS}/points/{hand.links[skin.link]}"


def _frame(hand: HandModel, link: int) -> str:
    """frame_id of a link."""
    return f"hand/{hand.links[link]}"


def _rgba(colours: Sequence[Colour]) -> np.ndarray:
    """(n, 4) uint8, opaque."""
    return np.insert(np.array(colours, np.uint8).reshape(-1, 3), 3, 255, axis=1)


POLICY_GAP_NS = SECOND_NS // 2
"""time between the last step and the first episode, and between episodes"""


def record_policy(curves: TrainingLog, stage: str, episodes: Sequence[DrawableEpisode]) -> Recording:
    """Record a training of the stage `stage` and, after its last step, episodes of the policy."""
    return record_training(curves, stage, _episode_pictures(curves, episodes))


def _episode_pictures(curves: TrainingLog, episodes: Sequence[DrawableEpisode]) -> Iterator[Preview]:
    start = step_time_ns(curves.steps) + POLICY_GAP_NS
    for one in episodes:
        rows = times(one.trace, start)
        for row, time_ns in enumerate(rows):
            yield Preview(time_ns, jpeg(one.draw(row)), _episode_text(one) if row == 0 else "")
        start = rows[-1] + POLICY_GAP_NS


def _episode_text(one: DrawableEpisode) -> str:
    """Task and outcome of an episode."""
    metrics = trace_metrics(one.trace, one.task)
    bad = ", ".join(one.task.negative) or "nothing"
    end = "reached the goal" if metrics.success[-1] else "never at the goal"
    return f"{one.task.name}: {one.task.use or 'any use'}; hold {one.task.hold or 'anything'}, not {bad}; {end}"
