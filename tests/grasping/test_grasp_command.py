"""Command `grasp`: its files, options, and one-sentence errors."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import pytest
import trimesh

from afford.grasping.candidates.point_cloud import unproject
from afford.grasping.candidates.read_scene import SceneFiles, read
from schemas.grasp import TERMS, GraspScene
from tests.helpers.command import Called, call
from tests.helpers.made_looks import rod


def saved(folder: Path, scene: GraspScene) -> Path:
    """Write a scene as files: depth.png, depth.npy, masks/ as `predict` writes it, camera.json, negative.png."""
    masks = folder / "masks"
    masks.mkdir(parents=True)
    assert cv2.imwrite(str(folder / "depth.png"), np.rint(1000 * scene.depth_m).astype(np.uint16))
    np.save(folder / "depth.npy", scene.depth_m)
    for side, mask in zip(("left", "right"), scene.region, strict=True):
        assert cv2.imwrite(str(masks / f"{side}.png"), mask.astype(np.uint8) * 255)
    assert cv2.imwrite(str(folder / "negative.png"), scene.negative.astype(np.uint8) * 255)
    chosen = [side for side, used in zip(("left", "right"), scene.hands, strict=True) if used]
    (masks / "prediction.json").write_text(json.dumps({"hands": chosen}))
    K = scene.K
    (folder / "camera.json").write_text(json.dumps({"fx": K[0, 0], "fy": K[1, 1], "cx": K[0, 2], "cy": K[1, 2]}))
    return folder


@pytest.fixture(scope="module")
def look(tmp_path_factory: pytest.TempPathFactory) -> Path:
    scene, _ = rod(right=lambda place: place[..., 0] < 0.0, negative=lambda place: place[..., 0] > 0.05)
    return saved(tmp_path_factory.mktemp("look"), scene)


def grasp(look: Path, out: Path, *more: str | Path, depth: str = "depth.png", camera: bool = True, masks: bool = True) -> Called:
    words: list[str | Path] = [look / depth, "--out", out]
    words += ["--intrinsics", look / "camera.json"] if camera else []
    words += ["--masks", look / "masks"] if masks else []
    return call("grasp", *words, *more)


def test_a_prediction_and_its_depth_become_files(look: Path, tmp_path: Path) -> None:
    """candidates.json of the predicted hand, an overlay of the depth's size, a valid PLY."""
    done = grasp(look, tmp_path / "out", "--negative", look / "negative.png", "--json")
    assert done.code == 0, done.err
    record = json.loads((tmp_path / "out" / "candidates.json").read_text())
    best = record["hands"]["right"][0]
    assert not record["hands"]["left"] and set(best["terms"]) == set(TERMS) and len(best["tips_m"]) == 5
    R = np.array(best["T_cam_grasp"])[:3, :3]
    assert np.allclose(R @ R.T, np.eye(3), atol=1e-5) and np.allclose(R[:, 1], -np.array(best["approach"]), atol=1e-5)
    assert done.json["grasps"] == {"left": 0, "right": len(record["hands"]["right"])}
    assert done.json["best"]["right"] == best["score"]
    picture = cv2.imread(str(tmp_path / "out" / "overlay.png"))
    assert picture is not None and picture.shape == (160, 240, 3)
    points = trimesh.load(tmp_path / "out" / "cloud.ply").vertices
    place = np.array(best["T_cam_grasp"])[:3, 3]
    assert np.linalg.norm(points - place, axis=1).min() < 0.002  # the axes are drawn where the grasp is


def test_metres_and_millimetres_give_the_same_depth(look: Path) -> None:
    a, b = (read(SceneFiles(look / name, look / "masks", intrinsics=look / "camera.json")) for name in ("depth.png", "depth.npy"))
    assert np.abs(a.depth_m - b.depth_m).max() <= 0.0005 + 1e-6 and np.array_equal(a.hands, [False, True])


