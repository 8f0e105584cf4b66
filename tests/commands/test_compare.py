"""Comparison of backends: one column each, the same clips, shared tasks once, costs and scores together."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from commands.compare import page
from commands.settings import columns
from stages.extraction.mask_densify import BACKENDS
from tests.helpers.command import Made, call
from tests.helpers.tiny_source import write_source


def test_several_backends_give_several_settings() -> None:
    """Their order is kept, with all combinations for several stages; other settings are shared."""
    found = columns(["mask_densify.backend=flow, nearest", "object-completion.backend=hull,visible", "mask_densify.radius=5"], None)
    assert list(found) == ["flow_hull", "flow_visible", "nearest_hull", "nearest_visible"]
    assert {p.extraction.mask_densify.radius for p in found.values()} == {5}
    assert list(columns(["mask_densify.backend=flow,flow"], None)) == list(columns([], None)) == [""]


@pytest.mark.parametrize("value", ["flow,sam3", "sam3", "flow,,nearest"])
def test_an_unknown_backend_is_refused_with_the_list(value: str) -> None:
    """Exit 2, before anything runs."""
    refused = call("run", "extraction-report", "--set", f"mask_densify.backend={value}")
    assert refused.code == 2 and f"Valid: {', '.join(sorted(BACKENDS))}" in refused.words


def test_targets_other_than_the_report_do_not_compare(tmp_path: Path) -> None:
    """Exit 2 with the reason."""
    refused = call("run", "dataset", "--set", "mask_densify.backend=flow,nearest", "--dry-run", "--store", tmp_path)
    assert refused.code == 2 and "only extraction-report compares several" in refused.words


def test_parameters_of_which_no_graph_is_made_are_a_fault_of_usage(tmp_path: Path) -> None:
    """A student without its teacher: one sentence, exit 2, no traceback."""
    refused = call("run", "grasp-full", "--set", "grasp_report.rows=student", "--dry-run", "--store", tmp_path)
    assert refused.code == 2 and "student after teacher" in refused.words and "Traceback" not in refused.words


@pytest.mark.parametrize("target", ["extraction_report", "extraction-report"])
def test_underscores_and_hyphens_name_the_same_target(target: str, made: Made) -> None:
    """A target that ran under one spelling is cached under both."""
    plan = made.run(target, "--dry-run").json
    assert {task["status"] for task in plan["tasks"]} == {"cached"}


def test_two_backends_give_two_columns(made: Made, tmp_path: Path) -> None:
    """Two columns of object_completion: stages above are cached, metrics carry the labels, the page shows both and the cost."""
    mine = made.copy(tmp_path)
    result = mine.run("extraction-report", "--set", "object_completion.backend=template,hull").json
    assert set(result["ran"]) == {f"{stage}_hull" for stage in (
        "object_completion", "affordance_intersect", "extraction_score", "extraction_report")}  # fmt: skip
    metrics = result["metrics"]
    assert metrics["template.clips.frames"] == metrics["hull.clips.frames"] > 0
    assert metrics["template.densify.j.gap15"] == metrics["hull.densify.j.gap15"]
    assert metrics["hull.completion.amodal_iou"] == pytest.approx(metrics["template.completion.amodal_iou"], abs=0.5)
    assert metrics["hull.cpu_ms_per_frame.object_completion"] > 0 and metrics["hull.peak_mib.object_completion"] > 10
    page = Path(result["outputs"]["page"]).read_text()
    assert "| measure | template | hull |" in page and "| object_completion, CPU ms a frame |" in page
    assert "| mask_densify, CPU ms a frame |" not in page  # the same stage in both columns
    folder = Path(result["outputs"]["report"])
    assert json.loads((folder / "metrics.json").read_text()) == metrics
    assert (folder / "hull" / "sheet.jpg").exists() and (folder / "template" / "report.md").exists()
    again = mine.run("extraction-report", "--set", "object_completion.backend=template,hull").json
    assert again["ran"] == {} and again["metrics"] == metrics


def test_a_column_that_fails_leaves_the_other(made: Made, tmp_path: Path) -> None:
    """Exit 1, with the failure listed and the other column on the page.

    The column has weights of another model. Missing weights are a usage error.
    """
    mine, foreign = made.copy(tmp_path), tmp_path / "foreign"
    foreign.mkdir()
    (foreign / "config.json").write_text('{"model_type": "clip"}')
    both = ("--set", "object_completion.backend=template,sam2")
    result = mine.run("extraction-report", *both, "--set", f"object_completion.sam2.model={foreign}")
    assert result.code == 1 and "object_completion_sam2" in result.words
    assert "| measure | template |" in Path(result.json["outputs"]["page"]).read_text()
    refused = mine.run("extraction-report", *both)
    assert refused.code == 2 and "object_completion.sam2.model=MODEL" in refused.words


def test_a_comparison_is_planned_like_any_run(tmp_path: Path) -> None:
    """Shared tasks are listed once, differing ones again under the column's label."""
    source = write_source(tmp_path / "tiny", videos=("P96_01",), truth=True)
    result = call("run", "extraction_report", "--source", source, "--store", tmp_path / "store", "--dry-run", "--json",
                "--set", "mask_densify.backend=flow,nearest").json  # fmt: skip
    stages = [task["stage"] for task in result["tasks"]]
    assert stages.count("frame_decode") == stages.count("mask_densify") == stages.count("mask_densify_nearest") == 1
    assert {"mask_densify_gap30_nearest", "hand_inpaint_nearest", "extraction_report_nearest"} <= set(stages)
    assert not {"source_read_nearest", "key_thin_nearest", "frame_decode_nearest"} & set(stages)


def test_the_page_shows_columns_and_what_their_own_stages_cost() -> None:
    """One row per measure, one column per backend; a measure without any value is omitted."""
    base = {"clips.standard": 2.0, "clips.hard": 1.0, "clips.frames": 38.0, "densify.j.gap15": 0.9}
    metrics = {"flow": base | {"cpu_ms_per_frame.mask_densify": 80.04, "peak_mib.mask_densify": 300.0},
               "nearest": base | {"densify.j.gap15": 0.5, "cpu_ms_per_frame.mask_densify": 1.0, "peak_mib.mask_densify": 200.0}}
    text = page(metrics, ["mask_densify", "extraction_score", "extraction_report"])
    assert "2 standard and 1 hard clips, 38 frames" in text
    assert "| measure | flow | nearest |\n|---|--:|--:|\n| masks: J, key frames 15 apart | 0.900 | 0.500 |\n" in text
    assert "| mask_densify, CPU ms a frame | 80.0 | 1.0 |\n| mask_densify, peak MiB | 300.0 | 200.0 |\n" in text
    assert "contact" not in text and "extraction_score," not in text
