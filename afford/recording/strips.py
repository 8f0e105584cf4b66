"""Strips of the contact sheet for objects, grasps, and recordings with pictures or curves of their own."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np
from mcap.reader import make_reader
from PIL import Image, ImageDraw, ImageFont

from afford.common.drawing import TILE_BACKGROUND, TILE_INK, TILE_W, pad_tile, title_row
from afford.recording.grasps import IMAGE, LOG, STATE
from afford.recording.moments import IMAGE_SCHEMA, Moment, moments, tile_of
from afford.recording.objects import CANDIDATES, NEGATIVE, POSITIVE, VIEW

PICTURES, PICTURE_TOPICS = 4, 6
"""pictures of a topic, maximum number of topics"""
SCALAR = "affordance.v1.Scalar"
PLOT_H, CURVES, MARGIN = 150, 12, 22
LINE = (86, 180, 233)


def picture_strips(path: Path) -> list[np.ndarray]:
    """Title and strip of pictures for each topic, then curves; [] for a recording with neither."""
    kinds = _kinds(path)
    strips: list[np.ndarray] = []
    for topic in sorted(topic for topic, kind in kinds.items() if kind == IMAGE_SCHEMA)[:PICTURE_TOPICS]:
        found = list(moments(path, [topic]))
        chosen = [found[k] for k in dict.fromkeys(np.linspace(0, len(found) - 1, PICTURES).round().astype(int).tolist())]
        width = PICTURES * TILE_W // max(2, len(chosen))
        tiles = [tile for moment in chosen if (tile := tile_of(moment, topic, "", width, False)) is not None]
        strips += [title_row([f"{path.stem}   {topic}"], PICTURES * TILE_W), _row(tiles)]
    curves = sorted(topic for topic, kind in kinds.items() if kind == SCALAR)[:CURVES]
    plots = _plots(path, curves) if curves else []
    if plots and not strips:
        strips = [title_row([f"{path.stem}   curves"], PICTURES * TILE_W)]
    return strips + [_row(plots[n : n + PICTURES]) for n in range(0, len(plots), PICTURES)]


def _row(tiles: list[np.ndarray]) -> np.ndarray:
    """Tiles side by side, padded to the height of the tallest."""
    height = max(tile.shape[0] for tile in tiles)
    padded = []
    for tile in tiles:
        ground = np.full((height, tile.shape[1], 3), TILE_BACKGROUND, np.uint8)
        ground[: tile.shape[0]] = tile[..., :3] if tile.ndim == 3 else tile[..., None]
        padded.append(pad_tile(ground))
    return np.concatenate(padded, axis=1)


def _plots(path: Path, topics: list[str]) -> list[np.ndarray]:
    found: dict[str, list[tuple[float, float]]] = {topic: [] for topic in topics}
    for moment in moments(path, topics):
        for topic in moment.values:
            found[topic].append(_point(moment, topic))
    return [_plot(topic, np.array(points)) for topic, points in found.items() if points]


def _point(moment: Moment, topic: str) -> tuple[float, float]:
    return moment.time_ns / 1e9, float(moment.one(topic).value)


def _plot(topic: str, points: np.ndarray) -> np.ndarray:
    """Plot of a curve over media time between its minimum and maximum, (PLOT_H, TILE_W, 3) uint8."""
    page = Image.new("RGB", (TILE_W, PLOT_H), TILE_BACKGROUND)
    draw, letters = ImageDraw.Draw(page), ImageFont.load_default(12)
    points = points[np.isfinite(points).all(1)]
    draw.text((8, 4), topic, fill=TILE_INK, font=letters)
    if len(points):
        low, high = points.min(0), points.max(0)
        share = (points - low) / np.maximum(high - low, 1e-12)
        x = 8 + share[:, 0] * (TILE_W - 16)
        y = PLOT_H - 8 - share[:, 1] * (PLOT_H - 8 - 2 * MARGIN)
        draw.line(list(zip(x.tolist(), y.tolist(), strict=True)), fill=LINE, width=2)
        draw.text((8, MARGIN), f"{low[1]:.4g} to {high[1]:.4g}", fill=LINE, font=letters)
    return np.asarray(page)


def _kinds(path: Path) -> dict[str, str]:
    """Schema of every topic that has messages."""
    with path.open("rb") as stream:
        summary = make_reader(stream).get_summary()
    if summary is None or summary.statistics is None:
        return {}
    counts = summary.statistics.channel_message_counts
    return {one.topic: summary.schemas[one.schema_id].name for one in summary.channels.values() if counts.get(one.id)}


OBJECT_VIEWS, OBJECT_SIDE, OBJECT_TASKS = 6, 190, 4
"""views, width of a tile in px, maximum number of tasks"""
TITLES = {NEGATIVE: "not to be touched", POSITIVE: "to be touched"}
"""first word of topics -> title of their strips"""


def is_object(path: Path) -> bool:
    """Return True for a recording of an object."""
    return VIEW in _topics(path)


def object_strips(path: Path) -> list[np.ndarray]:
    """Six views of an object, then its candidates and the negative or positive affordance of each task, with titles."""
    shown = list(moments(path))[:OBJECT_VIEWS]
    there = _topics(path)
    tasks = sorted(topic for topic in there if _first_word(topic) in TITLES and topic.endswith("/overlay"))[:OBJECT_TASKS]
    candidates = {"candidates": CANDIDATES} if CANDIDATES in there else {}
    layers = {path.stem: "", **candidates, **{_task_title(topic): topic for topic in tasks}}
    strips = []
    for title, overlay in layers.items():
        shades = _first_word(overlay) in TITLES
        tiles = [pad_tile(t) for moment in shown if (t := tile_of(moment, VIEW, overlay, OBJECT_SIDE, not shades)) is not None]
        strip = np.concatenate(tiles, axis=1)
        strips += [title_row([title], strip.shape[1], OBJECT_SIDE), strip]
    return strips


def _task_title(topic: str) -> str:
    """Title of a task's overlay topic: /negative_affordance/0_cut_bread/overlay -> not to be touched: cut bread."""
    return f"{TITLES[_first_word(topic)]}: " + topic.split("/")[2].partition("_")[2].replace("_", " ")


