"""Target negative-affordance end to end: a folder of meshes, of which labelled ones are scored."""

from __future__ import annotations

import json
from pathlib import Path

import pytest
import trimesh

from commands.errors import UsageError
from commands.origin import origin
from pipeline import build
from runner import Runner
from tests.helpers.made_objects import SMALL, looked

ROOT = Path(__file__).resolve().parents[2]


def labelled(folder: Path) -> None:
    """Write a screwdriver with a label file, its faces sorted by part, and a ball without labels."""
    x = looked()
    order = x.parts.part.argsort(kind="stable")
    trimesh.Trimesh(x.mesh.vertices, x.mesh.faces[order], process=False).export(folder / "driver.stl")
    ends = [int((x.parts.part <= n).sum()) for n in range(len(x.parts.names))]
    ranges = {name: [[start, end]] for name, start, end in zip(x.parts.names, [0, *ends], ends, strict=False)}
    (folder / "driver.stl.parts.json").write_text(json.dumps({"version": 1, "category": "screwdriver", "parts": ranges}))
    trimesh.creation.icosphere(3, 0.05).export(folder / "thing.ply")


def test_folder_of_meshes(tmp_path: Path) -> None:
    """Check scores of the labelled object, none of the unknown one, and a second run without work."""
    meshes, store = tmp_path / "meshes", tmp_path / "store"
    meshes.mkdir()
    labelled(meshes)
    runner = Runner(store, ROOT, "afford.codecs:CODEC", "afford.common.worker:prepare", jobs=0)
    place, source = origin("negative-affordance", meshes, SMALL, lambda path: runner.hash_file(path)[0])
    assert [tree.name for tree in place.meshes] == ["driver", "thing"] and source is not None and source.kind == "meshes"
    report = runner.run(build("negative-affordance", place, SMALL), "negative-affordance")
    assert report.ok, report.failures
    assert report.ran["mesh_read"] == report.ran["negative_affordance_score"] == 2 and "object_build" not in report.ran
    files = runner.store.load(report.outputs["negative_affordance_report"][0][1])
    metrics = json.loads(next(file.path for file in files.files if file.name == "metrics.json").read_text())
    assert metrics["objects"] == 2 and metrics["whole_object.given.recall"] == 1 and 0 <= metrics["given.iou"] <= 1
    assert {"coarse_box.given.iou", "coarse_box.whole_object_taken", "clip_relevance.given.iou"} <= metrics.keys()
    assert report.ran["object_windows"] == report.ran["window_score"] == 2
    text = next(file.path for file in files.files if file.name == "report.md").read_text()
    assert "| unknown | given |  |  |  |  |" in text and "| screwdriver | given | 0." in text
    assert not runner.run(build("negative-affordance", place, SMALL), "negative-affordance").ran


def test_folder_without_meshes_is_refused(tmp_path: Path) -> None:
    """Check the error."""
    with pytest.raises(UsageError, match="expected a mesh"):
        origin("negative-affordance", tmp_path, SMALL, lambda path: "")
