"""Camera response: linear radiance -> a picture as a small camera takes it.

Exposure follows the picture's own brightness. Then glare, white balance, contrast, vignette, blur of motion, noise and JPEG follow,
all drawn from the given random state.
"""

from __future__ import annotations

import cv2
import numpy as np

from afford.synthetic.sensor import add_image_noise

MEDIAN = (0.12, 0.38)
"""range of the median radiance after exposure"""


def develop(linear: np.ndarray, rng: np.random.Generator) -> np.ndarray:
    """Develop linear RGB (h, w, 3) float32 to (h, w, 3) uint8 sRGB."""
    x = linear * (np.exp(rng.uniform(*np.log(MEDIAN))) / max(float(np.median(linear)), 1e-4))
    x = glare(x, float(rng.uniform(0.0, 0.12)))
    x = x * np.exp(rng.normal(0, 0.07, 3))
    x = vignette(x, float(rng.uniform(0.0, 0.35)))
    if rng.random() < 0.3:
        x = motion_blur(x, float(rng.uniform(1.0, 5.0)), float(rng.uniform(0, np.pi)))
    picture = film(x, float(rng.uniform(0.9, 1.35)), float(rng.uniform(0.75, 1.15)))
    picture = add_image_noise(picture, rng, *(float(rng.uniform(0.3, 1.5)) * np.array([1.6, 3.2])))
    return compress(picture, int(rng.integers(45, 96)))


def glare(x: np.ndarray, share: float) -> np.ndarray:
    """Spread a share of the light of bright places over their surroundings."""
    bright = np.minimum(np.maximum(x - 0.9, 0), 8).astype(np.float32)
    return x + share * cv2.GaussianBlur(bright, (0, 0), x.shape[1] / 60)


def vignette(x: np.ndarray, share: float) -> np.ndarray:
    """Darken the corners by this share."""
    v, u = (np.linspace(-1, 1, side)[:, None] for side in x.shape[:2])
    return np.asarray(x * (1 - share * 0.5 * (v**2 + u.T**2))[..., None])


def motion_blur(x: np.ndarray, length_px: float, angle_rad: float) -> np.ndarray:
    """Average over a straight motion of the camera."""
    steps = np.linspace(-0.5, 0.5, 9) * length_px
    shifts = [np.array([[1, 0, s * np.cos(angle_rad)], [0, 1, s * np.sin(angle_rad)]]) for s in steps]
    size = x.shape[1::-1]
    moved = [cv2.warpAffine(x.astype(np.float32), shift, size, borderMode=cv2.BORDER_REPLICATE) for shift in shifts]
    return np.asarray(np.mean(moved, axis=0))


def film(x: np.ndarray, contrast: float, saturation: float) -> np.ndarray:
    """Roll off highlights, encode for a display, and set contrast and saturation; (h, w, 3) uint8."""
    x = np.maximum(x, 0)
    rolled = np.where(x < 0.6, x, 0.6 + 0.4 * (1 - np.exp(-(x - 0.6) / 0.4)))
    shown = np.clip(rolled, 0, 1) ** (1 / 2.2)
    shown = np.clip(0.5 + contrast * (shown - 0.5), 0, 1)
    grey = shown.mean(-1, keepdims=True)
    return np.asarray(np.clip(255 * (grey + saturation * (shown - grey)) + 0.5, 0, 255).astype(np.uint8))


def compress(picture: np.ndarray, quality: int) -> np.ndarray:
    """Encode and decode as JPEG."""
    done, data = cv2.imencode(".jpg", picture[..., ::-1], [cv2.IMWRITE_JPEG_QUALITY, quality])
    if not done:
        raise ValueError("a picture cannot be encoded as JPEG")
    return np.ascontiguousarray(cv2.imdecode(data, cv2.IMREAD_COLOR)[..., ::-1])
