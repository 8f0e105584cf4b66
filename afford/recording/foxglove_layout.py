"""Foxglove layout of one recording: panels for the pictures, curves and texts of its topics.

A layout is JSON that Foxglove imports (Layouts, Import from file). Only topics with messages get a panel.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

from afford.recording.messages import CAMERA
from afford.recording.summary import Summary
from schemas.hand import FINGERS
from schemas.interaction import AFFORDANCES

FRAME, OUTLINES = "/frame_decode/image", ("/source_read/outlines", "/hand_detect/outlines", "/hand_detect/keypoints")
HAND_BONES = "/hand_detect/bones"
OVERLAID = ("/mask_densify/overlay", "/hand_inpaint/image", "/object_completion/overlay", "/affordance/overlay",
            "/sample_assemble/image")  # fmt: skip
"""pictures of a clip that are shown next to the frame, whose panel also has the outlines of key frames"""
NARRATION = "/narration"
IMAGE, LOG, ON_PAPER = "foxglove.CompressedImage", "foxglove.Log", "affordance.v1.Document"
CURVES = {"affordance.v1.MaskState": "confidence", "affordance.v1.InpaintState": "confidence",
          "affordance.v1.AffordanceState": "quality"}  # fmt: skip
"""message -> its plotted field"""
IN_PANELS = {"affordance.v1.GraspState": ("goal_m", "height_m"), "affordance.v1.GraspForce": ("thumb_n", "index_n", "middle_n"),
             "affordance.v1.ActionState": AFFORDANCES,
             "affordance.v1.HandState": ("confidence", "palm_m", *(f"{one}_contact" for one in FINGERS))}  # fmt: skip
"""message of grasps and interactions -> its plotted fields, a panel for each message"""
IN_SPACE = ("foxglove.SceneUpdate", "foxglove.PointCloud")
PICTURES_SHARE = 66.0
Panels = dict[str, dict[str, Any]]
Tree = str | dict[str, Any]


def layout(found: Summary) -> dict[str, Any]:
    """Layout as JSON values; ValueError when no panel can show the recording."""
    topics = {topic.topic: topic.schema for topic in found.topics if topic.messages}
    pictures, beside = _pictures(topics) | _space(topics), _plot(topics) | _panels(topics) | _words(topics)
    if not pictures and not beside:
        raise ValueError(f"{found.path}: expected pictures, curves or words to lay out, got {', '.join(topics) or 'no topic'}")
    parts = [_grid(list(pictures))] if pictures else []
    parts += [_stack(list(beside), "column")] if beside else []
    tree = _split(parts[0], parts[1], "row", PICTURES_SHARE) if len(parts) == 2 else parts[0]
    return {"configById": pictures | beside, "globalVariables": {}, "userNodes": {}, "playbackConfig": {"speed": 1}, "layout": tree}


def _pictures(topics: Mapping[str, str]) -> Panels:
    """Panels of a clip's views, or of every picture of any other recording."""
    images = [topic for topic, schema in topics.items() if schema == IMAGE]
    shown = [topic for topic in (FRAME, *OVERLAID) if topic in images] or images
    return {f"Image!{_id(topic)}": {"foxglovePanelTitle": topic, "imageMode": _image(topic, topics)} for topic in shown}


def _image(topic: str, topics: Mapping[str, str]) -> dict[str, Any]:
    drawn = {outlines: {"visible": True} for outlines in OUTLINES if topic == FRAME and outlines in topics}
    return {"imageTopic": topic, "annotations": drawn}


def _plot(topics: Mapping[str, str]) -> Panels:
    paths = [{"value": f"{topic}.{CURVES[schema]}", "enabled": True, "timestampMethod": "receiveTime", "label": topic}
             for topic, schema in topics.items() if schema in CURVES]  # fmt: skip
    return {"Plot!curves": {"foxglovePanelTitle": "confidence and quality", "paths": paths, "minYValue": 0, "maxYValue": 1,
                            "isSynced": True, "showLegend": True}} if paths else {}  # fmt: skip


def _panels(topics: Mapping[str, str]) -> Panels:
    return {f"Plot!{_id(topic)}": {
        "foxglovePanelTitle": topic, "isSynced": True, "showLegend": True,
        "paths": [{"value": f"{topic}.{number}", "enabled": True, "timestampMethod": "receiveTime", "label": number}
                  for number in IN_PANELS[schema]]} for topic, schema in topics.items() if schema in IN_PANELS}  # fmt: skip


def _space(topics: Mapping[str, str]) -> Panels:
    """3-D panel of moving frames, with meshes if the recording has them, otherwise points; or of hands before the camera."""
    if HAND_BONES in topics:
        return {"3D!space": {"foxglovePanelTitle": "hands", "followTf": CAMERA, "topics": {HAND_BONES: {"visible": True}}}}
    found = [topic for schema in IN_SPACE for topic, kind in topics.items() if kind == schema]
    if "foxglove.FrameTransforms" not in topics.values() or not found:
        return {}
    shown = [topic for topic in found if topics[topic] == topics[found[0]]]
    return {"3D!space": {"foxglovePanelTitle": "3D", "followTf": "world",
                         "topics": {topic: {"visible": topic in shown} for topic in found}}}  # fmt: skip


def _words(topics: Mapping[str, str]) -> Panels:
    """Panels of narrations and documents, and one for all logs."""
    raw = [topic for topic, schema in topics.items() if schema == ON_PAPER or topic == NARRATION]
    panels = {f"RawMessages!{_id(topic)}": {"foxglovePanelTitle": topic, "topicPath": topic} for topic in raw}
    return panels | ({"RosOut!log": {"minLogLevel": 1, "searchTerms": []}} if LOG in topics.values() else {})


def _grid(names: Sequence[str]) -> Tree:
    """Arrange panels in two rows."""
    half = (len(names) + 1) // 2
    rows = [_stack(part, "row") for part in (names[:half], names[half:]) if part]
    return _split(rows[0], rows[1], "column", 50.0) if len(rows) == 2 else rows[0]


def _stack(names: Sequence[str], direction: str) -> Tree:
    """Arrange panels in a row or column with equal shares."""
    if len(names) == 1:
        return names[0]
    return _split(names[0], _stack(names[1:], direction), direction, 100 / len(names))


def _split(first: Tree, second: Tree, direction: str, share: float) -> Tree:
    return {"first": first, "second": second, "direction": direction, "splitPercentage": share}


def _id(topic: str) -> str:
    return topic.strip("/").replace("/", "_")
