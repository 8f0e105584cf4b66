"""Interactions in Rerun: what was seen, its motion and depth, what was said with attention, and the actions as curves."""

from __future__ import annotations

from pathlib import Path

import rerun as rr
import rerun.blueprint as rrb

from afford.recording.moments import Moment, moments
from afford.recording.of_interaction import ACTION, ATTENTION, DEPTH, FLOW, IMAGE, SAID, SURE, TRUTH, WORDS
from afford.rgbd.prediction import COLOURS
from schemas.interaction import AFFORDANCES

PLACES = {"said": SAID, "confident": SURE, "truth": TRUTH}
"""view -> the overlay that is drawn on the frame there"""
MM_PER_M = 1000.0


def layout() -> rrb.Blueprint:
    """Pictures beside curves and words."""
    views = {"frame": "frame", "motion": "motion that led to it", "depth": "depth", "said": "likeliest affordance",
             "confident": "affordance, confident", "attention": "attention", "truth": "truth of the last frame"}  # fmt: skip
    pictures = rrb.Grid(*(rrb.Spatial2DView(origin=f"/{place}", name=name) for place, name in views.items()), grid_columns=3)
    curves = rrb.TimeSeriesView(origin="/action", name="probability of each action", axis_y=rrb.ScalarAxis(range=(0, 1)))
    beside = rrb.Vertical(curves, rrb.TextLogView(origin="/log", name="words"), row_shares=[3, 1])
    return rrb.Blueprint(rrb.Horizontal(pictures, beside, column_shares=[2, 1]), collapse_panels=True)


def log(path: Path, stream: rr.RecordingStream) -> None:
    """Everything, moment by moment, on the recording's own clock."""
    for name in AFFORDANCES:
        stream.log(f"action/{name}", rr.SeriesLines(colors=[COLOURS[name]], names=[name]), static=True)
    for moment in moments(path):
        stream.set_time("media_time", duration=moment.time_ns / 1e9)
        _pictures(moment, stream)
        state = moment.one(ACTION)
        if state is not None:
            stream.set_time("frame", sequence=state.step)
            for name in AFFORDANCES:
                stream.log(f"action/{name}", rr.Scalars(getattr(state, name)))
        for line in moment.values.get(WORDS, []):
            stream.log("log", rr.TextLog(line.message))


def _pictures(moment: Moment, stream: rr.RecordingStream) -> None:
    frame, depth = moment.one(IMAGE), moment.picture(DEPTH)
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
