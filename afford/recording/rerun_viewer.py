"""Recordings in Rerun with a layout for each kind: clips and interactions here, grasps in rerun_grasps.py."""

from __future__ import annotations

import json
from collections.abc import Callable, Iterator
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import rerun as rr
import rerun.blueprint as rrb
from mcap.reader import make_reader

from afford.recording.extraction_results import AFFORDANCE, COMPLETION_OVERLAY, INPAINTED, TRACKS, TRACKS_OVERLAY
from afford.recording.extraction_sources import FRAME_IMAGE, FRAME_STATE, NARRATION, NARRATION_LOG
from afford.recording.hands import HAND_BONES, KEYPOINTS
from afford.recording.interactions import ACTION, ATTENTION, CONFIDENT, DEPTH, FLOW, FRAME, LIKELIEST, LOG, TRUTH, is_interaction
from afford.recording.moments import Moment, moments
from afford.recording.rerun_grasps import grasp_blueprint, log_grasps
from afford.recording.strips import is_grasp
from afford.rgbd.prediction import COLOURS
from schemas.interaction import AFFORDANCES

APPLICATION = "afford"
AFFORDANCE_STATE, INPAINT_STATE = f"{AFFORDANCE}/state", f"{INPAINTED}/state"
MASKS = {
    "frame/masks": TRACKS_OVERLAY,
    "objects/masks": COMPLETION_OVERLAY,
    "affordance/masks": f"{AFFORDANCE}/overlay",
}
"""entity path of masks -> overlay topic whose palette names them"""


def save(path: Path, out: Path) -> None:
    """Write an .rrd with its layout."""
    out.parent.mkdir(parents=True, exist_ok=True)
    stream, (layout, log) = _stream(path), _made_for(path)
    stream.save(out, default_blueprint=layout())
    log(path, stream)
    stream.disconnect()


def show(path: Path, program: str) -> None:
    """Start the viewer program and send it the recording."""
    stream, (layout, log) = _stream(path), _made_for(path)
    rr.spawn(executable_path=program, default_blueprint=layout(), recording=stream)
    log(path, stream)
    stream.disconnect()


def _made_for(path: Path) -> tuple[Callable[[], rrb.Blueprint], Callable[[Path, rr.RecordingStream], None]]:
    """Layout and logging function of a clip, of grasps, or of an interaction."""
    if is_interaction(path):
        return interaction_blueprint, log_interaction
    return (grasp_blueprint, log_grasps) if is_grasp(path) else (partial(_layout, HAND_BONES in _topics(path)), _log)


def _stream(path: Path) -> rr.RecordingStream:
    stream = rr.RecordingStream(APPLICATION, recording_id=path.stem)
    stream.send_recording_name(path.stem)
    return stream


def _layout(hands: bool) -> rrb.Blueprint:
    """Layout of a clip, with a view of detected hands in space where there are any."""
    clean, unit = "/clean/image", rrb.ScalarAxis(range=(0.0, 1.05))
    pictures = rrb.Grid(
        rrb.Spatial2DView(origin="/frame", name="hands and objects"),
        rrb.Spatial2DView(origin="/clean", name="hands removed"),
        rrb.Spatial2DView(origin="/objects", contents=["$origin/**", clean], name="complete objects"),
        rrb.Spatial2DView(origin="/affordance", contents=["$origin/**", clean], name="affordance"),
        *([rrb.Spatial3DView(origin="/hands", name="hands in space")] if hands else []),
        grid_columns=2,
    )
    words = rrb.Vertical(
        rrb.TextDocumentView(origin="/task", name="task"),
        rrb.TextLogView(origin="/log", name="narrations"),
        rrb.TimeSeriesView(origin="/plots/confidence", name="confidence of each mask", axis_y=unit),
        rrb.TimeSeriesView(origin="/plots/sample", name="quality of the sample, confidence of the inpainting", axis_y=unit),
        row_shares=[4, 2, 3, 3],
    )
    return rrb.Blueprint(rrb.Horizontal(pictures, words, column_shares=[2, 1]), collapse_panels=True)