def test_a_focal_length_means_a_centred_camera(look: Path) -> None:
    K = read(SceneFiles(look / "depth.npy", look / "masks", intrinsics=look / "camera.json")).K
    assert np.allclose(read(SceneFiles(look / "depth.npy", look / "masks", focal_px=float(K[0, 0]))).K, K)


def test_the_taxonomy_and_the_option_choose_hands(look: Path) -> None:
    files = SceneFiles(look / "depth.npy", look / "masks", intrinsics=look / "camera.json")
    assert read(replace(files, taxonomy="both_same")).hands.tolist() == [True, True]
    assert read(replace(files, taxonomy="both_same", hands="left")).hands.tolist() == [True, False]
    assert read(replace(files, masks=None, right=look / "masks" / "right.png")).hands.tolist() == [False, True]


def test_a_folder_with_one_mask_uses_one_hand(look: Path, tmp_path: Path) -> None:
    """The prediction record is optional; a folder without masks is rejected with the name of the file."""
    masks = tmp_path / "masks"
    masks.mkdir()
    (masks / "right.png").write_bytes((look / "masks" / "right.png").read_bytes())
    words_of_call = ("grasp", look / "depth.npy", "--out", tmp_path / "out", "--masks", masks)
    done = call(*words_of_call, "--intrinsics", look / "camera.json", "--json")
    assert done.code == 0 and done.json["grasps"]["right"] > 0 and not done.json["grasps"].get("left")
    forced = call(*words_of_call, "--hands", "both", "--focal-px", "200")
    assert forced.code == 2 and "--left" in forced.words and "got no mask" in forced.words
    (masks / "right.png").unlink()
    none = call(*words_of_call, "--focal-px", "200")
    assert none.code == 2 and f"{masks / 'left.png'}: expected a mask (PNG)" in none.words


def test_points_of_the_object_are_transformed_to_the_camera(look: Path, tmp_path: Path) -> None:
    """negative.json and a pose give the points of an array in the camera frame."""
    scene = read(SceneFiles(look / "depth.npy", look / "masks", intrinsics=look / "camera.json", negative=look / "negative.png"))
    points = unproject(scene.depth_m, scene.K)[scene.negative]
    T = np.eye(4)
    T[:3, :3], T[:3, 3] = [[0, -1, 0], [1, 0, 0], [0, 0, 1]], [0.1, 0.2, 0.3]
    np.save(tmp_path / "points.npy", points)
    (tmp_path / "negative.json").write_text(json.dumps({"N_t": ((points - T[:3, 3]) @ T[:3, :3]).tolist()}))
    (tmp_path / "pose.json").write_text(json.dumps(T.tolist()))
    files = SceneFiles(look / "depth.npy", look / "masks", intrinsics=look / "camera.json", negative=tmp_path / "points.npy")
    of_object = replace(files, negative=tmp_path / "negative.json", object_pose=tmp_path / "pose.json")
    assert np.allclose(read(files).N_t, points) and np.allclose(read(of_object).N_t, points)


def test_a_hand_without_a_grasp_is_reported(look: Path, tmp_path: Path) -> None:
    """A hand that spans 5 mm holds nothing: exit code 1, and the files are written."""
    done = grasp(look, tmp_path / "out", "--span-m", "0.005")
    assert done.code == 1 and "no grasp of the right hand" in done.words and (tmp_path / "out" / "candidates.json").is_file()


BAD: dict[str, tuple[list[str], str]] = {
    "no camera": ([], "--intrinsics FILE or --focal-px NUMBER"),
    "focal": (["--focal-px", "-3"], "a number above 0"),
    "hands": (["--focal-px", "200", "--hands", "three"], "unknown --hands 'three'"),
    "taxonomy": (["--focal-px", "200", "--taxonomy", "both"], "did you mean"),
    "count": (["--focal-px", "200", "--count", "0"], "1 or more"),
    "span": (["--focal-px", "200", "--span-m", "90"], "above 0 and at most 1"),
    "negative": (["--focal-px", "200", "--negative", "LOOK/camera.json"], "--object-pose FILE"),
    "negative size": (["--focal-px", "200", "--negative", "LOOK/small.png"], "expected a mask of the depth's size, 240 x 160"),
    "no such mask": (["--focal-px", "200", "--left", "LOOK/none.png"], "a mask (PNG)"),
    "empty left": (["--focal-px", "200", "--hands", "left"], "expected a region with depth for the left hand"),
    "camera is no matrix": (["--intrinsics", "LOOK/masks/prediction.json"], "fx, fy, cx, cy"),
    "picture size": (["--focal-px", "200", "--image", "LOOK/small.png"], "a picture of the depth's size"),
}


