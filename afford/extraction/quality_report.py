"""Quality report of many clips: metrics, a Markdown table, a plot and a contact sheet."""

from __future__ import annotations

import json
from collections.abc import Iterable
from pathlib import Path

import cv2
import numpy as np

from afford.common.drawing import draw_label
from afford.common.figures import Figure
from afford.common.files import tree
from afford.common.image_files import encode_jpeg
from afford.common.palette import LEFT, RIGHT, Palette, colours_of
from afford.extraction.quality_score import Aligned
from schemas.affordance import Affordances
from schemas.benchmark import ClipScores
from schemas.files import FileTree
from schemas.masks import CompleteObjects, Tracks
from schemas.video import Frames, Inpainted

ROWS: tuple[tuple[str, str, dict[str, str]], ...] = (
    ("masks: J, key frames 15 apart", "densify.j.gap15", {"nearest key": "baseline.nearest.j.gap15"}),
    ("masks: F, key frames 15 apart", "densify.f.gap15", {"nearest key": "baseline.nearest.f.gap15"}),
    ("masks: J, key frames 30 apart", "densify.j.gap30", {"nearest key": "baseline.nearest.j.gap30"}),
    ("masks: F, key frames 30 apart", "densify.f.gap30", {"nearest key": "baseline.nearest.f.gap30"}),
    ("inpainting: PSNR inside the hands, dB", "inpaint.psnr_db", {"cv2.inpaint": "baseline.telea.psnr_db"}),
    ("... objects under the hands, dB", "inpaint.object_psnr_db", {"cv2.inpaint": "baseline.telea.object_psnr_db"}),
    ("... background under the hands, dB", "inpaint.background_psnr_db",
     {"cv2.inpaint": "baseline.telea.background_psnr_db"}),
    ("completion: amodal IoU", "completion.amodal_iou",
     {"visible mask": "baseline.visible.amodal_iou", "convex hull": "baseline.hull.amodal_iou"}),
    ("completion: hidden-part IoU", "completion.hidden_iou", {"convex hull": "baseline.hull.hidden_iou"}),
    ("affordance: IoU", "affordance.iou", {}),
    ("affordance: precision", "affordance.precision", {}),
    ("affordance: recall", "affordance.recall", {}),
    ("affordance: IoU, false contacts counted", "affordance.iou_strict", {}),
    ("contact told right", "contact.accuracy", {}),
)  # fmt: skip


def write_report(scores: tuple[ClipScores, ...], folder: Path) -> FileTree:
    """Write the four files of the report into `folder`; ValueError without a standard clip."""
    standard = [clip for clip in scores if not clip.hard]
    if not standard:
        raise ValueError("the report needs at least one standard clip; set extraction_report.standard_clips to 1 or more")
    hard = [clip for clip in scores if clip.hard]
    metrics = means(standard) | {f"hard.{name}": score for name, score in means(hard).items()}
    metrics |= {"clips.standard": len(standard), "clips.hard": len(hard), "clips.frames": sum(clip.frames for clip in scores)}
    (folder / "metrics.json").write_text(json.dumps(metrics, indent=1, sort_keys=True) + "\n")
    (folder / "report.md").write_text(table(metrics, len(standard), len(hard)) + per_clip(scores))
    plot(scores, folder / "scores.png")
    (folder / "sheet.jpg").write_bytes(encode_jpeg(contact_sheet(scores), JPEG_QUALITY).tobytes())
    return tree("extraction_report", folder)


def means(clips: Iterable[ClipScores]) -> dict[str, float]:
    """Compute means over all items of all clips, by name, and the gain of inpainting over `cv2.inpaint`."""
    total: dict[str, float] = {}
    count: dict[str, int] = {}
    for clip in clips:
        for score in clip.scores:
            total[score.name] = total.get(score.name, 0.0) + score.total
            count[score.name] = count.get(score.name, 0) + score.count
    out = {name: total[name] / count[name] for name in sorted(total)}
    if "inpaint.psnr_db" in out:
        out["inpaint.gain_db"] = out["inpaint.psnr_db"] - out["baseline.telea.psnr_db"]
    return out


def table(metrics: dict[str, float], standard: int, hard: int) -> str:
    """Format a Markdown table of the metrics and the baselines, on standard and on hard clips."""
    head = f"| measure | {standard} standard clips | baselines | {hard} hard clips | baselines |\n|---|---|---|---|---|\n"
    rows = []
    for title, name, plain in ROWS:
        cells = []
        for prefix in ("", "hard."):
            cells += [_cell(metrics, prefix + name), _baseline_cell(metrics, plain, prefix)]
        rows.append(f"| {title} | " + " | ".join(cells) + " |\n")
    return "# Extraction quality on synthetic clips\n\n" + head + "".join(rows)


def _baseline_cell(metrics: dict[str, float], plain: dict[str, str], prefix: str) -> str:
    return ", ".join(f"{title} {_cell(metrics, prefix + name)}" for title, name in plain.items())


def _cell(metrics: dict[str, float], name: str) -> str:
    if name not in metrics:
        return "-"
    return f"{metrics[name]:.2f}" if name.endswith("_db") else f"{metrics[name]:.3f}"


def per_clip(scores: tuple[ClipScores, ...]) -> str:
    """Format a Markdown table of the main measures, one row per clip."""
    names = [name for _, name, _ in ROWS[:5]] + ["completion.amodal_iou", "completion.hidden_iou", "affordance.iou"]
    out = ["\n## Clip by clip\n\n| clip | hard | " + " | ".join(names) + " |\n|" + "---|" * (len(names) + 2) + "\n"]
    for clip in scores:
        found = means([clip])
        out.append(f"| {clip.clip_id} | {', '.join(clip.hard)} | " + " | ".join(_cell(found, n) for n in names) + " |\n")
    return "".join(out)