def _log(path: Path, stream: rr.RecordingStream) -> None:
    named = {topic: list(palette) for topic, palette in _palettes(path).items()}
    for topic, palette in _palettes(path).items():
        place = next(place for place, overlay in MASKS.items() if overlay == topic)
        classes = [rr.AnnotationInfo(n + 1, word, colour) for n, (word, colour) in enumerate(palette.items())]
        stream.log(place.split("/")[0], rr.AnnotationContext([rr.AnnotationInfo(0, "", (0, 0, 0, 0)), *classes]), static=True)
        if topic == TRACKS_OVERLAY:
            for word, colour in palette.items():
                stream.log(f"plots/confidence/{word}", rr.SeriesLines(colors=[colour], names=[word]), static=True)
    for moment in moments(path):
        stream.set_time("media_time", duration=moment.time_ns / 1e9)
        state = moment.one(FRAME_STATE)
        if state is not None:
            stream.set_time("frame", sequence=state.frame)
        _log_pictures(moment, stream, named)
        _log_hands(moment, stream)
        _task(moment, stream)
        for name, number in _numbers(moment):
            stream.log(f"plots/{name}", rr.Scalars(number))


def _topics(path: Path) -> set[str]:
    with path.open("rb") as file:
        summary = make_reader(file).get_summary()
    return {channel.topic for channel in summary.channels.values()} if summary else set()


def _palettes(path: Path) -> dict[str, dict[str, list[int]]]:
    """Overlay topic -> mask word -> colour, in drawing order."""
    with path.open("rb") as file:
        summary = make_reader(file).get_summary()
    channels = summary.channels.values() if summary else ()
    found = {c.topic: json.loads(c.metadata["palette"]) for c in channels if c.topic in MASKS.values()}
    return dict(sorted(found.items()))


def _log_pictures(moment: Moment, stream: rr.RecordingStream, named: dict[str, list[str]]) -> None:
    for place, topic in (("frame/image", FRAME_IMAGE), ("clean/image", f"{INPAINTED}/image")):
        found = moment.one(topic)
        if found is not None:
            stream.log(place, rr.EncodedImage(contents=found.data, media_type="image/jpeg"))
    for place, topic in MASKS.items():
        labels = _labels(moment, topic, named.get(topic, []))
        if labels is not None:
            stream.log(place, rr.SegmentationImage(labels, opacity=0.6, draw_order=10.0))


def _log_hands(moment: Moment, stream: rr.RecordingStream) -> None:
    """Keypoints of detected hands: lines and points on the frame, lines in space."""
    drawn, bones = moment.one(KEYPOINTS), moment.one(HAND_BONES)
    if drawn is not None:
        lines = [part for part in drawn.points if part.type == part.LINE_STRIP]
        dots = [part for part in drawn.points if part.type == part.POINTS]
        stream.log("frame/bones", rr.LineStrips2D([_corners(part.points) for part in lines], draw_order=20.0,
                                                  colors=[_rgba(part.outline_color) for part in lines]))  # fmt: skip
        stream.log("frame/keypoints", rr.Points2D([corner for part in dots for corner in _corners(part.points)], draw_order=21.0,
                                                  colors=[_rgba(one) for part in dots for one in part.outline_colors],
                                                  radii=[part.thickness / 2 for part in dots for _ in part.points]))  # fmt: skip
    if bones is not None:
        lines = [line for hand in bones.entities for line in hand.lines]
        stream.log("hands", rr.LineStrips3D([[(p.x, p.y, p.z) for p in line.points] for line in lines],
                                            colors=[_rgba(line.color) for line in lines]))  # fmt: skip


def _corners(points: Any) -> list[tuple[float, float]]:
    return [(point.x, point.y) for point in points]


def _rgba(colour: Any) -> tuple[int, int, int, int]:
    r, g, b, a = (round(255 * part) for part in (colour.r, colour.g, colour.b, colour.a))
    return r, g, b, a


def _labels(moment: Moment, overlay: str, words: list[str]) -> np.ndarray | None:
    """Index + 1 of the topmost mask, (h, w) uint8, from the mask topics of an overlay; None without any."""
    room = overlay.rpartition("/")[0]
    labels: np.ndarray | None = None
    for n, word in enumerate(words, 1):
        mask = moment.picture(f"{room}/{word}")
        if mask is not None:
            labels = np.zeros(mask.shape, np.uint8) if labels is None else labels
            labels[mask > 0] = n
    return labels


