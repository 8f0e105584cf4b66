"""Names and settings of another target are refused with the targets that have them."""

from __future__ import annotations

import pytest

from commands.origin import origin
from commands.target_graphs import track_reads
from maps.settings import SYSTEM_OF, Settings
from pipeline import TARGETS, build
from tests.helpers.command import Made, call


@pytest.mark.parametrize(("words", "said"), [
    (("explain", "model_train", "--target", "dataset"),
     "dataset has no stage 'model_train'; it belongs to train, benchmark, ablation"),
    (("explain", "model-train", "--target", "dataset"), "it belongs to train"),
    (("explain", "rl_grasp_refinement", "--target", "dataset"), "it belongs to grasp (as teacher_0, "),
    (("run", "dataset", "--only", "model_train"), "it belongs to train"),
    (("run", "dataset", "--force", "model_train"), "it belongs to train"),
    (("run", "dataset", "--dry-run", "--force", "model_train"), "it belongs to train"),
    (("run", "dataset", "--set", "model_train.steps=5"),
     "--set model_train.steps=5: dataset does not use model_train; it belongs to train, benchmark, ablation"),
    (("run", "dataset", "--set", "model-train.steps=4500"), "dataset does not use model_train"),
    (("run", "dataset", "--dry-run", "--set", "sor3d_train.steps=5"), "it belongs to sor3d, sor3d-ablation"),
    (("status", "--set", "sor3d_train.steps=5"), "it belongs to sor3d"),
    (("explain", "--set", "sor3d_train.steps=5"), "it belongs to sor3d"),
    (("run", "dataset", "--set", "scene_render.seed=1"), "dataset does not use scene_render with this source; it belongs to "),
])  # fmt: skip
def test_what_belongs_to_other_targets_is_refused_with_their_names(words: tuple[str, ...], said: str, made: Made) -> None:
    """Exit 2, one sentence, and nothing is run."""
    before = made.traces
    refused = call(*words, "--source", made.source, "--store", made.store)
    assert refused.code == 2 and said in refused.words and refused.err.count("\n") == 1 and made.traces == before


def test_a_file_of_parameters_may_have_those_of_other_targets(made: Made, tmp_path) -> None:  # type: ignore[no-untyped-def]
    """One file for several targets."""
    (tmp_path / "all.toml").write_text("[model_train]\nsteps = 5\n[mask_densify]\nradius = 3\n")
    assert made.ask("explain", "--params", tmp_path / "all.toml").code == 0


@pytest.mark.parametrize("target", TARGETS)
def test_what_is_read_of_the_settings_is_found(target: str) -> None:
    """Of every target: not all of them, and of each stage whose parameters are in the graph under its own name."""
    chosen, read = track_reads(Settings())
    graph = build(target, origin(target, None, chosen, lambda path: "")[0], chosen)
    fields = {stage: Settings().params(stage) for stage in SYSTEM_OF}
    own = {node.name for node in graph.stages() if node.name in fields and node.params is fields[node.name]}
    assert own <= read and not fields.keys() <= read
