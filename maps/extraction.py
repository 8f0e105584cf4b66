"""Map of the extraction: from video to a two-hand affordance data set, one line per stage."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from typing import Any, NamedTuple

from maps.common import record_run, record_training, recorded, reported, weights
from maps.settings import Origin, Settings
from maps.synthetic import videos
from runner import Graph
from schemas.affordance import Affordances, FrameLabels, Samples
from schemas.benchmark import ClipScores
from schemas.files import FileTree
from schemas.hands import DetectedHands
from schemas.masks import CompleteObjects, Tracks
from schemas.scene import HandLessons, RenderedClip
from schemas.training import Trained
from schemas.video import Clip, Footage, Frames, Inpainted
from stages.extraction import (
    affordance_intersect,
    clip_footage,
    dataset_pack,
    extraction_report,
    extraction_score,
    frame_decode,
    hand_detect,
    hand_inpaint,
    hand_landmarks,
    hands_train,
    held_train,
    key_thin,
    mask_densify,
    narration_labelling,
    object_completion,
    sample_assemble,
    source_read,
)
from stages.extraction.hand_detect import TRAINED
from stages.recording import clip_record, stage_record
from stages.synthetic import hand_lessons, hand_plan


class Extracted(NamedTuple):
    """Handles of the outputs of all extraction stages for one clip.

    `read` is the clip before hand detection; `hands` are those that were detected, None in a clip with masks.
    """

    clip: Clip
    frames: Frames
    tracks: Tracks
    inpainted: Inpainted
    complete: CompleteObjects
    affordances: Affordances
    labels: FrameLabels
    read: Clip
    hands: DetectedHands | None = None

    def recorded(self) -> dict[str, stage_record.Recorded]:
        """Outputs that a recording shows, by stage."""
        return {
            "source_read": self.read, **({"hand_detect": self.hands} if self.hands is not None else {}),
            "frame_decode": self.frames, "mask_densify": self.tracks,
            "hand_inpaint": self.inpainted, "object_completion": self.complete, "affordance_intersect": self.affordances,
            "narration_labelling": self.labels,
        }  # fmt: skip


class Decoded(NamedTuple):
    """Handles of one clip as it was read, and of its frames."""

    clip: Clip
    media: FileTree
    footage: Footage
    frames: Frames


def decode(g: Graph, video: RenderedClip, p: Settings) -> Decoded:
    """Read every clip of a video and decode its frames."""
    files       = g.pick(video, lambda v: v.files)
    media       = g.pick(video, lambda v: v.media)
    clip        = g.each(g.first(g.add(source_read.run, files=files,                      params=p.extraction.source_read)))
    footage     = g.add(clip_footage.run,           clip=clip,                                       params=clip_footage.Params())
    frames      = g.add(frame_decode.run,           media=media,     footage=footage,     params=p.extraction.frame_decode)
    return Decoded(clip, media, footage, frames)


def extract(g: Graph, video: RenderedClip, p: Settings, bare: bool = False) -> Extracted:
    """Extract hands, objects and affordances on every frame; in a `bare` video hands are detected first."""
    s           = p.extraction
    seen        = decode(g, video, p)
    frames      = seen.frames
    read, found = seen.clip, detect_hands(g, seen, p) if bare else None
    clip        = read if found is None else g.pick(found, lambda d: d.clip)
    tracks      = g.add(mask_densify.run,           clip=clip,       frames=frames,                  params=s.mask_densify,
                        **weights(g, p, "mask_densify"))
    inpainted   = g.add(hand_inpaint.run,           frames=frames,   tracks=tracks,                  params=s.hand_inpaint,
                        **weights(g, p, "hand_inpaint"))
    complete    = g.add(object_completion.run,      frames=frames,   tracks=tracks, inpainted=inpainted, params=s.object_completion,
                        **weights(g, p, "object_completion"))
    affordances = g.add(affordance_intersect.run,   tracks=tracks,   complete=complete,              params=s.affordance_intersect)
    labels      = g.add(narration_labelling.run,    clip=clip,       frames=frames,                  params=s.narration_labelling)
    return Extracted(clip, frames, tracks, inpainted, complete, affordances, labels, read, found)


def detect_hands(g: Graph, seen: Decoded, p: Settings) -> DetectedHands:
    """Detect hands and touched objects in a clip without masks; without the landmark networks the hand finder finds them alone."""
    s, given = p.extraction, dict(p.weights)
    params = s.hand_detect
    if "hand_landmarks" not in given and params.backend == "landmarks":
        params = replace(params, backend="network")
    arguments: dict[str, Any] = {}
    if "hand_landmarks" in given:
        arguments["landmarks"] = g.add(hand_landmarks.run, media=seen.media, footage=seen.footage, params=s.hand_landmarks,
                                       **weights(g, p, "hand_landmarks"))
    trained = {"weights": g.pick(finder(g, p), lambda t: t.files)} if params.backend == "network" else {}
    arguments |= (trained or weights(g, p, "hand_detect")) | _held(g, p)
    if "segment" in given:
        arguments["segment"] = g.leaf("hand_detect_segment", given["segment"])
    return g.add(hand_detect.run, clip=seen.clip, frames=seen.frames, params=params, **arguments)


def _held(g: Graph, p: Settings) -> dict[str, FileTree]:
    """Network of held objects, named or trained first, and the landmark networks that it reads; empty where none is asked for."""
    given, trained = dict(p.weights), p.extraction.hand_detect.held == TRAINED
    if not (trained or "held" in given):
        return {}
    held = g.pick(held_network(g, p), lambda t: t.files) if trained else g.leaf("held_weights", given["held"])
    return {"held": held, "networks": g.leaf("hand_detect_networks", _landmark_networks(p))}


def _lessons(g: Graph, p: Settings) -> tuple[HandLessons, ...]:
    room = g.each(g.add(hand_plan.run, params=p.extraction.hand_plan))
    return g.collect(g.add(hand_lessons.run, room=room, params=p.extraction.hand_lessons, ctx=g.ctx))


def finder(g: Graph, p: Settings) -> Trained:
    """Train the hand finder on rendered rooms; all uses in a graph share one training."""
    files = {name: g.leaf(f"hands_train_{name}", found) for name, found in _training_files(p).items()}
    return g.add(hands_train.run, lessons=_lessons(g, p), params=p.extraction.hands_train, ctx=g.ctx, **files)


def held_network(g: Graph, p: Settings) -> Trained:
    """Train the network of held objects on the rooms of the hand finder; the stage fails without the landmark networks."""
    files = {"photographs": g.leaf("held_train_photographs", shown)} if (shown := dict(p.weights).get("held_train")) else {}
    return g.add(held_train.run, lessons=_lessons(g, p), networks=g.leaf("held_train_networks", _landmark_networks(p)),
                 params=p.extraction.held_train, ctx=g.ctx, **files)  # fmt: skip


def _landmark_networks(p: Settings) -> FileTree:
    """Files of the landmark networks; without set-up an empty list, which a stage that needs them refuses."""
    return dict(p.weights).get("hand_landmarks", FileTree("landmark_networks", ()))


def _training_files(p: Settings) -> dict[str, FileTree]:
    """Photographs of the user and MediaPipe's networks, where there are any."""
    named = {"photographs": "hands_train", "landmarks": "hand_landmarks"}
    return {name: files for name, stage in named.items() if (files := dict(p.weights).get(stage))}


