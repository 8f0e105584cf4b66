r"""Compare names and shapes of published checkpoints with the authors' packages, in full size; writes into docs/checkpoints.md.

    SAM2_BUILD_CUDA=0 python -m pip install --no-deps --no-build-isolation --target DIR sam2==1.1.0
    python -m pip install --no-deps --target DIR sam3==0.1.4 segment-anything==1.0 openai-clip==1.0.1 hydra-core omegaconf \
        antlr4-python3-runtime==4.9.3 iopath portalocker timm einops ftfy wcwidth
    PYTHONPATH=. python benchmarks/published_names.py DIR

Models are built on torch's device meta, without weights, and imported as `weights import` does. Nothing is installed into the
environment of the project. Packages that the authors need only to run, such as torchvision, are replaced by empty ones.
"""

from __future__ import annotations

import importlib
import sys
import warnings
from collections.abc import Callable, Iterator
from importlib.abc import Loader, MetaPathFinder
from importlib.machinery import ModuleSpec
from importlib.metadata import distributions
from importlib.util import find_spec, module_from_spec, spec_from_file_location
from pathlib import Path
from tempfile import TemporaryDirectory
from types import ModuleType, SimpleNamespace
from typing import Any
from unittest.mock import MagicMock

import torch
from torch import Tensor
from torch.overrides import TorchFunctionMode

from afford.common.registry import load
from afford.models.importing import Imported
from afford.models.importing.source import Source
from benchmarks.pages import ROOT, into
from commands.weights_import import KINDS

PAGE = ROOT / "docs" / "checkpoints.md"
ABSENT = ("torchvision", "triton", "decord", "pkg_resources")
Tensors = dict[str, Tensor]
Built = Iterator[tuple[str, Tensors]]
CLIP = {"ViT-B/32": (512, 224, 12, 768, 32, 77, 49408, 512, 8, 12), "ViT-B/16": (512, 224, 12, 768, 16, 77, 49408, 512, 8, 12),
        "ViT-L/14": (768, 224, 24, 1024, 14, 77, 49408, 768, 12, 12),
        "ViT-L/14 at 336 px": (768, 336, 24, 1024, 14, 77, 49408, 768, 12, 12)}  # fmt: skip
"""arguments of OpenAI's class for its published sizes"""


class Absent(MetaPathFinder, Loader):
    """Finds empty modules in the place of `ABSENT`."""

    def find_spec(self, name: str, path: Any = None, target: Any = None) -> ModuleSpec | None:
        """Spec of an empty module, None for other names."""
        return ModuleSpec(name, self, is_package=True) if name.partition(".")[0] in ABSENT else None

    def create_module(self, spec: ModuleSpec) -> ModuleType:
        """Make the empty module."""
        return Anything(spec.name)

    def exec_module(self, module: ModuleType) -> None:
        """Leave the module empty."""


class Anything(ModuleType):
    """Module that has every public name."""

    def __getattr__(self, name: str) -> Any:
        if name.startswith("__"):
            raise AttributeError(name)
        return MagicMock()


class OnMeta(TorchFunctionMode):
    """Creates the tensors that constructors want on a GPU on the device meta, and numbers that they read back on the CPU."""

    def __torch_function__(self, func: Any, types: Any, args: Any = (), kwargs: Any = None) -> Any:
        given = dict(kwargs or {})
        if func is torch.linspace:
            given["device"] = "cpu"
        elif str(given.get("device", "")).startswith("cuda"):
            given["device"] = "meta"
        return func(*args, **given)


def sam() -> Built:
    """Segment Anything, every size."""
    package = importlib.import_module("segment_anything")
    for name in ("vit_b", "vit_l", "vit_h"):
        yield name, package.sam_model_registry[name]().state_dict()


def sam2() -> Built:
    """SAM 2 and 2.1, every size, by the authors' own configs."""
    omegaconf, hydra = importlib.import_module("omegaconf"), importlib.import_module("hydra.utils")
    configs = Path(str(importlib.import_module("sam2").__file__)).parent / "configs"
    for folder in ("sam2", "sam2.1"):
        for path in sorted((configs / folder).glob("*.yaml")):
            model = hydra.instantiate(omegaconf.OmegaConf.load(path).model)
            yield path.stem, {f"model.{name}": tensor for name, tensor in model.state_dict().items()}


def sam3() -> Built:
    """Detector of SAM 3, with the prefix that it has in sam3.pt, and the neck of the tracker."""
    builder: Any = importlib.import_module("sam3.model_builder")
    builder.SimpleTokenizer = lambda bpe_path: SimpleNamespace(vocab_size=49408, context_length=77)  # without its file
    model = builder.build_sam3_image_model(bpe_path="none", device="meta", load_from_HF=False)
    model.backbone.vision_backbone = builder._create_vision_backbone(enable_inst_interactivity=True)
    yield "sam3", {f"detector.{name}": tensor for name, tensor in model.state_dict().items()}


def clip() -> Built:
    """CLIP with vision transformers, every size; the package itself compares versions of torch by a package that is absent."""
    found = find_spec("clip")
    spec = spec_from_file_location("clip_model", f"{found.submodule_search_locations[0]}/model.py")  # type: ignore[union-attr, index]
    model = module_from_spec(spec)  # type: ignore[arg-type]  # it is a package
    spec.loader.exec_module(model)  # type: ignore[union-attr]
    for name, sizes in CLIP.items():
        yield name, model.CLIP(*sizes).state_dict()


PACKAGES: dict[str, tuple[str, Callable[[], Built]]] = {
    "sam": ("segment_anything", sam), "sam2": ("sam2", sam2), "sam3": ("sam3", sam3), "clip": ("openai_clip", clip)}
"""kind -> name of the authors' package, and its models"""


def rows(kind: str, package: str, models: Built, read: Callable[[Source], Imported], tokenizer: Path) -> Iterator[str]:
    """Lines of the table: what has no place in our model, what our model lacks, and what has another shape."""
    for name, published in models:
        made = read(Source((tokenizer / name,), published, (tokenizer,)))
        ours, wanted = ({key: tuple(one.shape) for key, one in part.items()} for part in (made.tensors, made.expected))
        extra, lacking = ours.keys() - wanted.keys(), wanted.keys() - ours.keys()
        shapes = [key for key in ours.keys() & wanted.keys() if ours[key] != wanted[key]]
        numbers = f"{len(published)} | {len(wanted)} | {len(lacking)} | {len(extra)} | {len(shapes)}"
        yield f"| `{kind}` | {package} | {name} | {numbers} |"


def main(packages: Path) -> None:
    """Build, import, compare, write."""
    readers = {kind: load(KINDS, kind) for kind in PACKAGES}  # transformers looks for torchvision itself
    sys.path.insert(0, str(packages))
    sys.meta_path.insert(0, Absent())
    warnings.simplefilter("ignore")
    versions = {one.metadata["Name"].replace("-", "_"): one.version for one in distributions(path=[str(packages)])}
    lines = ["| kind | package | model | published tensors | ours | missing | without a place | other shape |",
             "|---|---|---|--:|--:|--:|--:|--:|"]  # fmt: skip
    with TemporaryDirectory() as tokenizer, torch.device("meta"), OnMeta():
        (Path(tokenizer) / "tokenizer.json").write_text("{}")
        for kind, (package, models) in PACKAGES.items():
            lines += rows(kind, f"{package.replace('_', '-')} {versions[package]}", models(), readers[kind], Path(tokenizer))
    into(PAGE, "names", "published_names.py", "\n".join(lines) + "\n")


if __name__ == "__main__":
    main(Path(sys.argv[1]))