@pytest.mark.parametrize("case", BAD)
def test_invalid_options(case: str, look: Path, tmp_path: Path) -> None:
    assert cv2.imwrite(str(look / "small.png"), np.zeros((10, 10), np.uint8))
    words, message = BAD[case]
    done = grasp(look, tmp_path / "out", *(word.replace("LOOK", str(look)) for word in words), camera=False)
    assert done.code == 2 and message in done.err and done.err.count("\n") == 1 and not (tmp_path / "out").exists()


EMPTY: list[tuple[list[str], str]] = [
    (["--left", "none.png"], "none.png and right.png: expected a region for a hand, got empty masks; "),
    (["--left", "none.png", "--hands", "left"], "none.png: expected a region with depth for the left hand, got an empty mask; "),
    (["--left", "away.png"], "away.png: expected a region with depth for the left hand, got 3 pixel(s), none with depth in "),
    (["--left", "there.png", "--hands", "both"], "right.png: expected a region with depth for the right hand, got an empty mask; "),
]


@pytest.mark.parametrize(("words", "message"), EMPTY)
def test_empty_regions_are_reported(words: list[str], message: str, tmp_path: Path) -> None:
    """The error names the mask and its hand; for a region without depth, also the depth file."""
    depth, away, there = np.full((30, 40), 0.5), np.zeros((30, 40), np.uint8), np.zeros((30, 40), np.uint8)
    depth[:5], away[2, 3:6], there[10:20, 10:20] = 0, 255, 255
    np.save(tmp_path / "depth.npy", depth)
    for name, mask in {"none": 0 * away, "right": 0 * away, "away": away, "there": there}.items():
        assert cv2.imwrite(str(tmp_path / f"{name}.png"), mask)
    placed = [str(tmp_path / word) if word.endswith(".png") else word for word in words]
    done = call("grasp", tmp_path / "depth.npy", "--out", tmp_path / "out", "--right", tmp_path / "right.png",
                "--focal-px", "200", *placed)  # fmt: skip
    error = done.err.replace(f"{tmp_path}/", "")
    assert done.code == 2 and error.startswith(f"error: {message}") and done.err.count("\n") == 1


@pytest.mark.parametrize(("content", "message"), [
    (np.zeros((4, 4), np.float32), "no pixel with depth"), (np.full((4, 4), 700.0), "a median of 700 m"),
    (np.zeros((4, 4, 3)), "float64 (4, 4, 3)"), (np.zeros((4, 4), int), "int64 (4, 4)"),
    (np.array([{}]), "allow_pickle")])  # fmt: skip
def test_invalid_depths(content: np.ndarray, message: str, tmp_path: Path) -> None:
    """Zeros, millimetres as metres, colours, integers, and pickled objects, which are never loaded."""
    np.save(tmp_path / "depth.npy", content, allow_pickle=True)
    done = call("grasp", tmp_path / "depth.npy", "--out", tmp_path / "out", "--masks", tmp_path, "--focal-px", "200")
    assert done.code == 2 and message in done.err and done.err.count("\n") == 1


def test_other_files_are_kept(look: Path, tmp_path: Path) -> None:
    (tmp_path / "mine.txt").write_text("mine")
    assert grasp(look, tmp_path).code == 2
    assert grasp(look, tmp_path, "--force").code == 0 and grasp(look, tmp_path).code == 0
    assert (tmp_path / "mine.txt").read_text() == "mine"
