"""Read a grasp scene from files: depth, camera, masks as `predict` writes them, and regions that no hand may touch."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from afford.common.bounded import load_npy, reason
from afford.common.errors import SourceError
from afford.common.files import RECORD
from afford.common.image_files import finite_array, read_depth, read_image, read_intrinsics, read_json, read_png
from schemas.affordance import TAKES, TAXONOMY
from schemas.grasp import GraspScene
from schemas.video import SIDES

FITS = "masks, depth and picture must show the same pixels"


@dataclass(frozen=True)
class SceneFiles:
    """Paths and options of a scene."""

    depth: Path
    masks: Path | None = None
    """folder of a prediction: left.png, right.png, prediction.json"""
    left: Path | None = None
    right: Path | None = None
    image: Path | None = None
    intrinsics: Path | None = None
    focal_px: float | None = None
    negative: Path | None = None
    """mask (.png), points in the camera's frame (.npy), or negative.json of `run negative-affordance`"""
    object_pose: Path | None = None
    """T_cam_obj as JSON, for negative.json"""
    taxonomy: str = ""
    """one of TAXONOMY; '' for that of the prediction, or for the hands that have a mask"""
    hands: str = "auto"
    """auto, left, right or both"""


def read(files: SceneFiles) -> GraspScene:
    """Read the scene; SourceError when a file is missing or does not fit the others."""
    depth_m = read_depth(files.depth)
    region = _regions(files, depth_m.shape)
    mask, points = _negative(files, depth_m.shape)
    return GraspScene(files.depth.stem, depth_m, _picture(files.image, depth_m), _camera(files, depth_m.shape), region,
                      _hands(files, region), mask, points)


def check_regions(files: SceneFiles, scene: GraspScene) -> None:
    """Check the regions; SourceError names the file when no hand is in use, or a hand in use has no pixel with depth."""
    places = _places(files)
    if not scene.hands.any():
        raise SourceError(" and ".join(str(path) for path in places if path), "a region for a hand", "empty masks",
                          "predict again, or choose a hand with --hands")
    for side, path, mask, used in zip(SIDES, places, scene.region, scene.hands, strict=True):
        if used and not (mask & (scene.depth_m > 0)).any():
            empty = "an empty mask" if path else "no mask"
            got = f"{int(mask.sum())} pixel(s), none with depth in {files.depth}" if mask.any() else empty
            raise SourceError(str(path or f"--{side}"), f"a region with depth for the {side} hand", got,
                              "check masks and depth, or leave that hand out with --hands")


def read_mask(path: Path, shape: tuple[int, ...]) -> np.ndarray:
    """Read a PNG as (h, w) bool, true where it is not 0."""
    try:
        found = read_png(path)
    except OSError as error:
        raise SourceError(str(path), "a mask (PNG)", reason(error), "check the path") from error
    flat = found.max(axis=2) if found.ndim == 3 else found
    if flat.shape != shape:
        raise SourceError(str(path), f"a mask of the depth's size, {shape[1]} x {shape[0]}", f"{flat.shape[1]} x {flat.shape[0]}",
                          FITS)  # fmt: skip
    return flat > 0


def _places(files: SceneFiles) -> list[Path | None]:
    """Return the mask files of the left and the right hand.

    A prediction folder with the mask of one hand concerns that hand only.
    """
    inside: list[Path | None] = [files.masks / f"{side}.png" if files.masks else None for side in SIDES]
    if any(path and path.exists() for path in inside):
        inside = [path if path and path.exists() else None for path in inside]
    return [given or path for given, path in zip((files.left, files.right), inside, strict=True)]


def _regions(files: SceneFiles, shape: tuple[int, ...]) -> np.ndarray:
    paths = _places(files)
    if not any(paths):
        raise SourceError("masks", "a folder of `predict` or a mask of a hand", "neither",
                          "give --masks DIR, --left PNG or --right PNG")  # fmt: skip
    return np.stack([read_mask(path, shape) if path else np.zeros(shape, bool) for path in paths])


