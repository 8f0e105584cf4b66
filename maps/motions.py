"""Graphs of recorded hand motion: files or a video -> joints of the robot hand, and a prior that learns from it.

Targets: `motions` (recorded motion in the joints of the robot hand), `grasp-prior` (a prior of recorded motion).
"""

from __future__ import annotations

from dataclasses import replace
from typing import Any, NamedTuple

from maps import extraction
from maps.common import record_run, reported
from maps.grasping import Setup, grasp_objects, human_motion, record_motions, record_policy, robot_hand
from maps.settings import Origin, Settings
from maps.synthetic import videos
from runner import Graph
from schemas.files import FileTree
from schemas.grasp import GraspObject
from schemas.hand import GraspClips, GraspTarget, HandModel, HandMotion, RetargetReport
from stages.grasping import (
    clip_proof,
    hand_imitation,
    hand_motion,
    hand_retarget,
    keypoint_files,
    motion_files,
    motion_read,
    motion_report,
    object_solids,
    prior_report,
    recordings_read,
)
from stages.grasping import human_motion as recorded_motion
from stages.surface import mesh_read


def grasp_prior(g: Graph, origin: Origin, p: Settings) -> None:
    """Prior that learns from recorded motion of the source, synthetic clips, or both; a report of all clips."""
    hand, objects, data = robot_hand(g, p), grasp_objects(g, p), p.grasping.human_motion.data
    made = human_motion(g, hand, objects.train, p)
    tools, lift = g.collect(objects.train), p.grasping.hand_retarget
    bodies, targets, references, others = [tools], [made.targets], [made.references], list[Any]()
    recordings = [record_motions(g, hand, made.motion, made.clip, motion_synthesise=p.grasping.motion_synthesise,
                                 hand_retarget=lift)]  # fmt: skip
    if data != "synthetic":
        scans, found, left_out = recorded_grasps(g, origin, hand, made.targets, p)
        motion = g.each(g.pick(found, lambda c: c.motions))
        clip = g.named("recorded_retarget").add(hand_retarget.run, motion=motion, hand=hand, params=lift)
        report = g.named("recorded_report").add(motion_report.run, clips=g.collect(clip), params=p.grasping.motion_report)
        bodies, targets = [*bodies, scans], [*targets, g.pick(found, lambda c: c.targets)]
        references, others = [*references, report] if data == "both" else [report], left_out
        shown = record_motions(g, hand, motion, clip, human_motion=p.grasping.human_motion, hand_retarget=lift)
        recordings = [*recordings, shown] if data == "both" else [shown]
    proven = g.add(clip_proof.run, hand=hand, bodies=tuple(bodies), targets=tuple(targets), references=tuple(references),
                   others=tuple(others) or g.leaf("no_verdicts", ()), params=p.grasping.clip_proof)  # fmt: skip
    params = replace(p.grasping.hand_imitation, proofs=0)
    prior = g.add(hand_imitation.run, hand=hand, bodies=g.pick(proven, lambda c: c.bodies),
                  targets=g.pick(proven, lambda c: c.targets), references=g.pick(proven, lambda c: c.references), params=params,
                  ctx=g.ctx)  # fmt: skip
    page = reported(g, g.add(prior_report.run, references=g.pick(proven, lambda c: c.references),
                             params=prior_report.Params(origin.name), ctx=g.ctx))  # fmt: skip
    files = g.publish(g.pick(prior, lambda t: t.files), "models/{source}-prior", as_="prior")
    curves = record_policy(g, Setup(hand, objects, made, prior, {}), "hand_imitation", prior, params, p)
    g.target("grasp-prior", page, files, curves, record_run(g, "prior_report", page), *recordings)


