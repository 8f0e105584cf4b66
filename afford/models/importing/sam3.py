"""SAM 3 (Carion et al. 2025) in the layout of `transformers` (facebook/sam3), of which only the detector is kept."""

from __future__ import annotations

import torch
from transformers import Sam3Config, Sam3Model

from afford.models.importing import Imported, parameter_count, shapes_of
from afford.models.importing.sam import config_text
from afford.models.importing.source import Source
from afford.models.sam3 import LEFT_OUT

DETECTOR = "detector_model."
"""prefix of the detector's tensors in the files of the video model"""


def import_sam3(source: Source) -> Imported:
    """Read a folder of SAM 3 (`Kind`); the tracker of the video model is left out."""
    own, words = source.config("sam3"), source.tokenizer()
    if not own or not words:
        raise ValueError("expected config.json and tokenizer.json of SAM 3 beside its tensors, as in the folder facebook/sam3; the "
                         "file sam3.pt of the authors' code has other names, which this project does not read")
    given = {name.removeprefix(DETECTOR): tensor for name, tensor in source.tensors.items() if not name.startswith(LEFT_OUT)}
    config = Sam3Config.from_dict(own.get("detector_config", own))
    with torch.device("meta"):
        expected = shapes_of(Sam3Model(config))
    return Imported("SAM 3, its detector", "--set hand_detect.backend=sam3 --set hand_detect.sam3.model=DIR",
                    {"config.json": config_text(config, Sam3Model), "tokenizer.json": words}, given, expected,
                    counted=parameter_count(given, ("position_ids",)))  # fmt: skip
