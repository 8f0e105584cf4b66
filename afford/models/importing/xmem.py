"""XMem (Cheng and Schwing 2022): `XMem.pth` as released, whose names are those of the network here."""

from __future__ import annotations

import torch

from afford.models.importing import Imported, parameter_count
from afford.models.importing.source import Source
from afford.models.xmem import config_of
from afford.models.xmem_network import XMem

STATISTICS = ("running_mean", "running_var", "num_batches_tracked")
"""last parts of the names of buffers, which are no parameters"""


def import_xmem(source: Source) -> Imported:
    """Read a checkpoint of XMem (`Kind`). Counters of batches may be missing."""
    given = source.tensors
    with torch.device("meta"):
        own = XMem(config_of(given, ", ".join(path.name for path in source.files))).state_dict()
    expected = {name: tensor for name, tensor in own.items() if name in given or not name.endswith(".num_batches_tracked")}
    return Imported("XMem", "--set mask_densify.backend=xmem --set mask_densify.xmem.model=DIR", {}, given, expected, single=True,
                    counted=parameter_count(given, STATISTICS))  # fmt: skip
