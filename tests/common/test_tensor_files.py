"""Tensors of files of torch are read without running code."""

from __future__ import annotations

import os
import pickle
import zipfile
from collections import OrderedDict
from pathlib import Path
from typing import Any

import pytest
import torch
from torch import nn

from afford.models.tensor_files import read_tensors


class Trap:
    """Unpickling this makes a folder."""

    def __init__(self, place: Path) -> None:
        self.place = place

    def __reduce__(self) -> Any:
        return os.mkdir, (str(self.place),)


def test_tensors_of_every_kind_come_back(tmp_path: Path) -> None:
    """Types, views, shared and empty storages, parameters, scalars."""
    base = torch.arange(12.0)
    given = OrderedDict(
        view=base.view(3, 4).T, part=base[5:7], same=base, half=base.half(), brain=base.bfloat16(), count=torch.tensor(7),
        none=torch.empty(0, 3), yes=torch.tensor([True, False]), byte=torch.arange(3, dtype=torch.uint8),
        trained=nn.Parameter(torch.ones(2)),
    )  # fmt: skip
    torch.save(given, tmp_path / "a.pt")
    found = read_tensors(tmp_path / "a.pt")
    assert found.keys() == given.keys()
    assert all(torch.equal(found[name], tensor) and found[name].dtype == tensor.dtype for name, tensor in given.items())


def test_code_in_a_checkpoint_is_not_run(tmp_path: Path) -> None:
    """Tensors are read from a checkpoint that torch's own reader refuses or would run."""
    trap = tmp_path / "sprung"
    torch.save({"state_dict": {"a": torch.ones(2)}, "callbacks": {Trap: Trap(trap)}, "path": tmp_path}, tmp_path / "a.ckpt")
    assert list(read_tensors(tmp_path / "a.ckpt")) == ["a"] and not trap.exists()
    with pytest.raises(pickle.UnpicklingError):
        torch.load(tmp_path / "a.ckpt", weights_only=True)
    run, words = Trap(trap).__reduce__()
    run(*words)
    assert trap.exists()  # it is a trap


def test_torchscript_is_read_by_name(tmp_path: Path) -> None:
    """Traced or scripted; one that is frozen has no names any more."""
    module = nn.Sequential(nn.Conv2d(3, 4, 1), nn.BatchNorm2d(4)).eval()
    scripted = torch.jit.script(module)
    for name, script in (("a.pt", scripted), ("b.pt", torch.jit.trace(module, torch.rand(1, 3, 4, 4)))):
        script.save(str(tmp_path / name))
        found = read_tensors(tmp_path / name)
        assert found.keys() == module.state_dict().keys()
        assert all(torch.equal(found[key], tensor) for key, tensor in module.state_dict().items())
    torch.jit.freeze(scripted).save(str(tmp_path / "c.pt"))
    with pytest.raises(ValueError, match="expected tensors by name, got none"):
        read_tensors(tmp_path / "c.pt")


@pytest.mark.parametrize("data", [b"", b"PK", b"\x80\x02}q\x00.", pickle.dumps({"a": 1})])
def test_other_files_are_refused(tmp_path: Path, data: bytes) -> None:
    """The error is one sentence with the name of the file."""
    (tmp_path / "a.pt").write_bytes(data)
    (tmp_path / "a.safetensors").write_bytes(data)
    for name in ("a.pt", "a.safetensors", "missing.pt"):
        with pytest.raises(ValueError, match=f"{name}: expected a checkpoint or TorchScript") as error:
            read_tensors(tmp_path / name)
        assert "\n" not in str(error.value)


DAMAGED = [b"\x80\x02.", b"\x80\x02(t", b"\x80\x02h\x05.", b"\x80\x02}K\x01s.", b"\x80\x02X\x01\x00\x00\x00aQ.",
           b"\x80\x02ctorch._utils\n_rebuild_tensor_v2\n)R.", b"\x80\x02cos\nsystem\nX\x02\x00\x00\x00ls\x85R."]  # fmt: skip


@pytest.mark.parametrize("data", DAMAGED)
def test_a_damaged_pickle_is_refused(tmp_path: Path, data: bytes) -> None:
    """Missing operands, unknown references and calls of other functions."""
    with zipfile.ZipFile(tmp_path / "a.pt", "w") as archive:
        archive.writestr("a/data.pkl", data)
    with pytest.raises(ValueError, match=r"a\.pt: expected"):
        read_tensors(tmp_path / "a.pt")


def test_a_tensor_larger_than_its_numbers_is_refused(tmp_path: Path) -> None:
    """A shape that reaches beyond the storage."""
    torch.save({"a": torch.zeros(4)}, tmp_path / "a.pt")
    with zipfile.ZipFile(tmp_path / "a.pt") as archive:
        parts = {name: archive.read(name) for name in archive.namelist()}
    with zipfile.ZipFile(tmp_path / "b.pt", "w") as archive:
        for name, data in parts.items():
            archive.writestr(name, data[:8] if name.endswith("/data/0") else data)
    with pytest.raises(ValueError, match=r"b\.pt: expected"):
        read_tensors(tmp_path / "b.pt")