def _task(moment: Moment, stream: rr.RecordingStream) -> None:
    state, narrations = moment.one(AFFORDANCE_STATE), moment.values.get(NARRATION, [])
    if state is not None:
        stream.log("task", rr.TextDocument(_markdown(state, narrations), media_type=rr.MediaType.MARKDOWN))
    for line in moment.values.get(NARRATION_LOG, []):
        stream.log("log", rr.TextLog(line.message))


def _markdown(state: Any, narrations: list[Any]) -> str:
    title = " / ".join(n.text for n in narrations) or "(no narration)"
    verdict = f"accepted, quality {state.quality:.2f}" if state.accepted else f"no sample: {state.rejection}"
    rows = {"verb, noun": "; ".join(f"{n.verb}, {n.noun}" for n in narrations), "hands": state.taxonomy,
            "left hand": state.left_object or "nothing", "right hand": state.right_object or "nothing",
            "sample": verdict}  # fmt: skip
    return f"## {title}\n\n" + "\n".join(f"- **{key}** {text.replace('_', ' ')}" for key, text in rows.items())


def _numbers(moment: Moment) -> Iterator[tuple[str, float]]:
    """Curves of a moment: confidence of visible masks, quality of samples, confidence of inpainting."""
    for topic, values in moment.values.items():
        if topic.startswith(TRACKS) and topic.endswith("/state") and values[-1].visible:
            yield f"confidence/{topic.split('/')[2]}", values[-1].confidence
    for name, topic, attribute in (("quality", AFFORDANCE_STATE, "quality"), ("inpainting", INPAINT_STATE, "confidence")):
        state = moment.one(topic)
        if state is not None:
            yield f"sample/{name}", getattr(state, attribute)


PLACES = {"likeliest": LIKELIEST, "confident": CONFIDENT, "truth": TRUTH}
"""view -> overlay drawn on its frame"""
MM_PER_M = 1000.0


def interaction_blueprint() -> rrb.Blueprint:
    """Layout of an interaction: pictures next to curves and text."""
    views = {"frame": "frame", "motion": "motion that led to it", "depth": "depth", "likeliest": "likeliest affordance",
             "confident": "affordance, confident", "attention": "attention", "truth": "truth of the last frame"}  # fmt: skip
    pictures = rrb.Grid(*(rrb.Spatial2DView(origin=f"/{place}", name=name) for place, name in views.items()), grid_columns=3)
    curves = rrb.TimeSeriesView(origin="/action", name="probability of each action", axis_y=rrb.ScalarAxis(range=(0, 1)))
    beside = rrb.Vertical(curves, rrb.TextLogView(origin="/log", name="words"), row_shares=[3, 1])
    return rrb.Blueprint(rrb.Horizontal(pictures, beside, column_shares=[2, 1]), collapse_panels=True)


def log_interaction(path: Path, stream: rr.RecordingStream) -> None:
    """Log every moment of an interaction on the recording's own clock."""
    for name in AFFORDANCES:
        stream.log(f"action/{name}", rr.SeriesLines(colors=[COLOURS[name]], names=[name]), static=True)
    for moment in moments(path):
        stream.set_time("media_time", duration=moment.time_ns / 1e9)
        _log_interaction_pictures(moment, stream)
        state = moment.one(ACTION)
        if state is not None:
            stream.set_time("frame", sequence=state.step)
            for name in AFFORDANCES:
                stream.log(f"action/{name}", rr.Scalars(getattr(state, name)))
        for line in moment.values.get(LOG, []):
            stream.log("log", rr.TextLog(line.message))


def _log_interaction_pictures(moment: Moment, stream: rr.RecordingStream) -> None:
    frame, depth = moment.one(FRAME), moment.picture(DEPTH)
    if depth is not None:
        stream.log("depth", rr.DepthImage(depth, meter=MM_PER_M))
    for place, topic in (("motion", FLOW), ("attention", ATTENTION)):
        found = moment.one(topic)
        if found is not None:
            stream.log(place, rr.EncodedImage(contents=found.data, media_type="image/png"))
    if frame is not None:
        for place in ("frame", *PLACES):
            stream.log(f"{place}/image", rr.EncodedImage(contents=frame.data, media_type="image/jpeg"))
    for place, topic in PLACES.items():
        overlay = moment.one(topic)
        if overlay is not None:
            stream.log(f"{place}/affordance", rr.EncodedImage(contents=overlay.data, media_type="image/png", draw_order=10.0))
