"""Cycles as the renderer of stills: scene files, natural materials, light, the camera's response, and the process itself."""

from __future__ import annotations

import importlib.util
import sys
from collections.abc import Callable
from pathlib import Path
from types import ModuleType

import cv2
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from afford.render.camera import intrinsics, look_at
from afford.render.cycles.client import FOLDER, Cycles, Lit, Surface, scene_arrays
from afford.render.cycles.indoor import indoor_light
from afford.render.cycles.natural import natural
from afford.render.draw import render
from afford.render.scene import Camera, Instance, Light, Material, Textures
from afford.render.solids import box
from afford.synthetic.stills.camera_response import develop, glare, motion_blur

INSTALLED = (Path(sys.prefix) / FOLDER / "bin" / "python").is_file()
INSTALLER = Path(__file__).resolve().parents[2] / "install" / "cycles.py"
RED, GREY = (np.full((4, 4, 3), colour, np.uint8) for colour in ((200, 30, 20), (120, 120, 120)))
DARK = Lit(np.full((8, 16, 3), 0.5, np.float32), np.zeros((0, 10)))


def scene() -> list[Instance]:
    """Two red boxes and a grey one."""
    places = ((-0.12, 0.0, RED), (0.12, 0.0, RED), (0.0, 0.1, GREY))
    out = []
    for number, (x, y, image) in enumerate(places):
        T = np.eye(4)
        T[:2, 3] = x, y
        out.append(Instance(box((0.1, 0.06, 0.08)), Material(image), T, number))
    return out


def camera(width: int = 64, height: int = 48) -> Camera:
    return Camera(intrinsics(width, height, 50), look_at(np.array([0.0, -0.5, 0.4]), np.zeros(3)), width, height)


def test_a_shared_image_is_stored_once() -> None:
    """Three instances with two images make two images, and every array is plain numbers."""
    arrays = scene_arrays(scene(), [Surface()] * 3, camera(), DARK)
    assert int(arrays["images"]) == 2
    assert [int(row[8]) for row in arrays["looks"]] == [0, 0, 1]
    assert all(array.dtype.kind in "iuf" for array in arrays.values())


def test_natural_materials_leave_the_geometry() -> None:
    """Equal images change alike, a seed gives equal materials, and meshes, poses and entities stay."""
    before = scene()
    after, surfaces = natural(before, {}, [GREY], np.random.default_rng(0))
    again, same = natural(before, {}, [GREY], np.random.default_rng(0))
    assert all(a.mesh is b.mesh and a.T_world_mesh is b.T_world_mesh and a.entity == b.entity
               for a, b in zip(before, after, strict=True))  # fmt: skip
    assert after[0].material.image is after[1].material.image
    assert surfaces[0] == surfaces[1] and surfaces == same
    assert [one.material.image.tobytes() for one in after] == [one.material.image.tobytes() for one in again]


def test_glass_is_for_vessels_only() -> None:
    """Over many draws a bottle is glass sometimes, and a hammer never."""
    found = {kind: [natural(scene()[:1], {0: kind}, [], np.random.default_rng(seed))[1][0].transmission for seed in range(40)]
             for kind in ("bottle", "hammer")}  # fmt: skip
    assert set(found["bottle"]) == {0.0, 1.0}
    assert set(found["hammer"]) == {0.0}


@given(st.integers(0, 10_000))
def test_indoor_light_is_a_function_of_its_seed(seed: int) -> None:
    """Radiance and power are finite and not negative; two draws with one seed agree."""
    one, other = (indoor_light(np.random.default_rng(seed), np.array([0, -0.5, 0.5]), np.zeros(3)) for _ in range(2))
    assert np.isfinite(one.sky).all() and one.sky.min() >= 0 and one.sky.max() > 0.1
    assert (one.lamps[:, 6:] > 0).all()
    assert one.sky.tobytes() == other.sky.tobytes() and one.lamps.tobytes() == other.lamps.tobytes()


def radiance() -> np.ndarray:
    """Smooth radiance (60, 80, 3) with one bright spot."""
    x = cv2.GaussianBlur(np.random.default_rng(0).random((60, 80, 3)).astype(np.float32), (0, 0), 3)
    x[20:24, 30:34] = 20.0
    return x


