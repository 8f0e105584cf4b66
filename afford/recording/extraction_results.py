"""Recorders of extraction results: tracks, inpainted frames, complete objects, affordances, samples."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
from foxglove_schemas_protobuf.Log_pb2 import Log

from afford.common.image_files import colour_png, grey_png, jpeg, mask_png, overlay_png
from afford.common.palette import HANDS, LEFT, RIGHT, Palette, colours_of
from afford.recording.mcap_files import EPOCH_NS, Channel, Message, Recording
from afford.recording.messages import (
    AffordanceState,
    CompleteState,
    Contact,
    InpaintState,
    MaskState,
    SampleState,
    about,
    channel,
    image,
    image_channel,
    log,
    slugs,
    stamped,
    times_of,
)
from schemas.affordance import Affordances, Rejection, Sample, Samples, Taxonomy
from schemas.masks import CompleteObjects, TrackFlag, Tracks
from schemas.video import SIDES, Frames, Inpainted, PixelSource

TRACKS = "/mask_densify"
TRACKS_OVERLAY, CONTACT = f"{TRACKS}/overlay", f"{TRACKS}/contact"


def record_tracks(value: Tracks, frames: Frames) -> Recording:
    """Masks of 0 and 255 and their states, one topic per hand and object, an overlay of all, and contacts.

    Tracks -> /mask_densify.
    """
    words = slugs(value.entities)
    colours = colours_of(value.entities)
    shades = {word: list(colour) for word, colour in zip(words, colours, strict=True)}
    channels: list[Channel] = [image_channel(TRACKS_OVERLAY, palette=shades), channel(CONTACT, Contact)]
    for word, entity in zip(words, value.entities, strict=True):
        channels += [image_channel(f"{TRACKS}/{word}", **about(entity)), channel(f"{TRACKS}/{word}/state", MaskState)]
    return Recording(tuple(channels), _track_messages(value, frames, words, colours))


def _track_messages(value: Tracks, frames: Frames, words: list[str], colours: Palette) -> Iterator[Message]:
    for t, time_ns in enumerate(times_of(value.frame, frames)):
        yield image(TRACKS_OVERLAY, time_ns, overlay_png(value.masks[:, t], colours))
        yield stamped(CONTACT, time_ns, _contact(value, t))
        for n, word in enumerate(words):
            yield image(f"{TRACKS}/{word}", time_ns, mask_png(value.masks[n, t]))
            yield stamped(f"{TRACKS}/{word}/state", time_ns, _track_state(value, n, t))


def _track_state(value: Tracks, n: int, t: int) -> MaskState:
    flags = TrackFlag(int(value.flags[n, t]))
    return MaskState(
        frame=int(value.frame[t]), confidence=float(value.confidence[n, t]), area_px=float(np.count_nonzero(value.masks[n, t])),
        visible=TrackFlag.VISIBLE in flags, key=TrackFlag.KEY in flags, entering=TrackFlag.ENTERING in flags,
        leaving=TrackFlag.LEAVING in flags, source_frame=int(value.source_frame[n, t]),
        distance_frames=float(value.distance[n, t]))  # fmt: skip


def _contact(value: Tracks, t: int) -> Contact:
    names = {-1: "none", -2: "unknown"} | {n: entity.entity_id for n, entity in enumerate(value.entities)}
    left, right = (names[int(n)] for n in value.contact[:, t])
    since = value.contact_distance[:, t]
    return Contact(frame=int(value.frame[t]), left=left, right=right, left_distance_frames=float(since[0]),
                   right_distance_frames=float(since[1]))  # fmt: skip


INPAINTED = "/hand_inpaint"
SOURCE_COLOURS = ((0, 0, 0), (102, 187, 106), (255, 202, 40), (239, 83, 80))
"""colours of PixelSource in order: original, background, object, spatial"""


def record_inpainted(value: Inpainted, frames: Frames) -> Recording:
    """Frames without hands; the replaced pixels, the source of each pixel, and its confidence.

    Inpainted -> /hand_inpaint/image, mask, confidence, source, state.
    """
    colours = {source.name.lower(): list(SOURCE_COLOURS[source]) for source in PixelSource}
    channels = (
        image_channel(f"{INPAINTED}/image"),
        image_channel(f"{INPAINTED}/mask", classes={"0": "kept", "255": "replaced"}),
        image_channel(f"{INPAINTED}/confidence", classes={"0": "guessed", "255": "seen"}),
        image_channel(f"{INPAINTED}/source", palette=colours),
        channel(f"{INPAINTED}/state", InpaintState),
    )
    return Recording(channels, _inpainted_messages(value, frames))


def _inpainted_messages(value: Inpainted, frames: Frames) -> Iterator[Message]:
    for t, time_ns in enumerate(times_of(value.frame, frames)):
        yield image(f"{INPAINTED}/image", time_ns, jpeg(value.rgb[t]), "jpeg")
        yield image(f"{INPAINTED}/mask", time_ns, mask_png(value.mask[t]))
        yield image(f"{INPAINTED}/confidence", time_ns, grey_png(value.confidence[t]))
        yield image(f"{INPAINTED}/source", time_ns, colour_png(value.source[t], SOURCE_COLOURS))
        yield stamped(f"{INPAINTED}/state", time_ns, _inpainted_state(value, t))


def _inpainted_state(value: Inpainted, t: int) -> InpaintState:
    replaced = value.mask[t]
    count = np.bincount(value.source[t][replaced], minlength=len(PixelSource))
    sure = float(value.confidence[t][replaced].mean()) / 255 if replaced.any() else 1.0
    return InpaintState(
        frame=int(value.frame[t]), replaced_px=float(np.count_nonzero(replaced)), confidence=sure,
        background_px=float(count[PixelSource.BACKGROUND]), object_px=float(count[PixelSource.OBJECT]),
        spatial_px=float(count[PixelSource.SPATIAL]))  # fmt: skip


COMPLETION = "/object_completion"
COMPLETION_OVERLAY = f"{COMPLETION}/overlay"


def record_completion(value: CompleteObjects, frames: Frames) -> Recording:
    """Complete masks of 0 and 255, one topic per touched object, with their states and an overlay.

    CompleteObjects -> /object_completion.
    """
    words = slugs(value.entities)
    colours = colours_of(value.entities)
    shades = {word: list(colour) for word, colour in zip(words, colours, strict=True)}
    channels: list[Channel] = [image_channel(COMPLETION_OVERLAY, palette=shades)]
    for word, entity in zip(words, value.entities, strict=True):
        channels += [image_channel(f"{COMPLETION}/{word}", **about(entity)), channel(f"{COMPLETION}/{word}/state", CompleteState)]
    return Recording(tuple(channels), _completion_messages(value, frames, words, colours))


def _completion_messages(value: CompleteObjects, frames: Frames, words: list[str], colours: Palette) -> Iterator[Message]:
    for t, time_ns in enumerate(times_of(value.frame, frames)):
        yield image(COMPLETION_OVERLAY, time_ns, overlay_png(value.masks[:, t], colours))
        for n, word in enumerate(words):
            state = CompleteState(frame=int(value.frame[t]), confidence=float(value.confidence[n, t]),
                                  area_px=float(np.count_nonzero(value.masks[n, t])))  # fmt: skip
            yield image(f"{COMPLETION}/{word}", time_ns, mask_png(value.masks[n, t]))
            yield stamped(f"{COMPLETION}/{word}/state", time_ns, state)


AFFORDANCE = "/affordance"


def record_affordances(value: Affordances, frames: Frames) -> Recording:
    """Affordance of each hand on its object; taxonomy of the task, and acceptance of the frame as a sample.

    Affordances -> /affordance/left, /affordance/right, /affordance/overlay, /affordance/state.
    """
    masks = tuple(image_channel(f"{AFFORDANCE}/{side}", side=side, classes={"0": "background", "255": f"{side} affordance"})
                  for side in SIDES)  # fmt: skip
    overlay = image_channel(f"{AFFORDANCE}/overlay", palette={side: list(colour) for side, colour in HANDS.items()})
    return Recording((*masks, overlay, channel(f"{AFFORDANCE}/state", AffordanceState)), _affordance_messages(value, frames))


def _affordance_messages(value: Affordances, frames: Frames) -> Iterator[Message]:
    for t, time_ns in enumerate(times_of(value.frame, frames)):
        for side, mask in zip(SIDES, value.masks[:, t], strict=True):
            yield image(f"{AFFORDANCE}/{side}", time_ns, mask_png(mask))
        yield image(f"{AFFORDANCE}/overlay", time_ns, overlay_png(value.masks[:, t], (LEFT, RIGHT)))
        yield stamped(f"{AFFORDANCE}/state", time_ns, _affordance_state(value, t))


def _affordance_state(value: Affordances, t: int) -> AffordanceState:
    left, right = ("" if n < 0 else value.objects[n].entity_id for n in value.object_index[:, t].tolist())
    rejection, taxonomy = Rejection(int(value.rejection[t])), Taxonomy(int(value.taxonomy[t]))
    return AffordanceState(
        frame=int(value.frame[t]), accepted=rejection is Rejection.ACCEPTED, rejection=rejection.name.lower(),
        taxonomy=taxonomy.name.lower(), taxonomy_id=int(taxonomy), taxonomy3_id=int(value.taxonomy3[t]),
        quality=float(value.quality[t]), left_object=left, right_object=right,
        left_area_px=float(np.count_nonzero(value.masks[0, t])),
        right_area_px=float(np.count_nonzero(value.masks[1, t])))  # fmt: skip


SAMPLES = "/sample_assemble"


def record_samples(value: Samples, frames: Frames) -> Recording:
    """Samples of the data set: the JPEG itself, both masks, the task.

    Samples -> /sample_assemble/image, left, right, state, log.
    """
    masks = tuple(image_channel(f"{SAMPLES}/{side}", side=side, classes={"0": "background", "255": f"{side} affordance"})
                  for side in SIDES)  # fmt: skip
    channels = (image_channel(f"{SAMPLES}/image", rejected=dict(value.rejected)), *masks, channel(f"{SAMPLES}/state", SampleState),
                channel(f"{SAMPLES}/log", Log))  # fmt: skip
    return Recording(channels, _sample_messages(value))


def _sample_messages(value: Samples) -> Iterator[Message]:
    for sample in sorted(value.samples, key=lambda s: (s.time_ns, s.sample_id)):
        time_ns = EPOCH_NS + sample.time_ns
        yield image(f"{SAMPLES}/image", time_ns, sample.image_jpeg.tobytes(), "jpeg")
        for side, mask in zip(SIDES, sample.masks[:2], strict=True):
            yield image(f"{SAMPLES}/{side}", time_ns, mask_png(mask))
        yield stamped(f"{SAMPLES}/state", time_ns, _sample_state(sample))
        yield log(f"{SAMPLES}/log", time_ns, sample.narration.text, sample.sample_id)


def _sample_state(sample: Sample) -> SampleState:
    return SampleState(
        frame=sample.frame, sample_id=sample.sample_id, text=sample.narration.text, taxonomy_id=sample.taxonomy,
        quality=sample.quality, inpaint_confidence=sample.inpaint_confidence, key_distance_frames=float(sample.key_distance),
        object_left=sample.object_left, object_right=sample.object_right)  # fmt: skip
