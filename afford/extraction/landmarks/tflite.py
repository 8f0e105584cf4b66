"""TFLite networks of convolutions in torch, on a CPU two to three times as fast as in cv2.dnn.

Reads the flatbuffer: weights in float32 or float16, and the operators that occur in MediaPipe's hand networks. Activations are
(n, c, h, w) in channels-last memory, which is the layout of TFLite.
"""

from __future__ import annotations

import struct
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import torch
from torch import Tensor
from torch.nn import functional

Values = dict[int, Tensor]
Step = Callable[[Values], Tensor]
ADD, CONCATENATION, CONV, DEPTHWISE, DEQUANTIZE, FULLY_CONNECTED, LOGISTIC, MAX_POOL = 0, 2, 3, 4, 6, 9, 14, 17
RESHAPE, RESIZE_BILINEAR, PAD, MEAN, PRELU = 22, 23, 34, 40, 54
"""numbers of operators in the TFLite schema"""
TYPES: dict[int, np.dtype[Any]] = {0: np.dtype("<f4"), 1: np.dtype("<f2"), 2: np.dtype("<i4")}
NO_ACTIVATION, RELU, RELU6 = 0, 1, 3
SAME = 0
"""padding that keeps the size, divided by the stride"""


class TfliteNetwork:
    """A network of one input (n, 3, h, w) and named outputs, computed in float32."""

    def __init__(self, path: Path) -> None:
        """Read a file; ValueError when it is no TFLite network or has an operator that is not supported."""
        try:
            self._read(_Table.root(path.read_bytes()))
        except (struct.error, ValueError, TypeError, LookupError, RuntimeError) as error:
            raise ValueError(f"{path}: no TFLite network that can be read ({error}); fetch it again: "
                             "`python install/landmark_files.py`") from error

    def _read(self, model: _Table) -> None:
        codes = [max(code.number(0, "b"), code.number(3, "i")) for code in model.tables(1)]
        graph, contents = model.tables(2)[0], [buffer.content(0) for buffer in model.tables(4)]
        tensors = graph.tables(0)
        self._constants: Values = {}
        for index, tensor in enumerate(tensors):
            content = contents[tensor.number(2, "I")]
            if content:
                values = np.frombuffer(content, TYPES[tensor.number(1, "b")]).reshape(tensor.numbers(0))
                self._constants[index] = torch.from_numpy(values.astype(np.int64 if values.dtype.kind == "i" else np.float32))
        (self._input,) = graph.numbers(1)
        self._outputs = {tensors[index].content(3).decode(): index for index in graph.numbers(2)}
        self._steps: list[tuple[int, Step, tuple[int, ...]]] = []
        for operator in graph.tables(3):
            code, inputs, (output,) = codes[operator.number(0, "I")], operator.numbers(1), operator.numbers(2)
            if code == DEQUANTIZE:
                self._constants[output] = self._constants[inputs[0]]
            else:
                self._steps.append((output, self._step(code, inputs, operator.table(4), tensors[output].numbers(0)), inputs))
        self._steps = self._without_idle_tensors()

    def _without_idle_tensors(self) -> list[tuple[int, Step, tuple[int, ...]]]:
        """Steps with the tensors that no later step needs, in place of all inputs: their memory is used again."""
        needed, steps = {*self._outputs.values(), *self._constants}, []
        for output, step, inputs in reversed(self._steps):
            steps.append((output, step, tuple(set(inputs) - needed)))
            needed.update(inputs)
        return steps[::-1]

    def _step(self, code: int, inputs: tuple[int, ...], options: _Table, shape: tuple[int, ...]) -> Step:
        """Function that computes the output of an operator out of the values before it."""
        first, *rest = inputs
        fixed = [self._constants[index] for index in rest if index in self._constants]
        if code in (CONV, DEPTHWISE):
            return _convolution(first, fixed, options, depthwise=code == DEPTHWISE)
        if code == PRELU:
            slope = fixed[0].reshape(-1)
            return lambda v: functional.prelu(v[first], slope)
        if code == ADD:
            activation = _activation(options.number(0, "b"))
            return lambda v: activation(v[first] + v[rest[0]])
        if code == MAX_POOL:
            stride, size = (options.number(2, "i"), options.number(1, "i")), (options.number(4, "i"), options.number(3, "i"))
            return lambda v: functional.max_pool2d(v[first], size, stride)
        if code == PAD:
            before_after = fixed[0].tolist()  # n, h, w, c
            pads = [n for axis in (2, 1, 3, 0) for n in before_after[axis]]  # w, h, c, n
            return lambda v: functional.pad(v[first], pads)
        if code == RESIZE_BILINEAR:
            size = tuple(fixed[0].tolist())
            return lambda v: functional.interpolate(v[first], size, mode="bilinear", align_corners=False)
        if code == RESHAPE:
            return lambda v: v[first].permute(0, 2, 3, 1).reshape(-1, *shape[1:])
        if code == CONCATENATION:
            axis = options.number(0, "i")
            return lambda v: torch.cat([v[index] for index in inputs], axis)
        if code == MEAN:
            return lambda v: v[first].mean((2, 3))
        if code == FULLY_CONNECTED:
            return lambda v: functional.linear(v[first], *fixed)
        if code == LOGISTIC:
            return lambda v: v[first].sigmoid()
        raise ValueError(f"operator {code} of TFLite is not supported")

    @torch.inference_mode()
    def __call__(self, pictures: np.ndarray) -> dict[str, np.ndarray]:
        """Compute all outputs, by name, of pictures (n, h, w, 3) uint8, scaled to 0..1."""
        x = torch.from_numpy(pictures).permute(0, 3, 1, 2).float().div_(255)
        values = {**self._constants, self._input: x.contiguous(memory_format=torch.channels_last)}
        for output, step, done in self._steps:
            values[output] = step(values)
            for index in done:
                del values[index]
        return {name: values[index].numpy() for name, index in self._outputs.items()}


