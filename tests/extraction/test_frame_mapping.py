"""Laws of sources/mapping and corrections: VISOR's two tables are used, checked, and missed loudly where they are needed."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from afford.common.errors import SourceError
from stages.extraction import source_read
from tests.extraction.test_frame_archives import tree
from tests.helpers.made_epic import VIDEO, write_tables, write_tar, write_zip
from tests.helpers.tiny_root import SQUARE, image, mask, write_points

DENSE = "Interpolations-DenseAnnotations/train"


def keys(root: Path) -> list[int]:
    (clip,) = source_read.run(tree(root), source_read.Params())
    return [key.frame for key in clip.key_frames]


def test_released_frames_need_the_mapping(tmp_path: Path) -> None:
    """A missing table or video is an error for released frames; VISOR's own frames need no table."""
    write_tar(write_tables(tmp_path))
    assert keys(tmp_path) == [2, 17, 32]
    (tmp_path / "frame_mapping.json").write_text('{"P01_01": {}}')
    with pytest.raises(SourceError, match=r"frame_mapping\.json: expected an entry for P03_101, got 1 other"):
        keys(tmp_path)
    (tmp_path / "frame_mapping.json").unlink()
    with pytest.raises(SourceError, match=r"frame_mapping\.json: expected VISOR's table .* got no such file; put it"):
        keys(tmp_path)
    (tmp_path / "P03" / "rgb_frames" / "P03_101.tar").unlink()
    write_zip(tmp_path)
    assert keys(tmp_path) == [1, 16, 31]


@pytest.mark.parametrize("text", ["[]", '{"P03_101": []}', '{"P03_101": {"a": 1}}'])
def test_a_mapping_of_another_form_is_refused(text: str, tmp_path: Path) -> None:
    """One sentence that names the file."""
    write_tar(write_tables(tmp_path))
    (tmp_path / "frame_mapping.json").write_text(text)
    with pytest.raises(SourceError, match=r"frame_mapping\.json: expected an object of objects of strings"):
        keys(tmp_path)


def test_an_image_outside_the_mapping_is_dropped_with_a_remark(tmp_path: Path) -> None:
    """Other images are kept."""
    write_tar(write_tables(tmp_path))
    write_points(tmp_path, VIDEO, [image(VIDEO, key) for key in (1, 16, 20)])
    (clip,) = source_read.run(tree(tmp_path), source_read.Params())
    assert [key.frame for key in clip.key_frames] == [2, 17]
    assert any("1 images are not in frame_mapping.json, P03_101_frame_0000000020.jpg" in text for text in clip.warnings)


def test_dense_images_have_the_offset_of_their_sparse_neighbours(tmp_path: Path) -> None:
    """Dense images between two neighbours with different offsets are dropped."""
    write_tar(write_tables(tmp_path, keys=(1, 16, 31, 38)))
    table = json.loads((tmp_path / "frame_mapping.json").read_text())
    table[VIDEO][f"{VIDEO}_frame_0000000038.jpg"] = "frame_0000000040.jpg"
    (tmp_path / "frame_mapping.json").write_text(json.dumps(table))
    points = []
    for frame, (start, end) in {8: (1, 16), 20: (16, 31), 35: (31, 38)}.items():
        point = image(VIDEO, frame, [mask("mug", f"d{frame}", [[[x / 2.25, y / 2.25] for x, y in SQUARE]])])
        point["image"]["name"] = point["image"]["name"].replace(".jpg", ".png")
        point["image"] |= {"interpolation_start_frame": f"{VIDEO}_frame_{start:010d}.png",
                           "interpolation_end_frame": f"{VIDEO}_frame_{end:010d}.png"}
        points.append(point)
    (tmp_path / DENSE).mkdir(parents=True)
    write_points(tmp_path, f"{VIDEO}_interpolations", points).rename(tmp_path / DENSE / f"{VIDEO}_interpolations.json")
    (clip,) = source_read.run(tree(tmp_path), source_read.Params())
    assert [key.frame for key in clip.key_frames if key.dense] == [9, 21]
    assert [key.frame for key in clip.key_frames if not key.dense] == [2, 17, 32, 40]


@pytest.mark.parametrize("name", ["corrections.json", "correct.json"])
def test_corrections_must_speak_of_what_is_there(name: str, tmp_path: Path) -> None:
    """A right one is applied under either name; one of a frame, a hand or a mask that does not exist is refused."""
    write_zip(write_tables(tmp_path))
    first = f"{VIDEO}_frame_0000000001.jpg"

    def contact(table: object) -> str:
        (tmp_path / name).write_text(json.dumps(table))
        (clip,) = source_read.run(tree(tmp_path), source_read.Params())
        return next(a.contact for a in clip.key_frames[0].annotations if a.name == "left hand")

    assert contact({"P09_01_frame_0000000001.jpg": {"left hand": "x"}}) == "m1"
    assert contact({first: {"left hand": "inconclusive"}}) == "inconclusive"
    second = f"{VIDEO}_frame_0000000002.jpg"
    for table in ({first: {"right hand": "m1"}}, {first: {"left hand": "m2"}}, {second: {"left hand": "m1"}}):
        with pytest.raises(SourceError, match=r"expected an annotated image, one of its hands, and a mask of it"):
            contact(table)
    with pytest.raises(SourceError, match="an object of objects of strings"):
        contact([1])
