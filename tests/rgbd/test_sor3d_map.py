"""The targets of SOR3D-AFF: what their graphs hold, where their sequences come from, and that a second run does no work."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import pytest

from afford.common.kernel_cache import use_kernel_cache
from afford.rgbd.evaluate.ablation_rows import WHOLE
from commands.errors import UsageError
from commands.origin import origin
from maps.settings import Origin, Settings
from pipeline import build
from runner import Runner
from schemas.files import FileTree
from tests.helpers.made_interactions import utkinect
from tests.helpers.made_sor3d import FEW

ROOT = Path(__file__).resolve().parents[2]


def stages(target: str, place: Origin, p: Settings) -> dict[str, set[str]]:
    """The stages of a target and the names of their inputs."""
    return {node.name: {name for name, _ in node.inputs} for node in build(target, place, p).stages()}


def test_pretraining_runs_only_for_its_row() -> None:
    """Trained on the sequences themselves, or on clips of actions if given."""
    before = {"sor3d_pretrain", "pretrained_sor3d_train", "pretrained_sor3d_evaluate"}
    plain = stages("sor3d", Origin("x"), Settings())
    assert not plain.keys() & before and "encoder" not in plain["sor3d_train"]
    asked = Settings.of(sor3d_report=replace(Settings.rgbd.sor3d_report, pretrained=True))
    alone = stages("sor3d", Origin("x"), asked)
    assert alone.keys() >= before and not alone.keys() & {"sor3d_train", "action_read"}
    assert "encoder" in alone["pretrained_sor3d_train"]
    given = stages("sor3d", Origin("x", actions=FileTree("a", ())), asked)
    assert given.keys() >= before | {"action_read", "action_pack"}


def test_ablation_trains_the_requested_rows() -> None:
    """Pretrained rows are separate; `steps` overrides those of the training."""
    both = stages("sor3d-ablation", Origin("x"), FEW)
    assert both.keys() >= {"sor3d_train", "pretrained_sor3d_train"} and "more" in both["sor3d_report"]
    few = FEW.with_stages(sor3d_report=replace(FEW.rgbd.sor3d_report, rows=("rgb",), steps=1))
    graph = build("sor3d-ablation", Origin("x"), few)
    assert "pretrained_sor3d_train" not in {node.name for node in graph.stages()}
    (training,) = [node for node in graph.stages() if node.name == "sor3d_train"]
    assert training.params.steps == 1
    later = few.with_stages(sor3d_report=replace(few.rgbd.sor3d_report, seeds=2, first_seed=3))
    (recipes,) = [node for node in build("sor3d-ablation", Origin("x"), later).nodes if node.name == "planned"]
    assert [recipe.name for recipe in recipes.value] == ["rgb-3", "rgb-4"]
    with pytest.raises(ValueError, match="expected rows of rgb"):
        build("sor3d-ablation", Origin("x"), FEW.with_stages(sor3d_report=replace(FEW.rgbd.sor3d_report, rows=("best",))))


def test_recorded_sequences_have_no_truth_and_one_length() -> None:
    """Motion is not scored; ten slots are read, whatever the lengths."""
    graph = build("sor3d", Origin("mine", sequences=(FileTree("a", ()),)), Settings())
    by = {node.name: node for node in graph.stages()}
    assert not by.keys() & {"scene_flow_score", "difference_flow", "interaction_plan"}
    assert by["interaction_read"].params.frames == "slots" and by["interaction_pack"].params.licence == "unknown"


def test_sources_of_sequences_and_actions(tmp_path: Path) -> None:
    """Rendered ones need no source; a wrong folder is refused, also one of actions."""
    digest = lambda path: path.name  # noqa: E731
    place, _ = origin("sor3d", None, Settings(), digest)
    assert (place.name, place.sequences, place.actions) == ("sor3d", (), None)
    utkinect(tmp_path / "utkinect")
    asked = Settings.of(sor3d_report=replace(Settings.rgbd.sor3d_report, actions=str(tmp_path / "utkinect")))
    found = origin("sor3d-ablation", None, asked, digest)[0].actions
    assert found is not None and found.find("actionLabel.txt")
    with pytest.raises(UsageError, match="--source"):
        origin("sor3d", tmp_path / "none", Settings(), digest)
    lost = asked.with_stages(sor3d_report=replace(asked.rgbd.sor3d_report, actions=str(tmp_path / "none")))
    with pytest.raises(UsageError, match=r"sor3d_report\.actions"):
        origin("sor3d", None, lost, digest)


@pytest.mark.slow
def test_second_run_is_cached_and_shared_with_the_ablation(tmp_path: Path) -> None:
    """The training of the whole model serves both targets."""
    use_kernel_cache(tmp_path)
    runner = Runner(tmp_path, ROOT, "afford.codecs:CODEC", "afford.common.worker:prepare")
    first = runner.run(build("sor3d", Origin("tiny"), FEW), "sor3d")
    assert first.ok and first.ran["sor3d_train"] == 1, first.failures
    assert runner.run(build("sor3d", Origin("tiny"), FEW), "sor3d").ran == {}
    few = FEW.with_stages(sor3d_report=replace(FEW.rgbd.sor3d_report, rows=("rgb", WHOLE)))
    more = runner.run(build("sor3d-ablation", Origin("tiny"), few), "sor3d-ablation")
    assert more.ok and (more.ran["sor3d_train"], more.cached["sor3d_train"]) == (1, 1)
