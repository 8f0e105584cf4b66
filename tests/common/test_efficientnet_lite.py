"""EfficientNet-Lite0: shapes, published names, frozen statistics, and what the published weights see."""

from __future__ import annotations

import sys
from pathlib import Path

import cv2
import pytest
import torch
from skimage import data
from torch.nn.functional import conv2d, pad

from afford.models.efficientnet_lite import CLASSES, WIDTHS, EfficientNetLite0, Same, read_encoder
from afford.models.encoder_place import FILE, FOLDER

PUBLISHED = Path(sys.prefix) / FOLDER / FILE


def random_encoder(classes: int = 0) -> EfficientNetLite0:
    torch.manual_seed(0)
    return EfficientNetLite0(classes).eval()


@pytest.mark.parametrize(("height", "width"), [(64, 96), (128, 160), (70, 50)])
def test_strides_and_widths(height: int, width: int) -> None:
    """Features have strides 4, 8, 16 and 32, rounded up."""
    with torch.inference_mode():
        found = random_encoder()(torch.rand(2, 3, height, width))
    assert [tuple(one.shape) for one in found] == [(2, channels, -(-height // stride), -(-width // stride))
                                                   for channels, stride in zip(WIDTHS, (4, 8, 16, 32), strict=True)]  # fmt: skip


@pytest.mark.parametrize(("kernel", "stride", "groups"), [(1, 1, 1), (3, 1, 12), (3, 2, 1), (5, 2, 12)])
@pytest.mark.parametrize("size", [(20, 24), (21, 17), (20, 17)])
def test_odd_pixels_of_padding_are_behind(size: tuple[int, int], kernel: int, stride: int, groups: int) -> None:
    """The same as with a picture that was padded before, as TensorFlow does, and the same gradients of the weight."""
    torch.manual_seed(kernel)
    convolution, image = Same(12, 24, kernel, stride, groups).double(), torch.rand(2, 12, *size, dtype=torch.float64)
    down, across = (max((-(-side // stride) - 1) * stride + kernel - side, 0) for side in size)
    padded = pad(image, (across // 2, across - across // 2, down // 2, down - down // 2))
    found, expected = convolution(image), conv2d(padded, convolution.weight, stride=stride, groups=groups)
    torch.testing.assert_close(found, expected)
    gradients = [torch.autograd.grad(one.square().sum(), convolution.weight)[0] for one in (found, expected)]
    torch.testing.assert_close(*gradients)


@pytest.mark.parametrize(("kernel", "stride", "groups"), [(1, 1, 1), (3, 1, 12), (3, 2, 1), (5, 2, 12)])
@pytest.mark.parametrize("size", [(20, 24), (21, 17)])
def test_normalisation_inside_a_convolution_changes_nothing(size: tuple[int, int], kernel: int, stride: int, groups: int) -> None:
    """One convolution in evaluation gives what convolution and normalisation give one after the other; training stays apart."""
    torch.manual_seed(kernel)
    convolution, norm = Same(12, 24, kernel, stride, groups), torch.nn.BatchNorm2d(24)
    for values in (norm.weight, norm.bias, norm.running_mean, norm.running_var):
        torch.nn.init.uniform_(values, 0.5, 2.0)
    image = torch.rand(2, 12, *size)
    assert torch.equal(convolution.normed(image, norm), norm(convolution(image)))
    norm.eval()
    torch.testing.assert_close(convolution.normed(image, norm), norm(convolution(image)), rtol=1e-4, atol=1e-5)


@pytest.mark.parametrize("changed", ["weight", "norm.weight", "norm.bias", "norm.running_mean", "norm.running_var"])
@pytest.mark.parametrize("replaced", [False, True])
def test_a_kept_convolution_follows_its_tensors(changed: str, replaced: bool) -> None:
    """Weight and bias are computed again when a tensor they come from has changed, in place or by another tensor."""
    convolution, norm = Same(4, 8, 3), torch.nn.BatchNorm2d(8).eval()
    pair, image = torch.nn.ModuleDict({"weight": convolution, "norm": norm}), torch.rand(1, 4, 9, 9)
    with torch.inference_mode():
        before = convolution.normed(image, norm)
        assert torch.equal(convolution.normed(image, norm), before)
    with torch.no_grad():
        given = {name: tensor + 0.5 if name.endswith(changed) else tensor for name, tensor in pair.state_dict().items()}
    pair.load_state_dict(given, assign=replaced)
    with torch.inference_mode():
        after = convolution.normed(image, norm)
        torch.testing.assert_close(after, norm(convolution(image)), rtol=1e-4, atol=1e-5)
    assert not torch.allclose(after, before)


def test_a_kept_convolution_learns_nothing_and_hides_no_gradient() -> None:
    """A trained one has its gradients after a prediction, and a frozen one lets those of its picture through."""
    convolution, norm = Same(4, 8, 3), torch.nn.BatchNorm2d(8).eval()
    image = torch.rand(1, 4, 9, 9, requires_grad=True)
    with torch.inference_mode():
        convolution.normed(image, norm)
    convolution.normed(image, norm).sum().backward()
    assert convolution.weight.grad is not None and convolution.weight.grad.abs().sum() > 0
    for tensor in (*convolution.parameters(), *norm.parameters()):
        tensor.requires_grad_(False)
    (gradient,) = torch.autograd.grad(convolution.normed(image, norm).sum(), image)
    assert gradient.abs().sum() > 0


def test_size_of_the_published_model() -> None:
    """Parameters of the classifier as its authors state them, 4.7 million."""
    assert sum(one.numel() for one in EfficientNetLite0(CLASSES).parameters()) == 4_652_008


def test_weights_are_read_without_the_classifier(tmp_path: Path) -> None:
    """A file that another model of this form saved, with or without its classifier, gives the same features."""
    saved = random_encoder(CLASSES)
    torch.save(saved.state_dict(), tmp_path / FILE)
    image = torch.rand(1, 3, 64, 64)
    with torch.inference_mode():
        for place in (tmp_path, tmp_path / FILE):
            assert all(torch.equal(a, b) for a, b in zip(read_encoder(str(place))(image), saved(image), strict=True))
        assert torch.equal(read_encoder(str(tmp_path), CLASSES).classify(image), saved.classify(image))


def test_another_file_is_refused(tmp_path: Path) -> None:
    """A missing file, bytes that are no weights, and the weights of another model are named in one sentence."""
    with pytest.raises(ValueError, match=r"got nothing there; run `python install/image_encoder\.py`"):
        read_encoder(str(tmp_path))
    (tmp_path / FILE).write_bytes(b"nothing")
    with pytest.raises(ValueError, match="expected the weights of EfficientNet-Lite0"):
        read_encoder(str(tmp_path))
    torch.save(torch.nn.Linear(2, 2).state_dict(), tmp_path / FILE)
    with pytest.raises(ValueError, match=r"tensors do not fit: .*it is the file of another model"):
        read_encoder(str(tmp_path))


@pytest.mark.skipif(not PUBLISHED.is_file(), reason="the weights are not there: python install/image_encoder.py")
@pytest.mark.parametrize(("picture", "classes"), [("coffee", {967, 968}), ("chelsea", {281, 282, 285})])
def test_published_weights_know_photographs(picture: str, classes: set[int]) -> None:
    """The likeliest class of a cup of espresso, and of a cat, among ImageNet's 1000."""
    image = getattr(data, picture)()
    height, width = image.shape[:2]
    side, left = min(height, width), (width - min(height, width)) // 2
    square = cv2.resize(image[:side, left : left + side], (224, 224), interpolation=cv2.INTER_AREA)
    with torch.inference_mode():
        logits = read_encoder(str(PUBLISHED), CLASSES).classify(torch.from_numpy(square).permute(2, 0, 1)[None] / 255)
    assert int(logits.argmax()) in classes
