"""Stage mesh_read: mesh, parts and report of one object."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from afford.codecs.structure import load_folder, save
from stages.surface import mesh_read
from tests.helpers.mesh_files import box, tree, write_labels, write_obj


def write(folder: Path) -> None:
    solid = box()
    write_obj(folder / "bread_knife.obj", solid.vertices * 1000, solid.faces[:, ::-1])
    write_labels(folder / "bread_knife.obj", parts={"blade": [[0, 50]]})


def test_mesh_parts_and_report_agree(tmp_path: Path) -> None:
    """Check names, category, sizes, decisions and repairs."""
    write(tmp_path)
    found = mesh_read.run(tree(tmp_path), mesh_read.Params(categories=("mug", "knife")))
    assert found.mesh.name == found.parts.name == found.report.name == "bread_knife" and found.mesh.category == "knife"
    assert len(found.parts.part) == len(found.mesh.faces) == len(found.mesh.uv) and (found.parts.part == 0).sum() == 50
    assert (found.report.unit, found.report.decided, found.report.scale) == ("mm", "its size", 0.001)
    assert [(r.what, r.count) for r in found.report.repairs] == [("faces turned", len(found.mesh.faces))]
    assert found.report.source == "bread_knife.obj" and found.report.deviation_m == 0


def test_result_is_deterministic_and_survives_storage(tmp_path: Path) -> None:
    """Check two runs, and a round trip through the codecs."""
    (tmp_path / "in").mkdir()
    write(tmp_path / "in")
    a, b = (mesh_read.run(tree(tmp_path / "in"), mesh_read.Params()) for _ in range(2))
    assert a.report == b.report
    assert all(getattr(a.mesh, k).tobytes() == getattr(b.mesh, k).tobytes() for k in ("vertices", "faces", "uv", "texture"))
    for name in ("mesh", "parts", "report"):
        (tmp_path / name).mkdir()
        save(getattr(a, name), tmp_path / name)
    assert load_folder(tmp_path / "report") == a.report
    assert np.array_equal(load_folder(tmp_path / "mesh").vertices, a.mesh.vertices)


@pytest.mark.parametrize("wrong", [{"max_faces": 3}, {"max_texture_px": 1000}, {"unit": "feet"}])
def test_parameters_out_of_range_are_refused(wrong: dict[str, object], tmp_path: Path) -> None:
    """Check that the error names the valid range."""
    write(tmp_path)
    with pytest.raises(ValueError, match="expected"):
        mesh_read.run(tree(tmp_path), replace(mesh_read.Params(), **wrong))
