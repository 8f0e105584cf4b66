"""Tileable noise and drawing helpers for materials. Values are float32 about 0..1, images uint8 sRGB."""

from __future__ import annotations

from collections.abc import Sequence

import cv2
import numpy as np

WORDS = (
    "MUESLI",
    "OLIVA",
    "CAFFE",
    "TEA",
    "BIO",
    "RICE",
    "PASTA",
    "MILK",
    "HONEY",
    "SUGAR",
    "COCOA",
    "SALSA",
    "TOMATO",
    "CREMA",
    "FINEST",
    "ORGANIC",
    "CLASSIC",
    "ORIGINAL",
    "500 g",
    "1 L",
    "250 ml",
    "No 7",
    "EXTRA",
    "FRESH",
    "NATURAL",
    "CRUNCHY",
)
FONTS = (cv2.FONT_HERSHEY_DUPLEX, cv2.FONT_HERSHEY_TRIPLEX, cv2.FONT_HERSHEY_COMPLEX, cv2.FONT_HERSHEY_SIMPLEX)


def cloud(rng: np.random.Generator, size: int, rough: float = 1.6, stretch: tuple[float, float] = (1.0, 1.0)) -> np.ndarray:
    """Tileable fractal noise (size, size), mean .5, standard deviation about .18.

    `stretch` lengthens the noise along x, y; a higher exponent `rough` is smoother.
    """
    fy, fx = np.meshgrid(np.fft.fftfreq(size) * size, np.fft.rfftfreq(size) * size, indexing="ij")
    radius = np.sqrt((fx * stretch[0]) ** 2 + (fy * stretch[1]) ** 2)
    radius[0, 0] = np.inf
    spectrum = (rng.normal(size=radius.shape) + 1j * rng.normal(size=radius.shape)) * radius**-rough
    field = np.fft.irfft2(spectrum, s=(size, size))
    return (0.5 + 0.18 * field / field.std()).astype(np.float32)


def grain(rng: np.random.Generator, size: int) -> np.ndarray:
    """White noise (size, size), mean 0, standard deviation 1."""
    return rng.standard_normal((size, size), dtype=np.float32)


def ramp(field: np.ndarray, stops: Sequence[tuple[float, float, float]]) -> np.ndarray:
    """Map a field 0..1 to colours (h, w, 3) float32 0..255 along evenly spaced stops."""
    at = np.linspace(0, 1, len(stops))
    table = np.stack([np.interp(np.linspace(0, 1, 256), at, [s[k] for s in stops]) for k in range(3)], -1).astype(np.float32)
    return table[(np.clip(field, 0, 1) * 255).astype(np.uint8)]


def rgb(colour: Sequence[float]) -> np.ndarray:
    """Colour as (3,) float32."""
    return np.asarray(colour, np.float32)


def image(colours: np.ndarray) -> np.ndarray:
    """Convert values 0..255 to (h, w, 3) uint8."""
    return np.clip(np.asarray(colours) + 0.5, 0, 255).astype(np.uint8)


def flat(rng: np.random.Generator, size: int, colour: tuple[float, ...], mottle: float = 6.0) -> np.ndarray:
    """Image (size, size, 3) float32 of one colour with faint clouds and grain."""
    tone = (cloud(rng, size) - 0.5) * mottle * 3 + grain(rng, size) * mottle * 0.4
    return np.asarray(colour, np.float32) + tone[..., None]


def vivid(
    rng: np.random.Generator, value: tuple[float, float] = (110, 235), saturation: tuple[float, float] = (0.4, 0.9)
) -> tuple[int, ...]:
    """Random saturated colour, sRGB 0..255."""
    hsv = np.array([[[rng.integers(180), 255 * rng.uniform(*saturation), rng.uniform(*value)]]]).astype(np.uint8)
    return tuple(int(c) for c in cv2.cvtColor(hsv, cv2.COLOR_HSV2RGB)[0, 0])


def write(
    canvas: np.ndarray, text: str, centre: tuple[float, float], height: float, colour: tuple[int, ...], font: int
) -> None:
    """Draw centred text `height` px high into a uint8 canvas, narrowed to fit."""
    (width, tall), _ = cv2.getTextSize(text, font, 1.0, 2)
    scale = min(height / tall, 0.92 * canvas.shape[1] / width)
    thick = max(1, round(scale * 2))
    origin = (int(centre[0] - width * scale / 2), int(centre[1] + tall * scale / 2))
    cv2.putText(canvas, text, origin, font, scale, colour, thick, cv2.LINE_AA)


def word(rng: np.random.Generator) -> str:
    """Random word of a package."""
    return WORDS[rng.integers(len(WORDS))]


def barcode(canvas: np.ndarray, rng: np.random.Generator, x: int, y: int, w: int, h: int) -> None:
    """Draw black bars on white."""
    cv2.rectangle(canvas, (x, y), (x + w, y + h), (245, 245, 245), -1)
    at = x + 3
    while at < x + w - 4:
        bar = int(rng.integers(1, 4))
        cv2.rectangle(canvas, (at, y + 3), (min(at + bar - 1, x + w - 3), y + h - 3), (25, 25, 25), -1)
        at += bar + int(rng.integers(1, 4))


def small_print(canvas: np.ndarray, rng: np.random.Generator, x: int, y: int, w: int, h: int, colour: tuple[int, ...]) -> None:
    """Draw lines that look like small print."""
    for top in range(y, y + h - 3, 6):
        at = x
        while at < x + w - 4:
            run = int(rng.integers(4, 16))
            cv2.line(canvas, (at, top), (min(at + run, x + w), top), colour, 2)
            at += run + 4
