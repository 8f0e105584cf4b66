"""Released checkpoint of XMem: its number of parameters, names and shapes, and files that do not fit."""

from __future__ import annotations

import json
from pathlib import Path

import pytest
import torch
from torch import Tensor

from afford.models.importing.source import Source
from afford.models.importing.write import check_fit
from afford.models.importing.xmem import import_xmem
from afford.models.xmem import config_of, load_model
from afford.models.xmem_network import XMem, XMemConfig
from commands.weights_import import bring, show, verify
from tests.helpers.tiny_models import XMEM, save_xmem

PARAMETERS, TENSORS = 62_185_224, 412
"""the README of the release states 62.2 million"""
RELEASED = {
    "key_encoder.conv1.weight": (64, 3, 7, 7),
    "key_encoder.bn1.running_mean": (64,),
    "key_encoder.res2.0.downsample.0.weight": (256, 64, 1, 1),
    "key_encoder.res2.2.conv3.weight": (256, 64, 1, 1),
    "key_encoder.layer2.3.bn2.weight": (128,),
    "key_encoder.layer3.0.downsample.1.running_var": (1024,),
    "key_encoder.layer3.5.conv2.weight": (256, 256, 3, 3),
    "value_encoder.conv1.weight": (64, 5, 7, 7),
    "value_encoder.bn1.num_batches_tracked": (),
    "value_encoder.layer1.1.conv2.weight": (64, 64, 3, 3),
    "value_encoder.layer2.0.downsample.0.weight": (128, 64, 1, 1),
    "value_encoder.layer3.1.bn2.bias": (256,),
    "value_encoder.fuser.block1.downsample.weight": (512, 1280, 3, 3),
    "value_encoder.fuser.block1.conv2.bias": (512,),
    "value_encoder.fuser.attention.ChannelGate.mlp.1.weight": (32, 512),
    "value_encoder.fuser.attention.ChannelGate.mlp.3.bias": (512,),
    "value_encoder.fuser.attention.SpatialGate.spatial.conv.weight": (1, 2, 7, 7),
    "value_encoder.fuser.block2.conv2.weight": (512, 512, 3, 3),
    "value_encoder.hidden_reinforce.transform.weight": (192, 576, 3, 3),
    "key_proj.key_proj.weight": (64, 1024, 3, 3),
    "key_proj.d_proj.weight": (1, 1024, 3, 3),
    "key_proj.e_proj.bias": (64,),
    "decoder.fuser.block1.conv1.weight": (512, 1600, 3, 3),
    "decoder.hidden_update.g16_conv.weight": (256, 512, 1, 1),
    "decoder.hidden_update.g8_conv.weight": (256, 256, 1, 1),
    "decoder.hidden_update.g4_conv.weight": (256, 257, 1, 1),
    "decoder.hidden_update.transform.weight": (192, 320, 3, 3),
    "decoder.up_16_8.skip_conv.weight": (512, 512, 3, 3),
    "decoder.up_16_8.out_conv.downsample.weight": (256, 512, 3, 3),
    "decoder.up_8_4.skip_conv.weight": (256, 256, 3, 3),
    "decoder.up_8_4.out_conv.conv2.bias": (256,),
    "decoder.pred.weight": (1, 256, 3, 3),
}


def test_the_released_size() -> None:
    """Parameters, tensors, names and shapes, without memory; sizes of the network follow from the tensors."""
    with torch.device("meta"):
        model = XMem()
    state = model.state_dict()
    assert sum(parameter.numel() for parameter in model.parameters()) == PARAMETERS and len(state) == TENSORS
    assert {name: tuple(state[name].shape) for name in RELEASED} == RELEASED
    assert "decoder.up_8_4.out_conv.downsample.weight" not in state and "value_encoder.fuser.block2.downsample.weight" not in state
    assert config_of(state, "x") == XMemConfig()
    made = import_xmem(Source((Path("XMem.pth"),), dict(state), ()))
    check_fit(made, "XMem.pth")
    assert made.counted == PARAMETERS


def test_an_imported_folder_and_the_file_give_the_same_model(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """Tensor by tensor; `show` and `verify` know the kind."""
    file = save_xmem(tmp_path / "XMem.pth")
    assert bring("xmem", [file], tmp_path / "out", "float32", True) == 0
    assert json.loads(capsys.readouterr().out)["parameters"] == sum(parameter.numel() for parameter in XMem(XMEM).parameters())
    one, other = (load_model(str(place)).state_dict() for place in (file, tmp_path / "out"))
    assert one.keys() == other.keys() and all(torch.equal(one[name], other[name]) for name in one)
    assert verify(tmp_path / "out", False) == show(tmp_path / "out", False) == 0
    assert "mask_densify.xmem.model=" in capsys.readouterr().out


def change(how: str, state: dict[str, Tensor]) -> str:
    """Change a state dict; the words of the refusal."""
    if how == "missing":
        del state["decoder.pred.bias"]
        return "missing decoder.pred.bias"
    if how == "renamed":
        state["key_proj.s_proj.weight"] = state.pop("key_proj.d_proj.weight")
        return "missing key_proj.d_proj.weight"
    if how == "misshaped":
        state["decoder.up_8_4.skip_conv.bias"] = torch.zeros(3)
        return r"misshaped decoder.up_8_4.skip_conv.bias: expected \(16,\), got \(3,\)"
    if how == "single object":
        state["value_encoder.conv1.weight"] = state["value_encoder.conv1.weight"][:, :4].clone()
        return r"misshaped value_encoder.conv1.weight: expected \(4, 5, 7, 7\), got \(4, 4, 7, 7\)"
    if how == "no sensory memory":
        del state["decoder.hidden_update.transform.weight"]
        return "expected a checkpoint of XMem, which has the tensor decoder.hidden_update.transform.weight"
    state["key_proj.key_proj.weight"] = torch.zeros(0)
    return r"expected key_proj.key_proj.weight with 1 to 65536 channels, got shape \(0,\)"


@pytest.mark.parametrize("how", ["missing", "renamed", "misshaped", "single object", "no sensory memory", "empty"])
def test_tensors_that_do_not_fit_are_named(how: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """Loader and import refuse the file in one sentence; nothing is written."""
    state = XMem(XMEM).state_dict()
    words = change(how, state)
    torch.save(state, tmp_path / "XMem.pth")
    with pytest.raises(ValueError, match=words) as caught:
        load_model(str(tmp_path / "XMem.pth"))
    assert "\n" not in str(caught.value)
    assert bring("xmem", [tmp_path / "XMem.pth"], tmp_path / "out", "float32", False) == 1
    refused = capsys.readouterr().err.strip()
    assert refused.startswith("error: xmem: ") and "\n" not in refused and words.split()[-1].strip("\\()") in refused
    assert [path.name for path in tmp_path.iterdir()] == ["XMem.pth"]


def test_counters_of_batches_may_be_missing(tmp_path: Path) -> None:
    """Files of older versions of torch have none."""
    state = {name: tensor for name, tensor in XMem(XMEM).state_dict().items() if not name.endswith("num_batches_tracked")}
    torch.save(state, tmp_path / "XMem.pth")
    assert load_model(str(tmp_path / "XMem.pth")).config == XMEM
    assert bring("xmem", [tmp_path / "XMem.pth"], tmp_path / "out", "float16", True) == 0


def test_a_folder_without_weights_is_refused(tmp_path: Path) -> None:
    (tmp_path / "config.json").write_text("{}")
    with pytest.raises(ValueError, match=r"expected model\.safetensors of XMem in this folder, got none"):
        load_model(str(tmp_path))
