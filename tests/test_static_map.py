"""The graph of static sets: one detector, three reports on the same pictures, whichever pictures they are."""

from __future__ import annotations

from maps.settings import Settings
from maps.static_sets import detector, pictures, told
from runner import Graph
from schemas.files import FileTree


def test_three_reports_on_the_same_pictures() -> None:
    """The detector is trained once; own and true boxes are asked of the same weights, all of the same pictures."""
    g, p = Graph(), Settings()
    samples = pictures(g, FileTree("umd", ()), p)
    found = told(g, samples, g.leaf("model", FileTree("sor3d", ())), detector(g, g.leaf("dataset", FileTree("made", ())), p), p)
    g.target("static", *found)
    stages = {node.name: node for node in g.stages()}
    assert set(stages) == {"static_read", "boxes_train", "static_sor3d", "static_boxes", "static_true_boxes"}
    inputs = {name: dict(node.inputs) for name, node in stages.items()}
    reports = ("static_sor3d", "static_boxes", "static_true_boxes")
    assert len({inputs[name]["samples"] for name in reports}) == 1
    assert inputs["static_boxes"]["model"] == inputs["static_true_boxes"]["model"] != inputs["static_sor3d"]["model"]
    how = {name: (stages[name].params.backend, stages[name].params.true_boxes) for name in reports}
    assert how == {"static_sor3d": ("sor3d", False), "static_boxes": ("boxes", False), "static_true_boxes": ("boxes", True)}
    assert stages["boxes_train"].params.backend == "boxes"