@given(st.floats(0.01, 100.0))
def test_exposure_follows_the_scene(factor: float) -> None:
    """A picture does not depend on the brightness of the scene as a whole, and a seed gives equal bytes."""
    one = develop(radiance(), np.random.default_rng(3))
    other = develop(radiance() * np.float32(factor), np.random.default_rng(3))
    assert one.shape == (60, 80, 3) and one.dtype == np.uint8
    assert np.abs(one.astype(int) - other).mean() < 1.0


def test_glare_brightens_around_lights() -> None:
    """No pixel gets darker, those beside the bright spot get brighter, and those far from it stay."""
    x = radiance()
    y = glare(x, 0.2)
    assert (y >= x).all()
    assert (y[18, 28] > x[18, 28] + 1e-3).all()
    assert np.allclose(y[-1, -1], x[-1, -1])


def test_motion_blur_keeps_the_light() -> None:
    """The mean of a picture with an even border stays, and a line across the motion widens."""
    x = np.zeros((40, 40, 3), np.float32)
    x[10:30, 20] = 1.0
    y = motion_blur(x, 6.0, 0.0)
    assert y.mean() == pytest.approx(x.mean(), rel=1e-3)
    assert (y[20, :, 0] > 0.05).sum() >= 6


def test_a_missing_environment_is_named(tmp_path: Path) -> None:
    """The error says how to install Cycles, and what works without it."""
    with pytest.raises(OSError, match=r"install/cycles\.py.*still_render\.backend=raster"):
        Cycles(tmp_path / "python")


def test_a_process_without_blender_is_reported() -> None:
    """The last output of the process is part of the error."""
    with Cycles(Path(sys.executable)) as process, pytest.raises(RuntimeError, match="No module named 'bpy'"):
        process.render(scene(), [Surface()] * 3, camera(), DARK, 1, 0)




@pytest.mark.skipif(not INSTALLED, reason="Cycles is not installed: python install/cycles.py")
def test_cycles_shows_what_the_fast_renderer_shows() -> None:
    """Boxes are at the same pixels, and a seed gives equal values."""
    shown, view = scene(), camera(160, 120)
    with Cycles() as process:
        linear, again = (process.render(shown, [Surface()] * 3, view, DARK, 4, 1) for _ in range(2))
    ours = render(shown, view, Light(), Textures.of(one.material for one in shown))
    object_px = ours.ids >= 0
    red = linear[..., 0] > 2 * linear[..., 1]
    assert (red == ((ours.ids == 0) | (ours.ids == 1))).mean() > 0.98
    assert object_px.any() and linear.tobytes() == again.tobytes()


def installer() -> ModuleType:
    """Load the script as a module."""
    found = importlib.util.spec_from_file_location("install_cycles", INSTALLER)
    assert found is not None and found.loader is not None
    module = importlib.util.module_from_spec(found)
    found.loader.exec_module(module)
    return module


def made(words: str) -> Callable[[Path], str]:
    """Return an installer that makes an environment and ends with these words."""

    def install(folder: Path) -> str:
        (folder / "bin").mkdir(parents=True)
        (folder / "bin" / "python").write_text("")
        return words

    return install


def test_a_failed_installation_leaves_nothing(tmp_path: Path, capsys: pytest.CaptureFixture[str],
                                              monkeypatch: pytest.MonkeyPatch) -> None:  # fmt: skip
    """One sentence, exit code 1, and no environment; the next call makes it, and one more does no work."""
    module = installer()
    monkeypatch.setattr(module, "PYTHON", sys.version_info[:2])
    assert module.FOLDER == FOLDER
    assert module.main(tmp_path, made("no network")) == 1
    assert "no network" in capsys.readouterr().err
    assert not list((tmp_path / FOLDER).parent.iterdir())
    assert module.main(tmp_path, made("")) == 0
    assert module.main(tmp_path, made("never called")) == 0


def test_another_python_is_refused(tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch) -> None:
    """The sentence names both versions."""
    module = installer()
    monkeypatch.setattr(module, "PYTHON", (2, 7))
    assert module.main(tmp_path, made("")) == 1
    assert "Python 2.7 only" in capsys.readouterr().err
