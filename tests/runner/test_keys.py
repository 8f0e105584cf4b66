"""Keys: tagged, canonical pre-images with pinned digests, so that a change of their form is noticed."""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path
from types import SimpleNamespace

import pytest

from runner import keys
from runner.canonical import canonical, digest, dumps
from runner.fingerprint import Fingerprint
from runner.keys import VECTORS, StageSpec, machine_kind, seed_of


@dataclass(frozen=True)
class Params:
    radius: int = 10
    scale: float = 0.5
    names: tuple[str, ...] = ("a", "b")


CODE = Fingerprint("c0de", {}, set(), set())
PINNED_SEED = 5502538689932801200
SPEC = StageSpec("shout", "toy.shout:run", canonical(Params()), CODE, {"numpy": "2.0"}, 1, 1.0, ())


def task_key(spec: StageSpec, inputs: dict[str, str], schemas: dict[str, str]) -> str:
    return keys.task_key(keys.spec_digest(spec), inputs, keys.schema_text(schemas))


def test_the_key_of_a_task_is_this_digest() -> None:
    """A change here invalidates every stored artifact, and must be intended."""
    key = task_key(SPEC, {"frames": "f00d"}, {"Frames": "v1"})
    assert key == "5d4e696ddf5146859186a910791090afef82e802b2f2cceaeb93c7e4ae461fd4"


def test_the_digest_of_a_tree_is_this_digest() -> None:
    """Tag, spelling and hash are pinned."""
    assert dumps(canonical(Params())) == '{"fields":{"names":["a","b"],"radius":10,"scale":0.5},"of":"Params"}'
    assert digest("tag", [1, "a", None]) == "620fe6aff922008e304676dcc9181db4a109677c08a56312db152822ad63c302"


def test_the_order_of_inputs_does_not_matter() -> None:
    """Arguments are identified by name."""
    assert task_key(SPEC, {"a": "1", "b": "2"}, {}) == task_key(SPEC, {"b": "2", "a": "1"}, {})


@pytest.mark.parametrize("change", [
    {"params": canonical(Params(radius=11))}, {"code": Fingerprint("c0d3", {}, set(), set())},
    {"libraries": {"numpy": "2.1"}}, {"threads": 2}])
def test_the_parts_of_a_stage_are_in_its_key(change: dict[str, object]) -> None:
    """Parameters, code (function included), libraries and threads."""
    assert task_key(replace(SPEC, **change), {}, {}) != task_key(SPEC, {}, {})  # type: ignore[arg-type]


def test_names_and_a_memory_need_are_in_no_key() -> None:
    """Two names, or two modules, of one function share outputs."""
    assert task_key(replace(SPEC, name="again", function="toy.b:run", memory_gib=9.0), {}, {}) == task_key(SPEC, {}, {})


def test_inputs_and_schemas_are_in_the_key() -> None:
    """Content and schema of the inputs."""
    found = {task_key(SPEC, inputs, schemas) for inputs in ({"a": "1"}, {"a": "2"}, {"b": "1"}) for schemas in ({}, {"A": "1"})}
    assert len(found) == 6


def test_values_of_different_types_differ() -> None:
    """1, 1.0, True, '1' and None are five values; -0.0 is not 0.0; NaN and infinities have a spelling."""
    assert len({dumps(canonical(value)) for value in (1, 1.0, True, "1", None, 0.0, -0.0, float("nan"), float("inf"))}) == 9
    with pytest.raises(TypeError, match="got set"):
        canonical({1, 2})


def test_the_seed_comes_from_parameters_and_inputs() -> None:
    """63 bits; no other part of the key counts, so that another form of keys changes no output."""
    seeds = {seed_of(params, inputs) for params in ("p", "q") for inputs in ({"a": "1", "b": "2"}, {"a": "2", "b": "2"})}
    assert len(seeds) == 4 and all(0 <= seed < 2**63 for seed in seeds)
    assert seed_of("p", {"b": "2", "a": "1"}) == seed_of("p", {"a": "1", "b": "2"}) == PINNED_SEED


def test_the_kind_of_machine_names_its_vector_units() -> None:
    """Architecture first, then the CPU flags that affect last bits and mixed precision."""
    cpuinfo = Path("/proc/cpuinfo")
    if not cpuinfo.exists():
        pytest.skip("the system does not list what its CPU has")
    flags = set(cpuinfo.read_text().replace("\t", " ").split())
    assert set(VECTORS) & set(machine_kind().split()) == set(VECTORS) & flags


@dataclass(frozen=True)
class OnDevice:
    device: str = "cpu"
    bf16: bool = False


@pytest.mark.parametrize(("params", "counts"), [(OnDevice(), False), (OnDevice("cuda:1"), True), (OnDevice(bf16=True), True)])
def test_a_device_brings_the_kind_of_machine_into_the_key(params: OnDevice, counts: bool) -> None:
    """A parameter that MACHINE names counts where it is set, and a device where it is not the CPU."""
    node = SimpleNamespace(name="stage", params=params)
    assert keys._machine(["device", "bf16"], node, frozenset()) == (machine_kind() if counts else "")  # type: ignore[arg-type]


def test_the_kind_of_machine_is_in_the_key_of_stages_that_say_so() -> None:
    """A stage without the declaration shares outputs between kinds of machine."""
    kinds = [task_key(replace(SPEC, machine=kind), {}, {}) for kind in ("", "x86_64 avx2", "x86_64 avx2 avx512_bf16")]
    assert len(set(kinds)) == 3 and kinds[0] == task_key(SPEC, {}, {})