def recorded_grasps(g: Graph, origin: Origin, hand: HandModel, places: tuple[GraspTarget, ...],
                    p: Settings) -> tuple[tuple[GraspObject, ...], GraspClips, list[RetargetReport]]:  # fmt: skip
    """Read the scans and the recordings of a source; the scans, the clips of grasps, and reports of what was left out."""
    read = g.named("scan_read").add(mesh_read.run, files=g.each(g.leaf("scans", origin.meshes)), params=p.surface.mesh_read)
    mesh, parts = g.pick(read, lambda m: m.mesh), g.pick(read, lambda m: m.parts)
    scans = g.collect(g.named("scan_solids").add(object_solids.run, mesh=mesh, parts=parts, params=p.grasping.object_solids))
    unread = list[RetargetReport]()
    if origin.videos:
        motions = g.collect(video_motions(g, origin, p).motion)
    else:
        files = g.leaf("recordings", origin.motions or FileTree(origin.name, ()))
        found = g.add(recordings_read.run, files=files, params=p.grasping.recordings_read)
        motions, unread = g.pick(found, lambda m: m.motions), [g.pick(found, lambda m: m.report)]
    clips = g.add(recorded_motion.run, motions=motions, scans=scans, places=places, hand=hand,
                  params=replace(p.grasping.human_motion, data="both", prior=""))  # fmt: skip
    return scans, clips, [*unread, g.pick(clips, lambda c: c.report)]


class MotionSource(NamedTuple):
    """Handles of the motions of a source, the stage that made them with its parameters, and the files of a video's motions."""

    motion: HandMotion
    made: dict[str, Any]
    files: tuple[FileTree, ...] = ()


def motions(g: Graph, origin: Origin, p: Settings) -> None:
    """Recorded hand motion, or that of a video, in the joints of the robot hand; dropped clips with reasons."""
    hand = robot_hand(g, p)
    found = video_motions(g, origin, p) if origin.videos else read_motions(g, origin, p)
    clip = g.named("motion_retarget").add(hand_retarget.run, motion=found.motion, hand=hand, params=p.grasping.motion_retarget)
    references = g.add(motion_report.run, clips=g.collect(clip), params=p.grasping.motion_report)
    made = g.add(motion_files.run, references=references, params=motion_files.Params(origin.name), ctx=g.ctx)
    g.measure(g.publish(made, "motions/{source}", as_="report"))
    recording = record_motions(g, hand, found.motion, clip, **found.made, hand_retarget=p.grasping.motion_retarget)
    g.target("motions", made, record_run(g, "motion_files", made), recording, *found.files)


def read_motions(g: Graph, origin: Origin, p: Settings) -> MotionSource:
    """Read recorded hand motion from files."""
    files = origin.motions or FileTree(origin.name, ())
    motion = g.each(g.first(g.add(motion_read.run, files=g.leaf("motions", files), params=p.grasping.motion_read)))
    return MotionSource(motion, {"motion_read": p.grasping.motion_read})


def video_motions(g: Graph, origin: Origin, p: Settings) -> MotionSource:
    """Take hand motion from videos, publish it as keypoint files, and record the detected hands of every clip.

    In a video with masks, contacts and names of objects are those of its annotators.
    """
    seen = extraction.decode(g, videos(g, origin, p), p)
    hands = extraction.detect_hands(g, seen, p)
    clip = g.pick(hands, lambda d: d.clip) if origin.bare else seen.clip
    found = g.add(hand_motion.run, hands=g.pick(hands, lambda d: d.hands), clip=clip, params=p.grasping.hand_motion)
    motion = g.each(g.pick(found, lambda v: v.motions))
    files = g.add(keypoint_files.run, motions=g.collect(motion), remarks=g.collect(g.pick(found, lambda v: v.remarks)),
                  params=keypoint_files.Params(origin.name), ctx=g.ctx)  # fmt: skip
    g.publish(files, "keypoints/{source}", as_="keypoints")
    return MotionSource(motion, {"hand_motion": p.grasping.hand_motion}, (files, extraction.record_hands(g, seen, hands)))
