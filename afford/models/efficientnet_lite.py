"""EfficientNet-Lite0 (Liu 2020), an image classifier without squeeze-and-excitation, as an encoder with features at four strides.

Blocks: MobileNetV2's inverted residuals (Sandler et al. 2018). Names of tensors are those of the published weights.
"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import NamedTuple

import torch
from torch import Tensor, nn
from torch.nn.functional import conv2d, linear, pad

from afford.models.encoder_place import FILE
from afford.models.loading import fill_weights
from afford.models.tensor_files import load_weights_only

MEAN, STD = 127.0 / 255.0, 128.0 / 255.0
"""normalisation of RGB 0..1"""
STEM = 32
STAGES = ((1, 3, 1, 1, 16), (2, 3, 2, 6, 24), (2, 5, 2, 6, 40), (3, 3, 2, 6, 80), (3, 5, 1, 6, 112), (4, 5, 2, 6, 192),
          (1, 3, 1, 6, 320))  # fmt: skip
"""blocks, kernel, stride of the first block, expansion, channels"""
TAPS = (2, 4, 10, 15)
"""last block at strides 4, 8, 16 and 32"""
WIDTHS = (24, 40, 112, 320)
HEAD = 1280
EPSILON = 1e-3


class Normed(NamedTuple):
    """Tensors of a convolution without bias, and of the norm after it."""

    weight: Tensor
    scale: Tensor
    shift: Tensor
    mean: Tensor
    variance: Tensor

    def folded(self, eps: float) -> tuple[Tensor, Tensor]:
        """Weight and bias of the one convolution that does both."""
        scale = self.scale * torch.rsqrt(self.variance + eps)
        return self.weight * scale[:, None, None, None], self.shift - self.mean * scale


class Folded(NamedTuple):
    """Weight and bias of a convolution with its norm, and the state of the tensors that they come from."""

    state: tuple[object, ...]
    weight: Tensor
    bias: Tensor


class Same(nn.Conv2d):
    """Convolution without bias, padded as TensorFlow does: an odd pixel of padding goes to the right and below."""

    def __init__(self, before: int, after: int, kernel: int, stride: int = 1, groups: int = 1) -> None:
        super().__init__(before, after, kernel, stride, groups=groups, bias=False)
        self._folded: Folded | None = None

    def forward(self, x: Tensor) -> Tensor:
        """(b, before, h, w) -> (b, after, ceil(h / stride), ceil(w / stride))."""
        return self._convolved(x, self.weight, None)

    def normed(self, x: Tensor, norm: nn.BatchNorm2d) -> Tensor:
        """Convolve and normalise; in evaluation as one convolution, which takes less than two thirds of the time.

        Without gradients its weight and bias are kept until a tensor they are computed from changes.
        """
        if norm.training or norm.running_mean is None or norm.running_var is None:
            return norm(self.forward(x))
        tensors = Normed(self.weight, norm.weight, norm.bias, norm.running_mean, norm.running_var)
        learns = torch.is_grad_enabled() and any(one.requires_grad for one in tensors)
        if learns or any(one.is_inference() for one in tensors):  # the latter do not count their changes
            return self._convolved(x, *tensors.folded(norm.eps))
        state = tuple((one.data_ptr(), one._version, one.device, one.dtype) for one in tensors)
        if self._folded is None or self._folded.state != state:
            with torch.inference_mode(False), torch.no_grad():
                self._folded = Folded(state, *tensors.folded(norm.eps))
        return self._convolved(x, self._folded.weight, self._folded.bias)

    def _convolved(self, x: Tensor, weight: Tensor, bias: Tensor | None) -> Tensor:
        if self.kernel_size == (1, 1) and self.stride == (1, 1):
            return linear(x.permute(0, 2, 3, 1), weight[:, :, 0, 0], bias).permute(0, 3, 1, 2)
        kernel, stride = self.kernel_size[0], self.stride[0]
        across, down = (max((-(-side // stride) - 1) * stride + kernel - side, 0) for side in (x.shape[-1], x.shape[-2]))
        if across % 2 or down % 2:  # zeros before the kernel, instead of fewer zeros before the picture, which would be copied
            weight = pad(weight, (across % 2, 0, down % 2, 0))
        return conv2d(x, weight, bias, self.stride, ((down + 1) // 2, (across + 1) // 2), groups=self.groups)


class Inverted(nn.Module):
    """Inverted residual: widen by 1 x 1, filter each channel, narrow by 1 x 1; added to its input where shapes agree."""

    def __init__(self, before: int, after: int, kernel: int, stride: int, expand: int) -> None:
        super().__init__()
        wide = expand * before
        self._expand_conv = Same(before, wide, 1) if expand > 1 else None
        self._bn0 = nn.BatchNorm2d(wide, EPSILON) if expand > 1 else None
        self._depthwise_conv, self._bn1 = Same(wide, wide, kernel, stride, groups=wide), nn.BatchNorm2d(wide, EPSILON)
        self._project_conv, self._bn2 = Same(wide, after, 1), nn.BatchNorm2d(after, EPSILON)
        self.adds = stride == 1 and before == after

    def forward(self, x: Tensor) -> Tensor:
        """(b, before, h, w) -> (b, after, h / stride, w / stride)."""
        y = x
        if self._expand_conv is not None and self._bn0 is not None:
            y = self._expand_conv.normed(y, self._bn0).clamp_(0, 6)
        y = self._depthwise_conv.normed(y, self._bn1).clamp_(0, 6)
        y = self._project_conv.normed(y, self._bn2)
        return x + y if self.adds else y


class Pyramid(NamedTuple):
    """Features of b images of H x W px."""

    stride4: Tensor
    """(b, 24, H/4, W/4)"""
    stride8: Tensor
    """(b, 40, H/8, W/8)"""
    stride16: Tensor
    """(b, 112, H/16, W/16)"""
    stride32: Tensor
    """(b, 320, H/32, W/32), rounded up"""


class EfficientNetLite0(nn.Module):
    """Encoder: `forward` gives features; with `classes`, `classify` gives the class logits of a picture."""

    def __init__(self, classes: int = 0) -> None:
        super().__init__()
        self._conv_stem, self._bn0 = Same(3, STEM, 3, 2), nn.BatchNorm2d(STEM, EPSILON)
        blocks, before = [], STEM
        for count, kernel, stride, expand, after in STAGES:
            for n in range(count):
                blocks.append(Inverted(before, after, kernel, stride if n == 0 else 1, expand))
                before = after
        self._blocks = nn.ModuleList(blocks)
        if classes:
            self._conv_head, self._bn1 = Same(before, HEAD, 1), nn.BatchNorm2d(HEAD, EPSILON)
            self._fc = nn.Linear(HEAD, classes)

    def forward(self, image: Tensor) -> Pyramid:
        """Encode RGB images (b, 3, H, W) float32 0..1."""
        x = ((image - MEAN) / STD).contiguous(memory_format=torch.channels_last)
        x = self._conv_stem.normed(x, self._bn0).clamp_(0, 6)
        taps = []
        for n, block in enumerate(self._blocks):
            x = block(x)
            if n in TAPS:
                taps.append(x)
        return Pyramid(*taps)

    def classify(self, image: Tensor) -> Tensor:
        """Class logits (b, classes) of RGB images (b, 3, H, W) float32 0..1."""
        seen = self._conv_head.normed(self.forward(image).stride32, self._bn1).clamp_(0, 6)
        return self._fc(seen.mean(dim=(2, 3)))

    def class_scores(self, stride32: Tensor, classes: Sequence[int]) -> Tensor:
        """Logits (b, h, w, n) of n classes at every place of features (b, 320, h, w); their means are what `classify` gives."""
        seen = self._conv_head.normed(stride32, self._bn1).clamp_(0, 6)
        rows = list(classes)
        return linear(seen.permute(0, 2, 3, 1), self._fc.weight[rows], self._fc.bias[rows])


CLASSES = 1000
"""classes of the published weights"""
HEADS = ("_conv_head.", "_bn1.", "_fc.")
"""prefixes of the classifier's tensors"""


def read_encoder(place: str, classes: int = 0) -> EfficientNetLite0:
    """Read published weights from a file, or from the folder that holds `FILE`; in evaluation mode.

    The classifier is left out unless `classes` is `CLASSES`.
    ValueError, one sentence, when there are none or they do not fit.
    """
    path = Path(place) / FILE if Path(place).is_dir() else Path(place)
    if not path.is_file():
        raise ValueError(f"{path}: expected the weights of EfficientNet-Lite0, got nothing there; run "
                         "`python install/image_encoder.py`")
    with torch.device("meta"):
        model = EfficientNetLite0(classes)
    tensors = load_weights_only(path, "the weights of EfficientNet-Lite0")
    found = {name: tensor for name, tensor in tensors.items() if classes or not name.startswith(HEADS)}
    fill_weights(model, found, str(path), "it is the file of another model")
    return model.eval()