def assemble(g: Graph, x: Extracted, p: Settings) -> Samples:
    """Assemble the samples of one clip."""
    return g.add(sample_assemble.run, clip=x.clip, frames=x.frames, inpainted=x.inpainted, tracks=x.tracks,
                 complete=x.complete, affordances=x.affordances, labels=x.labels, params=p.extraction.sample_assemble)


def pack(g: Graph, samples: Samples, origin: Origin, p: Settings) -> FileTree:
    """Pack the samples of all clips into one data set."""
    return g.add(dataset_pack.run, samples=g.collect(samples), params=licensed(p.extraction.dataset_pack, origin), ctx=g.ctx)


def licensed(params: dataset_pack.Params, origin: Origin) -> dataset_pack.Params:
    """Set the licence of rendered clips to apache-2.0; for other clips the stage or the user chooses it."""
    return replace(params, license="apache-2.0") if origin.specs and not params.license else params


def mined(g: Graph, origin: Origin, p: Settings) -> FileTree:
    """Build a data set with labels extracted from videos."""
    return pack(g, assemble(g, extract(g, videos(g, origin, p), p, origin.bare), p), origin, p)


class Scored(NamedTuple):
    """Handles of the quality report and its inputs."""

    report: FileTree
    scores: ClipScores
    x: Extracted