def plot(scores: tuple[ClipScores, ...], path: Path) -> None:
    """Plot bars per clip for masks, completion and affordance; hard clips are hatched."""
    figure = Figure(figsize=(11, 7), layout="constrained")
    panels = figure.subplots(3, 1, sharex=True)
    names = [clip.clip_id for clip in scores]
    found = [means([clip]) for clip in scores]
    series = (
        ("J at gap 15 and 30", ("densify.j.gap15", "densify.j.gap30", "baseline.nearest.j.gap15")),
        ("complete objects, IoU", ("completion.amodal_iou", "completion.hidden_iou", "baseline.hull.hidden_iou")),
        ("affordance", ("affordance.iou", "affordance.precision", "affordance.recall")),
    )
    for panel, (title, keys) in zip(panels, series, strict=True):
        for k, key in enumerate(keys):
            bars = panel.bar(np.arange(len(names)) + 0.27 * (k - 1), [f.get(key, 0.0) for f in found], 0.25, label=key)
            for bar, clip in zip(bars, scores, strict=True):
                bar.set_hatch("//" if clip.hard else "")
        panel.set(title=title, ylim=(0, 1))
        panel.legend(fontsize=8, loc="lower left")
    panels[-1].set_xticks(range(len(names)), names, rotation=30, fontsize=8)
    figure.savefig(path, dpi=90, metadata={"Software": None})


def contact_sheet(scores: tuple[ClipScores, ...]) -> np.ndarray:
    """Stack the picture rows of all clips under a line of titles, (h, w, 3) uint8 RGB."""
    rows = [decode_jpeg(clip.sheet_jpeg) for clip in scores]
    width = rows[0].shape[1]
    head = np.full((24, width, 3), 255, np.uint8)
    for i, title in enumerate(TITLES):
        cv2.putText(head, title, (i * width // len(TITLES) + 6, 17), cv2.FONT_HERSHEY_SIMPLEX, 0.5, (0, 0, 0), 1, cv2.LINE_AA)
    return np.vstack([head, *rows])


JPEG_QUALITY = 88
AT_PX, LETTERS_PX = (6, 4), 13
"""position of the label of a row, and height of its letters"""
TITLES = ("frame", "masks", "hands removed", "truth", "complete objects", "affordance")


def clip_row(
    aligned: Aligned,
    frames: Frames,
    tracks: Tracks,
    inpainted: Inpainted,
    complete: CompleteObjects,
    affordances: Affordances,
    width_px: int,
) -> np.ndarray:
    """Encode six pictures of a clip side by side as JPEG bytes (b,) uint8."""
    t = most_occluded_frame(aligned)
    rgb = frames.rgb[t]
    shown = [
        rgb,
        paint(rgb, tracks.masks[:, t], colours_of(tracks.entities)),
        inpainted.rgb[t],
        aligned.truth.rgb_no_hands_shadow[aligned.at[t]],
        paint(inpainted.rgb[t], complete.masks[:, t], colours_of(complete.entities)),
        paint(inpainted.rgb[t], affordances.masks[:, t], (LEFT, RIGHT)),
    ]
    name = f"{aligned.truth.clip_id} #{frames.frame[t]}"
    row = np.hstack([_fit(image, width_px) for image in shown])
    draw_label(row, name + (" hard: " + ", ".join(aligned.truth.hard) if aligned.truth.hard else ""), AT_PX, LETTERS_PX)
    return encode_jpeg(row, JPEG_QUALITY)


def most_occluded_frame(aligned: Aligned) -> int:
    """Find the row of the frame in which hands hide most pixels of the objects that they touch."""
    hands = aligned.hands()
    hidden = np.zeros(len(aligned.at))
    for t in range(len(aligned.at)):
        for entity_id in {aligned.touched(0, t), aligned.touched(1, t)} - {""}:
            hidden[t] += np.count_nonzero(aligned.amodal(entity_id)[t] & hands[t])
    return int(hidden.argmax())


def paint(rgb: np.ndarray, masks: np.ndarray, colours: Palette) -> np.ndarray:
    """Tint and outline each of the masks (n, h, w) bool in its own colour on a copy of `rgb`."""
    out = rgb.copy()
    for mask, colour in zip(masks, colours, strict=True):
        out[mask] = (0.45 * out[mask] + 0.55 * np.array(colour, np.float32)).astype(np.uint8)
        outline, _ = cv2.findContours(mask.astype(np.uint8), cv2.RETR_LIST, cv2.CHAIN_APPROX_NONE)
        cv2.drawContours(out, outline, -1, colour, 1)
    return out


def decode_jpeg(data: np.ndarray) -> np.ndarray:
    """Decode JPEG bytes (b,) uint8 to (h, w, 3) uint8 RGB."""
    bgr = cv2.imdecode(data, cv2.IMREAD_COLOR)
    if bgr is None:
        raise ValueError(f"cannot decode {data.size} bytes as JPEG")
    return bgr[..., ::-1]


def _fit(rgb: np.ndarray, width_px: int) -> np.ndarray:
    height_px = round(rgb.shape[0] * width_px / rgb.shape[1])
    return cv2.resize(rgb, (width_px, height_px), interpolation=cv2.INTER_AREA)