def _picture(path: Path | None, depth_m: np.ndarray) -> np.ndarray:
    """Read the image, or show depth in grey."""
    if path is None:
        far = np.quantile(depth_m[depth_m > 0], 0.98)
        grey = np.where(depth_m > 0, 230 - 180 * (depth_m / far).clip(0, 1), 0).astype(np.uint8)
        return np.repeat(grey[..., None], 3, axis=2)
    rgb = read_image(path)
    if rgb.shape[:2] != depth_m.shape:
        raise SourceError(str(path), f"a picture of the depth's size, {depth_m.shape[1]} x {depth_m.shape[0]}",
                          f"{rgb.shape[1]} x {rgb.shape[0]}", FITS)
    return rgb


def _camera(files: SceneFiles, shape: tuple[int, ...]) -> np.ndarray:
    """Read K (3, 3)."""
    if (files.intrinsics is None) == (files.focal_px is None):
        got = "neither" if files.intrinsics is None else "both"
        raise SourceError("camera", "--intrinsics FILE or --focal-px NUMBER", got, "give one of them")
    if files.intrinsics is not None:
        return read_intrinsics(files.intrinsics)
    focal = float(files.focal_px or 0.0)
    if not (np.isfinite(focal) and focal > 0):
        raise SourceError("--focal-px", "a number above 0", f"{focal:g}", "give the focal length in pixels")
    return np.array([[focal, 0.0, (shape[1] - 1) / 2], [0.0, focal, (shape[0] - 1) / 2], [0.0, 0.0, 1.0]])


def _hands(files: SceneFiles, region: np.ndarray) -> np.ndarray:
    """Return (2,) bool, the hands in use: as forced, by the taxonomy, by the prediction, or those with a mask."""
    if files.hands != "auto":
        return np.array([files.hands in (side, "both") for side in SIDES])
    if files.taxonomy:
        return np.array(TAKES[TAXONOMY.index(files.taxonomy)])
    if files.masks is not None and (files.masks / RECORD).is_file():
        content = read_json(files.masks / RECORD, "a prediction")
        chosen = content.get("hands") if isinstance(content, dict) else None
        if not isinstance(chosen, list) or not all(side in SIDES for side in chosen):
            raise SourceError(f"{files.masks / RECORD}, field 'hands'", "a list of left and right", repr(chosen), "predict again")
        return np.array([side in chosen for side in SIDES])
    return np.asarray(region.any((1, 2)))


def _negative(files: SceneFiles, shape: tuple[int, ...]) -> tuple[np.ndarray, np.ndarray]:
    """Return the (h, w) bool mask and the (k, 3) points in the camera frame."""
    path, none = files.negative, np.zeros((0, 3))
    if path is None:
        return np.zeros(shape, bool), none
    if path.suffix == ".png":
        return read_mask(path, shape), none
    if path.suffix not in (".npy", ".json"):
        raise SourceError(str(path), "a mask (.png), points (.npy) or negative.json", f"{path.suffix or 'no suffix'}", "convert it")
    return np.zeros(shape, bool), _points(path) if path.suffix == ".npy" else _of_object(path, files.object_pose)


def _points(path: Path) -> np.ndarray:
    found = finite_array(load_npy(path, str(path)), (-1, 3))
    if found is None:
        raise SourceError(str(path), "finite points (k, 3) in metres, in the camera's frame", "another array", "check its shape")
    return found


def _of_object(path: Path, pose: Path | None) -> np.ndarray:
    """Transform N_t of negative.json from the object frame to the camera frame."""
    if pose is None:
        raise SourceError(str(path), "--object-pose FILE with T_cam_obj", "no such option", "its points are in the object frame")
    content, T = read_json(path, "negative.json"), finite_array(read_json(pose, "a pose (JSON)"), (4, 4))
    points = finite_array((content.get("N_t") if isinstance(content, dict) else None) or np.zeros((0, 3)), (-1, 3))
    if T is None or not np.allclose(T[:3, :3] @ T[:3, :3].T, np.eye(3), atol=1e-3) or not np.array_equal(T[3], [0, 0, 0, 1]):
        raise SourceError(str(pose), "T_cam_obj, four rows of four numbers, a rotation and metres", "something else", "check it")
    if points is None or not isinstance(content, dict) or "N_t" not in content:
        raise SourceError(f"{path}, field 'N_t'", "points (k, 3)", "something else", "rerun `run negative-affordance`")
    found: np.ndarray = points @ T[:3, :3].T + T[:3, 3]
    return found