def score(g: Graph, video: RenderedClip, p: Settings) -> Scored:
    """Build the quality report of clips with ground truth, with all key frames (gap 15) and every second one (gap 30)."""
    x = extract(g, video, p)
    truth = g.pick(video, lambda v: v.truth)
    thin   = g.add(key_thin.run,     clip=x.clip,                                                    params=p.extraction.key_thin)
    sparse = g.named("mask_densify_gap30").add(mask_densify.run, clip=thin, frames=x.frames,       params=p.extraction.mask_densify,
                                                    **weights(g, p, "mask_densify"))
    scores = g.add(extraction_score.run, truth=truth, clip=x.clip, frames=x.frames, tracks=x.tracks, tracks_sparse=sparse,
                   inpainted=x.inpainted, complete=x.complete, affordances=x.affordances, params=p.extraction.extraction_score)
    report = g.add(extraction_report.run, scores=g.collect(scores), params=p.extraction.extraction_report, ctx=g.ctx)
    return Scored(report, scores, x)


def record(g: Graph, x: Extracted, samples: Samples) -> FileTree:
    """Record every stage of a clip."""
    return record_clip(g, x.clip, x.frames, {**x.recorded(), "sample_assemble": samples})


def record_hands(g: Graph, seen: Decoded, hands: DetectedHands) -> FileTree:
    """Record the frames of a clip with its detected hands."""
    values: dict[str, stage_record.Recorded] = {"source_read": seen.clip, "frame_decode": seen.frames, "hand_detect": hands}
    return record_clip(g, seen.clip, seen.frames, values, "hand_detect/{clip}")


def record_clip(g: Graph, clip: Clip, frames: Frames, values: Mapping[str, stage_record.Recorded],
                name: str = "{clip}") -> FileTree:  # fmt: skip
    """Record the outputs of stages for a clip, and merge the recordings into one for the viewer."""
    parts = tuple(
        g.named(f"record_{stage}").add(stage_record.run, value=value, frames=frames, params=stage_record.Params(stage), ctx=g.ctx)
        for stage, value in values.items()
    )
    return recorded(g, g.add(clip_record.run, clip=clip, parts=parts, params=clip_record.Params(), ctx=g.ctx), name)


def dataset(g: Graph, origin: Origin, p: Settings) -> None:
    """Build the data set of a source, with a recording of every clip."""
    x = extract(g, videos(g, origin, p), p, origin.bare)
    samples = assemble(g, x, p)
    packed = g.publish(pack(g, samples, origin, p), "datasets/{source}", as_="dataset")
    g.target("dataset", packed, record(g, x, samples), record_run(g, "dataset_pack", packed))


def recordings(g: Graph, origin: Origin, p: Settings) -> None:
    """Record every clip of a source."""
    x = extract(g, videos(g, origin, p), p, origin.bare)
    g.target("recordings", record(g, x, assemble(g, x, p)))


def extraction_quality(g: Graph, origin: Origin, p: Settings) -> None:
    """Score every extraction stage against ground truth."""
    report, scores, x = score(g, videos(g, origin, p), p)
    g.cost("cpu_s_per_frame", (x.frames, x.tracks, x.inpainted, x.complete, x.affordances), (reported(g, report), "clips.frames"),
           shards=scores, each=True)
    g.target("extraction-report", report, record_run(g, "extraction_report", report))


def hands(g: Graph, origin: Origin, p: Settings) -> None:
    """Train the hand finder, which finds hands in pictures without masks, on rendered rooms."""
    trained = finder(g, p)
    g.target("hands", g.pick(trained, lambda t: t.files), record_training(g, "hands_train", trained, p.extraction.hands_train))


def held(g: Graph, origin: Origin, p: Settings) -> None:
    """Train the network that segments what a hand holds, on rendered rooms."""
    trained = held_network(g, p)
    g.target("held", g.pick(trained, lambda t: t.files), record_training(g, "held_train", trained, p.extraction.held_train))


def compared(g: Graph, origin: Origin, columns: Mapping[str, Settings]) -> dict[str, dict[str, str]]:
    """Build the report of every column of settings on the same clips; shared stages run once.

    Returns the names of the stages of every column.
    """
    video = videos(g, origin, next(iter(columns.values())))
    names: dict[str, dict[str, str]] = {}
    reports: list[FileTree] = []
    for label, p in columns.items():
        with g.variant(label) as names[label]:
            reports.append(score(g, video, p).report)
    g.target("extraction-report", *reports)
    return names
