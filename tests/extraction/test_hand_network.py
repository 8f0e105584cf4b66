"""Hand finder: probabilities, calibration, independence of pictures, input size, exposure, palm encoder, invalid files."""

from __future__ import annotations

import json
import sys
from pathlib import Path

import cv2
import numpy as np
import pytest
import torch

from afford.extraction.hands import network as hand_network
from afford.extraction.hands.model import PALM, HandFinder, HandFinderConfig
from afford.extraction.hands.network import GRID, MEAN, Calibration, input_size, normalise_exposure, segment
from afford.extraction.hands.palm_encoder import read_palm_encoder
from afford.extraction.landmarks import files as landmark_files

TINY = HandFinderConfig(height_px=48, width_px=80, widths=(4, 8, 12))
PALM_FILE = Path(sys.prefix) / landmark_files.FOLDER / landmark_files.PALM


@pytest.fixture
def model(tmp_path: Path) -> Path:
    """Files of a network with random weights, and batch norms with some statistics."""
    torch.manual_seed(0)
    network = HandFinder(TINY)
    network(torch.rand(4, 3, 48, 80))
    return hand_network.write_network(tmp_path, network, "# card\n")


def pictures(count: int = 3, height: int = 60, width: int = 100) -> np.ndarray:
    return np.random.default_rng(0).integers(0, 256, (count, height, width, 3)).astype(np.uint8)


def test_probabilities_at_the_size_of_the_pictures(model: Path) -> None:
    """Probabilities are in 0..1, and those of both hands sum to at most 1."""
    found = segment(pictures(), model)
    assert found.shape == (3, 60, 100, 4) and found.dtype == np.float32
    assert found.min() >= 0 and found.max() <= 1 and found[..., :2].sum(-1).max() <= 1 + 1e-6 and found.std() > 0


def test_calibration_changes_the_probability_of_hands_only(model: Path) -> None:
    """A lower bias lowers hands; their side, touched objects and sleeves stay."""
    before = segment(pictures(), model)
    hand_network.write_network(model.parent, hand_network.read_network(model), "# card\n", Calibration(0.5, -2.0))
    after = segment(pictures(), model)
    assert (after[..., :2].sum(-1) < before[..., :2].sum(-1)).all() and np.array_equal(after[..., 2:], before[..., 2:])
    assert np.allclose(after[..., 0] / after[..., 1], before[..., 0] / before[..., 1], rtol=1e-3)


def test_pictures_are_independent_of_their_batch(model: Path) -> None:
    """A picture has the same probabilities alone, in a batch, and again; nine pictures cross the size of a batch."""
    seen = pictures(9)
    together, alone = segment(seen, model), np.concatenate([segment(seen[n : n + 1], model) for n in range(9)])
    assert np.allclose(together, alone, atol=1e-5) and np.array_equal(together, segment(seen, model))
    assert segment(seen[:0], model).shape == (0, 60, 100, 4)


@pytest.mark.parametrize(("height", "width"), [(1080, 1920), (480, 640), (1280, 720), (256, 456), (100, 1000)])
def test_input_size_has_the_area_of_the_config(height: int, width: int) -> None:
    """The input has about the area of the config and the aspect ratio of the picture, for any size of picture."""
    config = HandFinderConfig()
    down, across = input_size(height, width, config)
    assert down % GRID == across % GRID == 0
    assert down * across == pytest.approx(config.height_px * config.width_px, rel=0.25)
    assert across / down == pytest.approx(width / height, rel=0.25)
    assert input_size(2 * height, 2 * width, config) == (down, across) and input_size(height, width, config, 2.0)[1] > 1.8 * across