def _convolution(source: int, fixed: list[Tensor], options: _Table, depthwise: bool) -> Step:
    """Convolution with TensorFlow's padding: the odd pixel is at the end."""
    weight, bias = fixed
    groups = weight.shape[3] if depthwise else 1
    kernel = weight.permute((3, 0, 1, 2) if depthwise else (0, 3, 1, 2)).contiguous(memory_format=torch.channels_last)
    stride = options.number(2, "i"), options.number(1, "i")
    activation = _activation(options.number(4 if depthwise else 3, "b"))
    same = options.number(0, "b") == SAME

    def step(v: Values) -> Tensor:
        x = v[source]
        pads = [_same(x.shape[axis], kernel.shape[axis], stride[axis - 2]) if same else (0, 0) for axis in (2, 3)]
        even = all(before == after for before, after in pads)
        if not even:
            x = functional.pad(x, [*pads[1], *pads[0]])
        return activation(functional.conv2d(x, kernel, bias, stride, (pads[0][0], pads[1][0]) if even else 0, 1, groups))

    return step


def _same(size: int, kernel: int, stride: int) -> tuple[int, int]:
    """Padding before and after, with which the output has ceil(size / stride) elements."""
    total = max((-(-size // stride) - 1) * stride + kernel - size, 0)
    return total // 2, total - total // 2


def _activation(code: int) -> Callable[[Tensor], Tensor]:
    """Activation that an operator contains, in place."""
    return {NO_ACTIVATION: lambda x: x, RELU: functional.relu_, RELU6: lambda x: functional.hardtanh_(x, 0.0, 6.0)}[code]


@dataclass(frozen=True)
class _Table:
    """Table of a flatbuffer: fields by number, through the table of their offsets."""

    buffer: bytes
    at: int

    @classmethod
    def root(cls, buffer: bytes) -> _Table:
        return cls(buffer, struct.unpack_from("<I", buffer)[0])

    def number(self, field: int, kind: str) -> int:
        """Scalar field, 0 where it is missing."""
        place = self._place(field)
        return struct.unpack_from(f"<{kind}", self.buffer, place)[0] if place else 0

    def numbers(self, field: int) -> tuple[int, ...]:
        """Vector of int32."""
        count, start = self._vector(field)
        return struct.unpack_from(f"<{count}i", self.buffer, start) if count else ()

    def content(self, field: int) -> bytes:
        """Vector of bytes, or a string."""
        count, start = self._vector(field)
        return self.buffer[start : start + count]

    def table(self, field: int) -> _Table:
        """Table in a field; a missing one has no fields."""
        place = self._place(field)
        return self._follow(place) if place else _Table(bytes(8), 4)

    def tables(self, field: int) -> list[_Table]:
        """Vector of tables."""
        count, start = self._vector(field)
        return [self._follow(start + 4 * index) for index in range(count)]

    def _place(self, field: int) -> int:
        """Offset of a field in the buffer; 0 where it is missing."""
        offsets = self.at - struct.unpack_from("<i", self.buffer, self.at)[0]
        length = struct.unpack_from("<H", self.buffer, offsets)[0]
        slot = 4 + 2 * field
        offset = struct.unpack_from("<H", self.buffer, offsets + slot)[0] if slot < length else 0
        return self.at + offset if offset else 0

    def _vector(self, field: int) -> tuple[int, int]:
        """Number of elements, and offset of the first."""
        place = self._place(field)
        if not place:
            return 0, 0
        start = self._follow(place).at
        return struct.unpack_from("<I", self.buffer, start)[0], start + 4

    def _follow(self, place: int) -> _Table:
        return _Table(self.buffer, place + struct.unpack_from("<I", self.buffer, place)[0])
