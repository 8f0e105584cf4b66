"""A picture file as an array, or one sentence that says why not."""

from __future__ import annotations

from typing import Any

import cv2
import numpy as np

from afford.common.bounded import TooLargeError, check_image
from afford.common.errors import SourceError
from schemas.files import FileRef


def picture(file: FileRef, flags: int, dtype: Any, dimensions: int) -> np.ndarray:
    """The picture as OpenCV reads it: BGR, or one channel; SourceError when it is none, or of another kind."""
    data = file.path.read_bytes()
    got = f"{len(data)} bytes that OpenCV cannot decode"
    broken = SourceError(file.name, "a picture", got, "was the file cut short? get it again")
    try:
        check_image(data, file.name)
        found = cv2.imdecode(np.frombuffer(data, np.uint8), flags)
    except TooLargeError:
        raise
    except (cv2.error, SourceError) as error:
        raise broken from error
    if found is None:
        raise broken
    if found.dtype != dtype or found.ndim != dimensions:
        want = f"{'one channel' if dimensions == 2 else 'three channels'} of {np.dtype(dtype).name}"
        raise SourceError(file.name, want, f"{found.dtype} {found.shape}", "convert the picture")
    return np.asarray(found)
