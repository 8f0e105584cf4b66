"""Recorder of human hand motions, /<stage>/..., and of their retargeting to a robot hand, /hand_retarget/...

Clips follow each other, a second apart, each at its own rate. The person's keypoints are in the frame `source`, the world of the
motion data; links of the robot hand are in `world`, where retargeting has placed `source`. A dropped clip shows the person only.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import NamedTuple

import numpy as np
from foxglove_schemas_protobuf.FrameTransforms_pb2 import FrameTransforms
from foxglove_schemas_protobuf.Log_pb2 import Log
from foxglove_schemas_protobuf.PointCloud_pb2 import PointCloud
from foxglove_schemas_protobuf.PoseInFrame_pb2 import PoseInFrame
from foxglove_schemas_protobuf.SceneUpdate_pb2 import SceneUpdate

from afford.common.image_files import jpeg
from afford.grasping.env.rendering import CHAINS, PERSON, MotionRenderer, hand_colour, placed_keypoints
from afford.grasping.hand.kinematics import forward_kinematics
from afford.grasping.hand.link_meshes import link_meshes
from afford.recording.mcap_files import EPOCH_NS, Channel, Message, Recording
from afford.recording.messages import SECOND_NS, Scalar, channel, image, image_channel, log, stamped
from afford.recording.spatial import cloud, entity, loop, pose, scene, transforms, triangles
from schemas.hand import PHASES, HandModel, HandMotion, HandReference, Retargeted

RETARGETED = "/hand_retarget"
IMAGE, TRANSFORMS, SCENE, LOG = f"{RETARGETED}/image", f"{RETARGETED}/transforms", f"{RETARGETED}/scene", f"{RETARGETED}/log"
ERROR, BONES = f"{RETARGETED}/error_mm", f"{RETARGETED}/bone_error_deg"
SOURCE = "source"
"""frame_id of the person's motion: the world of the motion data"""
GAP_NS = SECOND_NS


class MotionClip(NamedTuple):
    """A motion and its retargeting."""

    motion: HandMotion
    fitted: Retargeted


def record_motions(stage: str, clips: Sequence[MotionClip], studio: MotionRenderer, pictures_hz: float) -> Recording:
    """Record the clips in their order; `stage` produced the motions, `pictures_hz` is the maximum rate of pictures."""
    kinds = {TRANSFORMS: FrameTransforms, SCENE: SceneUpdate, LOG: Log, ERROR: Scalar, BONES: Scalar,
             f"/{stage}/keypoints": PointCloud, f"/{stage}/bones": SceneUpdate, f"/{stage}/log": Log}  # fmt: skip
    if any(len(clip.motion.object_pose) for clip in clips):
        kinds[f"/{stage}/object"] = PoseInFrame
    channels: list[Channel] = [channel(topic, kind) for topic, kind in kinds.items()]
    pictures = [image_channel(IMAGE)] if any(clip.fitted.references for clip in clips) else []
    return Recording((*channels, *pictures), _messages(stage, clips, studio, pictures_hz))


def _messages(stage: str, clips: Sequence[MotionClip], studio: MotionRenderer, pictures_hz: float) -> Iterator[Message]:
    yield _links(studio.hand)
    start = EPOCH_NS
    for clip in clips:
        found = list(_person(stage, clip.motion, start)) + [_verdict(clip, start)]
        for reference in clip.fitted.references:
            found += _robot(clip.motion, reference, studio, pictures_hz, start)
        yield from sorted(found, key=lambda message: message.time_ns)
        start = max(message.time_ns for message in found) + GAP_NS


def _links(hand: HandModel) -> Message:
    """Meshes of the rigid links."""
    colour = hand_colour(hand)
    return scene(SCENE, EPOCH_NS, [
        entity(_frame(hand, mesh.link), _frame(hand, mesh.link), [triangles(mesh.vertices, mesh.faces, colour)])
        for mesh in link_meshes(hand)])  # fmt: skip


def _person(stage: str, motion: HandMotion, start: int) -> Iterator[Message]:
    grey = np.tile(np.array([*PERSON, 255], np.uint8), (motion.keypoints_m.shape[1], 1))
    phase = -1
    for row, points in enumerate(motion.keypoints_m):
        time_ns = start + round(row * SECOND_NS / motion.rate_hz)
        yield cloud(f"/{stage}/keypoints", time_ns, SOURCE, points, grey)
        yield scene(f"/{stage}/bones", time_ns, [entity("person", SOURCE, lines=[loop(points[list(chain)], PERSON, False)
                                                                                 for chain in CHAINS])])  # fmt: skip
        if len(motion.object_pose):
            yield pose(f"/{stage}/object", time_ns, motion.object_pose[row], SOURCE)
        if motion.phase[row] != phase:
            phase = int(motion.phase[row])
            yield log(f"/{stage}/log", time_ns, f"{motion.name}, {motion.side} hand: {PHASES[phase]}", motion.object_name)


def _verdict(clip: MotionClip, start: int) -> Message:
    one = clip.fitted.verdict
    text = f"kept, {1000 * one.error_mean_m:.1f} mm off on average" if one.kept else f"dropped: {one.reason}, {one.detail}"
    return log(LOG, start, f"{one.name}: {text}", one.source, "INFO" if one.kept else "WARNING")


def _robot(motion: HandMotion, reference: HandReference, studio: MotionRenderer, pictures_hz: float,
           start: int) -> Iterator[Message]:  # fmt: skip
    hand, theirs = studio.hand, placed_keypoints(motion, reference)
    T, every = forward_kinematics(hand.joints, reference.q), max(1, round(reference.rate_hz / pictures_hz))
    for row in range(len(reference.q)):
        time_ns = start + round(row * SECOND_NS / reference.rate_hz)
        frames = {_frame(hand, link): T[row, link] for link in range(len(hand.links))}
        yield transforms(TRANSFORMS, time_ns, {**frames, SOURCE: reference.T_world_source})
        yield stamped(ERROR, time_ns, Scalar(step=row, value=1000 * reference.error_m[row]))
        yield stamped(BONES, time_ns, Scalar(step=row, value=float(np.rad2deg(reference.bone_error_rad[row]))))
        if row % every == 0:
            yield image(IMAGE, time_ns, jpeg(studio.draw(reference, theirs, row)), "jpeg")


def _frame(hand: HandModel, link: int) -> str:
    return f"hand/{hand.links[link]}"
