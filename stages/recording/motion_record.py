"""Record human hand motions and their retargeting.

Reads   HandModel; HandMotion of every clip (motion_read or motion_synthesise); the Retargeted of each (hand_retarget)
Writes  FileTree of one file, <stage>.mcap: the person's keypoints and bones, the links of the robot hand, the errors, pictures of
        both; the parameters
Method  clips follow each other a second apart; links by forward kinematics; a software renderer
Fails   without clips, or when a clip was not retargeted
Paper   AffordDex, HTI: the motions that are imitated
"""

from __future__ import annotations

from dataclasses import dataclass

from schemas.files import FileTree
from schemas.hand import HandModel, HandMotion, Retargeted
from schemas.spec import Context

LIBRARIES = ("numpy", "numba", "scipy", "trimesh", "opencv-python-headless", "pillow", "mcap", "mcap-protobuf-support",
             "foxglove-schemas-protobuf", "protobuf", "zstandard", "blake3")  # fmt: skip
THREADS = 1
MEMORY_GIB = 1.0


@dataclass(frozen=True)
class Params:
    """Parameters of `motion_record`."""

    stage: str = "motion_read"
    """stage that produced the motions; its name is the first word of their topics"""
    clips: int = 6
    """number of recorded clips, spread over all; 0 for all"""
    pictures_hz: float = 10.0
    """maximum number of pictures per second"""
    width: int = 320
    """width of the pictures, px"""
    height: int = 240
    """height of the pictures, px"""
    parameters: tuple[tuple[str, str], ...] = ()
    """(stage, its parameters as JSON)"""


def run(hand: HandModel, motions: tuple[HandMotion, ...], clips: tuple[Retargeted, ...], params: Params,
        ctx: Context) -> FileTree:  # fmt: skip
    """Draw some of the clips and write the recording."""
    import numpy as np

    from afford.grasping.env.rendering import MotionRenderer
    from afford.recording.mcap_files import as_tree, write_recording
    from afford.recording.motions import MotionClip, record_motions
    from afford.recording.provenance import of_value, with_parameters

    fitted = {one.name: one for one in clips}
    if missing := [one.name for one in motions if one.name not in fitted]:
        raise ValueError(f"motion_record: no retargeted clip of the motion {missing[0]}; give one for each motion")
    if not motions or params.clips < 0 or params.pictures_hz <= 0:
        raise ValueError(f"motion_record: expected motions, clips of 0 or more and pictures_hz above 0, got {len(motions)} motions,"
                         f" {params.clips} and {params.pictures_hz:g}")
    chosen = np.linspace(0, len(motions) - 1, min(params.clips or len(motions), len(motions))).round().astype(int)
    shown = [MotionClip(motions[k], fitted[motions[k].name]) for k in dict.fromkeys(chosen.tolist())]
    recording = record_motions(params.stage, shown, MotionRenderer(hand, params.width, params.height), params.pictures_hz)
    recording = of_value(recording, "hand_model", hand)
    for clip in shown:
        recording = of_value(recording, params.stage, clip.motion, clip.motion.name)
        recording = of_value(recording, "hand_retarget", clip.fitted, clip.fitted.name)
    path = ctx.scratch / f"{params.stage}.mcap"
    write_recording(path, with_parameters(recording, params.parameters))
    return as_tree(params.stage, path)
