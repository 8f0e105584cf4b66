"""Detect the landmarks of all hands in sampled frames of a clip: 21 keypoints, in the picture and in metres.

Reads   FileTree of the media, Footage; files of MediaPipe's palm detector and landmark network, fetched by `make setup`
Writes  HandLandmarks: detections in frames `look_s` apart, at up to width_px x height_px
Method  palms are detected in the whole picture and in square windows, small ones where few hands are found; the landmark network
        computes keypoints and presence in the region of each palm; hands are tracked into the frames before and after
Fails   when the media cannot be read, or a model is not a TFLite network
Paper   BlazePalm and MediaPipe Hands (Zhang et al. 2020); stands in for annotated hands (VISOR)
"""

from __future__ import annotations

from dataclasses import dataclass

from afford.extraction.landmarks.parameters import Search
from schemas.files import FileTree
from schemas.hands import HandLandmarks
from schemas.video import Footage

LIBRARIES = ("numpy", "opencv-python-headless", "av", "pillow", "scipy", "torch")
THREADS = 1
MEMORY_GIB = 1.2
TIMEOUT_S = 86400.0  # reports no progress: minutes for most clips, hours for a long one


@dataclass(frozen=True)
class Params(Search):
    """Parameters of `hand_landmarks`."""

    model: str = ""
    """folder of the two TFLite files; by default those of `make setup`"""


def run(media: FileTree, footage: Footage, params: Params, weights: FileTree) -> HandLandmarks:
    """Detect landmarks in a clip; ValueError names the file when media or model cannot be used."""
    from afford.extraction.hands.proposals import HandColours
    from afford.extraction.landmarks.search import search_clip
    from afford.models.weights import weights_root

    return search_clip(media, footage, weights_root(weights), params, HandColours())
