"""Segment a picture at points with MobileSAM, in ONNX Runtime: one encoding of a picture, a decoding for each point.

Source: Zhang et al. 2023, Faster Segment Anything; Kirillov et al. 2023, Segment Anything, section 3.
"""

from __future__ import annotations

from functools import lru_cache, partial
from typing import TYPE_CHECKING

import cv2
import numpy as np

from afford.extraction.prompted import AtPoint, Outlines
from afford.extraction.prompted.files import DECODER, ENCODER
from schemas.files import FileTree

if TYPE_CHECKING:
    from onnxruntime import InferenceSession

SIDE_PX, MASK_STRIDE = 1024, 4
"""longer side of the encoder's input; pixels of the input for a pixel of a mask"""
MEAN, DEVIATION = (123.675, 116.28, 103.53), (58.395, 57.12, 57.375)
"""of the colours of the training pictures, RGB"""
INCLUDE, PADDING = 1.0, -1.0
"""labels of a point inside the outline, and of a point without meaning, which stands for the missing box"""
LOGITS, QUALITY = "/Reshape_9_output_0", "/iou_prediction_head/layers.2/Gemm_output_0"
"""values in the decoder's graph that hold all four outlines: its published output is the one of the best expected quality"""
AGAIN = "run `python install/segment_files.py`"


def segmenter(files: FileTree, rgb: np.ndarray) -> AtPoint:
    """Encode a picture (h, w, 3) uint8. ValueError when the files are not the networks."""
    encoder, decoder = _networks(files)
    height, width = rgb.shape[:2]
    scale = SIDE_PX / max(height, width)
    size = (round(width * scale), round(height * scale))
    shown = cv2.resize(rgb, size, interpolation=cv2.INTER_LINEAR if scale > 1 else cv2.INTER_AREA)
    padded = np.zeros((1, 3, SIDE_PX, SIDE_PX), np.float32)
    padded[0, :, : size[1], : size[0]] = ((shown - np.array(MEAN, np.float32)) / np.array(DEVIATION, np.float32)).transpose(2, 0, 1)
    (embedding,) = encoder.run(None, {"input": padded})
    return partial(_decode, decoder, embedding, (height, width))


def _decode(decoder: InferenceSession, embedding: np.ndarray, shape: tuple[int, int], point: tuple[float, float]) -> Outlines:
    height, width = shape
    scale = SIDE_PX / max(shape)
    points = np.array([[[point[0] * scale, point[1] * scale], [0, 0]]], np.float32)
    side = SIDE_PX // MASK_STRIDE
    logits, quality = decoder.run([LOGITS, QUALITY], {
        "image_embeddings": embedding, "point_coords": points, "point_labels": np.array([[INCLUDE, PADDING]], np.float32),
        "mask_input": np.zeros((1, 1, side, side), np.float32), "has_mask_input": np.zeros(1, np.float32),
        "orig_im_size": np.array(shape, np.float32)})  # fmt: skip
    rows, columns = (int(np.ceil(length * scale / MASK_STRIDE)) for length in shape)
    shown = [cv2.resize(mask, (width, height), interpolation=cv2.INTER_LINEAR) for mask in logits[0, :, :rows, :columns]]
    return Outlines(np.stack(shown), quality[0])


@lru_cache(maxsize=1)
def _networks(files: FileTree) -> tuple[InferenceSession, InferenceSession]:
    """Load encoder and decoder, on one thread: results do not depend on the machine's number of cores."""
    import onnxruntime

    options = onnxruntime.SessionOptions()
    options.intra_op_num_threads = options.inter_op_num_threads = 1
    contents = []
    for name in (ENCODER, DECODER):
        found = files.find(name)
        if found is None or found.path is None or not found.path.is_file():
            raise ValueError(f"{files.name}: there is no {name} of MobileSAM; {AGAIN}")
        contents.append(found.path.read_bytes())
    try:
        encoder, decoder = (onnxruntime.InferenceSession(content, options, providers=["CPUExecutionProvider"])
                            for content in (contents[0], contents[1] + _more_outputs(LOGITS, QUALITY)))  # fmt: skip
    except Exception as error:  # ONNX Runtime has a class of exceptions for each of its error codes
        raise ValueError(f"{files.name}: no networks that ONNX Runtime can read ({str(error).splitlines()[0]}); {AGAIN}") from error
    return encoder, decoder


def _more_outputs(*names: str) -> bytes:
    """Encode an ONNX model that only lists outputs of its graph: appended to another model, they become outputs of that one.

    Protocol buffers merge a message that occurs twice; the fields are ModelProto.graph, GraphProto.output and ValueInfoProto.name.
    """
    outputs = b"".join(_field(12, _field(1, name.encode())) for name in names)
    return _field(7, outputs)


def _field(number: int, content: bytes) -> bytes:
    """Encode a field of a length below 16,384 bytes."""
    length = len(content)
    return bytes([number << 3 | 2]) + (bytes([length]) if length < 128 else bytes([length & 127 | 128, length >> 7])) + content