def _first_word(topic: str) -> str:
    return "/" + topic.split("/")[1] if topic else ""


def _topics(path: Path) -> set[str]:
    with path.open("rb") as stream:
        summary = make_reader(stream).get_summary()
    return {channel.topic for channel in summary.channels.values()} if summary else set()


GRASP_MOMENTS, GRASP_SIDE, GRASP_EPISODES = 6, 220, 8
"""moments of an episode, width of a tile in px, maximum number of episodes"""


def is_grasp(path: Path) -> bool:
    """Return True for a recording of grasps."""
    with path.open("rb") as stream:
        summary = make_reader(stream).get_summary()
    return summary is not None and any(channel.topic == IMAGE for channel in summary.channels.values())


def grasp_strips(path: Path) -> list[np.ndarray]:
    """Title and strip of pictures for each episode, with its outcome."""
    strips = []
    for episode in _episodes(path)[:GRASP_EPISODES]:
        chosen = [episode[int(k)] for k in np.linspace(0, len(episode) - 1, GRASP_MOMENTS)]
        tiles = [pad_tile(t) for moment in chosen if (t := tile_of(moment, IMAGE, "", GRASP_SIDE)) is not None]
        strip = np.concatenate(tiles, axis=1)
        strips += [title_row([_episode_title(episode)], strip.shape[1], GRASP_SIDE), strip]
    return strips


def _episodes(path: Path) -> list[list[Moment]]:
    """Moments of each episode; an episode begins with its log line."""
    found: list[list[Moment]] = []
    for moment in moments(path, [IMAGE, LOG, STATE]):
        if moment.one(LOG) is not None:
            found.append([])
        found[-1].append(moment)
    return found


def _episode_title(episode: Sequence[Moment]) -> str:
    end = episode[-1].one(STATE)
    goal = "reached the goal" if end.success else "never at the goal"
    return f"{episode[0].one(LOG).message}   {goal}, {end.as_violation_pct:.0f} % of fingertips unsafe at the end"
