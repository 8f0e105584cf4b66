"""the two hands of a clip over time -> hand motions in a world with z up, in the form of recorded hand motion.

Reads   HandTracks; Clip with key frames, whose contacts name the touched objects
Writes  VideoMotions: one HandMotion for each uninterrupted run of a hand; remarks on what was left out
Method  runs of confident, possible poses; short gaps are interpolated (monotone cubic); even resampling; the camera's axes turned
        by an assumed pitch, the lowest keypoint at z = 0; phases from contact, aperture and height
Fails   ValueError for a parameter out of range. A clip without usable runs gives no motion and a remark
Paper   AffordDex, HTI: human hand trajectories; the paper takes them from recordings with known cameras
"""

from __future__ import annotations

from dataclasses import dataclass

from schemas.hands import HandTracks, VideoMotions
from schemas.video import Clip

LIBRARIES = ("numpy", "scipy")
THREADS = 1
MEMORY_GIB = 1.0


@dataclass(frozen=True)
class Params:
    """Parameters of hand_motion."""

    rate_hz: float = 30.0
    """frames a second of the motions"""
    min_s: float = 0.6
    """shortest run of a hand that becomes a motion"""
    max_gap_s: float = 0.35
    """longest time without keypoints within one motion; it is interpolated"""
    min_confidence: float = 0.3
    """least mean confidence of the keypoints of a frame"""
    max_bent_back_m: float = 0.02
    """largest mean distance of fingertips behind the back of the hand in a frame; beyond it the pose is wrong"""
    min_contact: float = 0.5
    """probability from which a finger touches the object"""
    key_s: float = 0.5
    """where fingers say nothing, the contact of a key frame counts for this long before and after it"""
    pitch_deg: float = 40.0
    """assumed angle of the camera below the horizon, which decides what is up; 0 looks straight ahead, 90 straight down"""
    close_s: float = 0.6
    """longest time before a contact in which fingers close"""
    lift_m: float = 0.03
    """height above the place of first contact from which the phase is `lift`"""
    slow_m_s: float = 0.08
    """speed of the palm below which a free hand does not reach"""


def run(hands: HandTracks, clip: Clip, params: Params) -> VideoMotions:
    """Take the motions of the hands of one clip."""
    from dataclasses import asdict

    from afford.grasping.motion.from_video import VideoMotionOptions, video_motions

    for name in ("rate_hz", "min_s", "max_gap_s", "key_s", "close_s"):
        if getattr(params, name) <= 0:
            raise ValueError(f"hand_motion, {name}: expected a number above zero, got {getattr(params, name):g}")
    if not -90 <= params.pitch_deg <= 90:
        raise ValueError(f"hand_motion, pitch_deg: expected -90 to 90 degrees, got {params.pitch_deg:g}")
    return video_motions(hands, clip, VideoMotionOptions(**asdict(params)))
