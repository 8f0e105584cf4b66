"""SAM 2 and 2.1 (Ravi et al. 2024): `sam2*_hiera_*.pt` as published, or the layout of `transformers`."""

from __future__ import annotations

import torch
from transformers import Sam2VideoConfig, Sam2VideoModel

from afford.models.importing import Imported, parameter_count, shapes_of
from afford.models.importing.sam import config_text
from afford.models.importing.source import Source
from afford.models.sam2 import COPY, TOP, our_state_dict, published_config, published_size


def import_sam2(source: Source) -> Imported:
    """Read a checkpoint of SAM 2 (`Kind`)."""
    given = {name.removeprefix(TOP): tensor for name, tensor in source.tensors.items()}
    own = source.config("sam2_video")
    if own:
        config, title = Sam2VideoConfig.from_dict(own), "SAM 2 (config.json)"
        given = our_state_dict(given) if any(name.startswith("image_encoder.") for name in given) else given
    else:
        version = "2.1" if "no_obj_embed_spatial" in given else "2.0"
        size = published_size(given, ", ".join(path.name for path in source.files))
        config, title = published_config(size, version=version), f"SAM {version} hiera {size}"
        given = our_state_dict(given)
    with torch.device("meta"):
        expected = shapes_of(Sam2VideoModel(config))
    return Imported(title, "--set mask_densify.backend=sam2 --set mask_densify.sam2.model=DIR; object_completion likewise",
                    {"config.json": config_text(config, Sam2VideoModel)}, given, expected, counted=parameter_count(given, (COPY,)))
