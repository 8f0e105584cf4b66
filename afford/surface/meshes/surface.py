"""What every mesh reader gives: triangles as the file orders them, and how each corner of them is coloured."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import chain

import numpy as np

from afford.common.bounded import TooLargeError
from afford.common.errors import SourceError

GREY = (190, 190, 190)
"""sRGB of what nobody gave a colour"""
MAX_TRIANGLES = 10_000_000
"""of one object, copies of one mesh counted each: a surface takes 110 bytes a triangle, and 60,000 triangles are kept"""


@dataclass(frozen=True, eq=False)
class Surface:
    """Triangles of a file, nothing mended yet."""

    vertices: np.ndarray
    """(v, 3) float64 in the unit of the file"""
    faces: np.ndarray
    """(f, 3) int64 vertex indices"""
    uv: np.ndarray
    """(f, 3, 2) float64 texture coordinates of each corner, v upwards; beyond 0..1 the image repeats"""
    paint: np.ndarray
    """(f,) int64 index into `images`; -1: the face has corner colours"""
    images: tuple[np.ndarray, ...]
    """(h, w, 3) uint8 sRGB; (1, 1, 3) for a plain material"""
    colour: np.ndarray
    """(f, 3, 3) uint8 sRGB corner colours, read where `paint` is -1"""
    line: np.ndarray
    """(f,) int64 which face of the file a triangle was cut from; -1 where the format keeps no order of its own"""
    group: np.ndarray
    """(f,) int64 index into `groups`"""
    groups: tuple[str, ...]
    """names of OBJ groups, glTF nodes or URDF links"""
    notes: tuple[tuple[str, int], ...] = ()
    """what the reader had to leave out, and how often"""
    unit: str = ""
    """m where the format says so; '' where it says nothing"""


def plain_surface(vertices: np.ndarray, faces: np.ndarray, colour: Sequence[int] = GREY, group: str = "") -> Surface:
    """A surface of one colour."""
    count = len(faces)
    image = np.asarray(colour, np.uint8).reshape(1, 1, 3)
    return Surface(np.asarray(vertices, np.float64).reshape(-1, 3), np.asarray(faces, np.int64).reshape(-1, 3),
                   np.zeros((count, 3, 2)), np.zeros(count, np.int64), (image,), np.zeros((count, 3, 3), np.uint8),
                   np.arange(count), np.zeros(count, np.int64), (group,))  # fmt: skip


def with_corner_colours(surface: Surface, colours: np.ndarray) -> Surface:
    """The surface with (f, 3, 3) uint8 corner colours instead of images."""
    return replace(surface, paint=np.full(len(surface.faces), -1), colour=np.asarray(colours, np.uint8), images=())


def transform_surface(surface: Surface, T: np.ndarray) -> Surface:
    """The surface under the affine (4, 4) `T`. Faces that `T` mirrors are turned again."""
    placed = replace(surface, vertices=surface.vertices @ T[:3, :3].T + T[:3, 3])
    if np.linalg.det(T[:3, :3]) > 0:
        return placed
    return replace(placed, faces=placed.faces[:, ::-1], uv=placed.uv[:, ::-1], colour=placed.colour[:, ::-1])


def check_triangles(count: int, name: str) -> None:
    """TooLargeError for more triangles than one object may have."""
    if count > MAX_TRIANGLES:
        raise TooLargeError(name, f"at most {MAX_TRIANGLES:,} triangles", f"{count:,}", "simplify the mesh, or use fewer copies")


def check_corners(faces: np.ndarray, vertices: int, name: str) -> None:
    """SourceError when a face names a vertex that is not there."""
    if faces.size and (faces.min() < 0 or faces.max() >= vertices):
        bad = faces.max() if faces.min() >= 0 else faces.min()
        raise SourceError(name, f"vertex indices 0..{vertices - 1}", str(bad), "export the mesh again")


def join_surfaces(surfaces: Sequence[Surface], unit: str) -> Surface:
    """One surface, faces in order; faces of the file are numbered on, images and groups are listed one after another."""
    if len(surfaces) == 1:
        return replace(surfaces[0], unit=unit)
    corners, images, groups, lines = ([0] for _ in range(4))
    for s in surfaces[:-1]:
        corners.append(corners[-1] + len(s.vertices))
        images.append(images[-1] + len(s.images))
        groups.append(groups[-1] + len(s.groups))
        lines.append(lines[-1] + int(s.line.max(initial=-1)) + 1)
    shifted = [
        (s.faces + c, np.where(s.paint < 0, -1, s.paint + i), s.group + g, np.where(s.line < 0, -1, s.line + n))
        for s, c, i, g, n in zip(surfaces, corners, images, groups, lines, strict=True)
    ]
    faces, paint, group, line = (np.concatenate(column) for column in zip(*shifted, strict=True))
    vertices, uv, colour = (np.concatenate([getattr(s, name) for s in surfaces]) for name in ("vertices", "uv", "colour"))
    return Surface(vertices, faces, uv, paint, tuple(chain(*(s.images for s in surfaces))), colour, line, group,
                   tuple(chain(*(s.groups for s in surfaces))), tuple(chain(*(s.notes for s in surfaces))), unit)  # fmt: skip
