"""The graph of static sets: one detector, three reports on the same pictures, whichever pictures they are."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import pytest

from afford.common.kernel_cache import use_kernel_cache
from commands.errors import UsageError
from commands.origin import origin
from commands.run import Request, run
from maps.rgbd import REPORTS, detector, evaluate_pictures, pictures
from maps.settings import SYSTEM_OF, Origin, Settings
from pipeline import build
from runner import Graph, Runner
from runner.graph import Node
from schemas.files import FileTree
from stages.rgbd import boxes_train
from tests.helpers.made_interactions import iit_aff, umd
from tests.helpers.made_sor3d import FEW, STEPS

ROOT = Path(__file__).resolve().parents[2]
SMALL = FEW.with_stages(boxes_train=replace(Settings.rgbd.boxes_train, **STEPS),
                        static_read=replace(Settings.rgbd.static_read, crop_px=16),
                        static_evaluate=replace(Settings.rgbd.static_evaluate, shown=1))


def stages(target: str, place: Origin, p: Settings) -> dict[str, Node]:
    return {node.name: node for node in build(target, place, p).stages()}


def test_three_reports_on_the_same_pictures() -> None:
    """The detector is trained once; own and true boxes are asked of the same weights, all of the same pictures."""
    g, p = Graph(), Settings()
    samples = pictures(g, FileTree("umd", ()), p)
    boxes = g.pick(detector(g, g.leaf("dataset", FileTree("made", ())), p), lambda trained: trained.files)
    found = evaluate_pictures(g, samples, g.leaf("model", FileTree("sor3d", ())), boxes, p)
    g.target("static", *found)
    stages = {node.name: node for node in g.stages()}
    assert set(stages) == {"static_read", "boxes_train", *REPORTS}
    inputs = {name: dict(node.inputs) for name, node in stages.items()}
    assert len({inputs[name]["samples"] for name in REPORTS}) == 1
    assert inputs["static_boxes"]["model"] == inputs["static_true_boxes"]["model"] != inputs["static_sor3d"]["model"]
    how = {name: (stages[name].params.backend, stages[name].params.boxes.true_boxes) for name in REPORTS}
    assert how == {"static_sor3d": ("sor3d", False), "static_boxes": ("boxes", False), "static_true_boxes": ("boxes", True)}
    assert stages["boxes_train"].value is boxes_train.run


def test_trainings_are_those_of_target_sor3d() -> None:
    """The same stages with the same parameters; no evaluation and no score of the motion, which this target does not need."""
    ours, theirs = stages("static-sets", Origin("x"), Settings()), stages("sor3d", Origin("x"), Settings())
    shared = ours.keys() & theirs.keys()
    assert {"interaction_render", "scene_flow", "interaction_pack", "sor3d_train"} <= shared
    assert all(ours[name].params == theirs[name].params and ours[name].value is theirs[name].value for name in shared)
    assert ours.keys() - shared == {
        "boxes_train", "static_report", *REPORTS, *(f"record_{name}" for name in (*REPORTS, "boxes_train", "static_report"))}
    asked = Settings.of(sor3d_report=replace(Settings.rgbd.sor3d_report, pretrained=True))
    assert stages("static-sets", Origin("x"), asked).keys() >= {"sor3d_pretrain", "pretrained_sor3d_train"}


def test_pictures_come_from_rendered_sequences_or_from_a_root() -> None:
    """Rendered sequences: validation only, or the requested split. A root: every picture. The training data is the same."""
    rendered = stages("static-sets", Origin("x"), Settings())
    given = stages("static-sets", Origin("x", pictures=FileTree("umd", ())), Settings())
    assert given.keys() - rendered.keys() == {"static_read"} and not rendered.keys() - given.keys()
    assert {rendered[name].params.split for name in REPORTS} == {"val"} and {given[name].params.split for name in REPORTS} == {""}
    asked = Settings.of(static_evaluate=replace(Settings.rgbd.static_evaluate, split="train"))
    assert stages("static-sets", Origin("x"), asked)["static_boxes"].params.split == "train"
    only = stages("static-sets", Origin("x", pictures=FileTree("umd", ())), asked)["static_read"].params
    assert only == replace(Settings.rgbd.static_read, split="train")
    assert given["static_read"].params == Settings.rgbd.static_read
    assert given["boxes_train"].params == rendered["boxes_train"].params


def test_sources_of_pictures(tmp_path: Path) -> None:
    """A root is identified by its labels; another kind than the requested one, or none, is refused in one sentence."""
    digest = lambda path: path.name  # noqa: E731
    place, _ = origin("static-sets", None, Settings(), digest)
    assert (place.name, place.pictures, place.sequences) == ("static-sets", None, ())
    umd(tmp_path / "umd"), iit_aff(tmp_path / "iit")
    iit = Settings.of(static_read=replace(Settings.rgbd.static_read, backend="iit-aff"))
    for name, p in (("umd", Settings()), ("iit", iit)):
        place, _ = origin("static-sets", tmp_path / name, p, digest)
        assert place.name == f"static-sets-{name}" and place.pictures is not None and place.sequences == ()
    (tmp_path / "neither").mkdir()
    other = iit.with_stages(static_read=replace(iit.rgbd.static_read, backend="coco"))
    for name, p, hint in (("iit", Settings(), "looks like iit-aff: add --set static_read.backend=iit-aff"),
                          ("umd", iit, "looks like umd"), ("neither", Settings(), "expected a root of umd with .*got no such file"),
                          ("none", Settings(), "expected a folder, got nothing"),
                          ("umd", other, "expected umd or iit-aff, got 'coco'")):
        with pytest.raises(UsageError, match=hint) as caught:
            origin("static-sets", tmp_path / name, p, digest)
        assert str(caught.value).startswith(f"--source {tmp_path / name}: ") and "\n" not in str(caught.value)


@pytest.mark.slow
def test_a_run_from_nothing_to_three_reports(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """Run from rendering to the reports.

    Models that `sor3d` has trained are not trained again, and pictures of a root are evaluated with the same weights.
    """
    store = tmp_path / "store"
    use_kernel_cache(store)
    runner = Runner(store, ROOT, "afford.codecs:CODEC", "afford.common.worker:prepare")
    assert runner.run(build("sor3d", Origin("tiny"), SMALL), "sor3d").ran["sor3d_train"] == 1
    report = runner.run(build("static-sets", Origin("tiny"), SMALL), "static-sets")
    assert report.ok and "sor3d_train" not in report.ran and report.ran["boxes_train"] == 1, report.failures
    (tmp_path / "few.json").write_text(json.dumps(changed(SMALL)))
    request = Request("static-sets", umd(tmp_path / "umd") and tmp_path / "umd", params=tmp_path / "few.json", jobs=1, store=store,
                      json=True)  # fmt: skip
    assert run(request) == 0
    said = json.loads(capsys.readouterr().out.splitlines()[-1])
    recorded = (f"record_{name}" for name in (*REPORTS, "static_report"))
    assert set(said["ran"]) == {"static_read", "static_report", *REPORTS, *recorded}
    assert {"metrics.json", "report.md"} == {path.name for path in Path(said["outputs"]["static_report"]).iterdir()}
    for name in REPORTS:
        assert {"metrics.json", "report.md", "sheet.png"} == {path.name for path in Path(said["outputs"][name]).iterdir()}
        assert 0 <= said["metrics"][f"{name}.iou"] <= 1 and (Path(said["outputs"]["recordings"]) / f"{name}.mcap").exists()


def changed(p: Settings) -> dict[str, dict[str, object]]:
    """Settings that differ from the defaults, as a file of parameters."""
    usual = {stage: (vars(p.params(stage)), vars(Settings().params(stage))) for stage in SYSTEM_OF}
    return {name: {key: value for key, value in mine.items() if value != plain[key]} for name, (mine, plain) in usual.items()
            if mine != plain}  # fmt: skip