def test_exposure_is_normalised() -> None:
    """A gamma brings the mean level near MEAN; black, white and the order of levels are kept."""
    plain = np.sort(pictures(1)[0].ravel()).reshape(60, 100, 3)
    for gamma in (0.4, 0.6, 1.8):
        lit = (255 * (plain / 255) ** gamma + 0.5).astype(np.uint8)
        seen = normalise_exposure(lit)
        assert seen.dtype == np.float32 and abs(seen.mean() - MEAN) < 0.5 * abs(lit.mean() / 255 - MEAN)
        assert seen.min() == 0 and seen.max() == 1 and (np.diff(seen.ravel()) >= 0).all()
    assert normalise_exposure(np.full((2, 2, 3), 1, np.uint8)).max() < MEAN / 2


def test_invalid_files_are_refused(model: Path, tmp_path: Path) -> None:
    """A missing config, invalid weights and another format are refused."""
    with pytest.raises(ValueError, match=r"expected config\.json of a trained finder"):
        segment(pictures(), tmp_path / "nowhere")
    (model / "model.safetensors").write_bytes(b"no weights")
    with pytest.raises(ValueError, match=r"expected the weights that config\.json describes"):
        hand_network.read_network(model)
    config = json.loads((model / "config.json").read_text())
    (model / "config.json").write_text(json.dumps(config | {"format": "other"}))
    with pytest.raises(ValueError, match="train a finder with hands_train"):
        hand_network.read_network(model)


@pytest.mark.parametrize("text", ["{}]", '{"scale": "x"}', '{"scale": 0, "bias": 0}', '{"scale": 1, "bias": NaN}', '{"more": 1}'])
def test_invalid_calibrations_are_refused(model: Path, text: str) -> None:
    """Other numbers, names and texts are refused."""
    (model / "calibration.json").write_text(text)
    with pytest.raises(ValueError, match="train a finder with hands_train"):
        hand_network.read_calibration(model)


def test_a_changed_model_is_read_again(model: Path) -> None:
    """The cached network is dropped when its files change."""
    before = segment(pictures(), model)
    network = hand_network.read_network(model)
    with torch.no_grad():
        network.head.bias += 3
    hand_network.write_network(model.parent, network, "# card\n")
    assert not np.allclose(segment(pictures(), model), before)


@pytest.mark.skipif(not PALM_FILE.is_file(), reason="set-up has not fetched the palm detector")
def test_the_palm_encoder_is_the_detector() -> None:
    """Feature maps at strides 16 and 8 are those in front of the detector's heads, as OpenCV computes them."""
    picture = np.random.default_rng(0).random((1, 3, 192, 192), np.float32)
    network = cv2.dnn.readNetFromTFLite(str(PALM_FILE), engine=cv2.dnn.ENGINE_CLASSIC)
    network.setInput(picture)
    names = list(network.getLayerNames())
    heads = [n for n, name in enumerate(names) if "classifier_palm" in name and "BiasAdd" in name]
    coarse, fine = network.forward([names[n - 1] for n in heads])
    with torch.no_grad():
        maps = read_palm_encoder(PALM_FILE).eval()(torch.from_numpy(picture))
    assert [one.shape[1] for one in maps] == [32, 64, 128, 256]
    assert np.allclose(maps[3].numpy(), coarse, atol=1e-3) and np.allclose(maps[2].numpy(), fine, atol=1e-3)


def test_a_finder_with_the_palm_encoder_is_written_and_read(tmp_path: Path) -> None:
    """The format names the encoder, which stays frozen and serves pictures of any size."""
    torch.manual_seed(0)
    network = HandFinder(HandFinderConfig(height_px=48, width_px=80), PALM)
    folder = hand_network.write_network(tmp_path, network, "# card\n")
    assert hand_network.read_network(folder).kind == PALM and segment(pictures(1, 61, 103), folder).shape == (1, 61, 103, 4)
    assert not any(parameter.requires_grad for parameter in network.encoder.parameters())


def test_another_network_is_no_palm_detector(tmp_path: Path) -> None:
    """The error names the file."""
    (tmp_path / "palm.tflite").write_bytes(b"no network")
    with pytest.raises(ValueError, match=r"palm\.tflite: .*make setup"):
        read_palm_encoder(tmp_path / "palm.tflite")
