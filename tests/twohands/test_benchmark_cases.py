"""Reading a benchmark: everything that is odd about real files is read as it is, noted, or refused in one sentence."""

from __future__ import annotations

import json
from pathlib import Path

import cv2
import numpy as np
import pytest

from afford.common.errors import SourceError
from afford.dataset import act_affordance
from afford.twohands.benchmark import toras
from afford.twohands.benchmark.cases import read
from schemas.affordance import Taxonomy
from schemas.benchmark import Case
from tests.helpers.made_cases import SIZE, as_tree, box, read_all, write_benchmark, write_case, write_mask


@pytest.fixture(scope="module")
def cases(tmp_path_factory: pytest.TempPathFactory) -> dict[str, Case]:
    return read_all(write_benchmark(tmp_path_factory.mktemp("made") / "bench"))


def test_cases_come_in_order_of_protocol_video_and_frame(cases: dict[str, Case]) -> None:
    """Cropped before masks; folders without a picture are no cases."""
    assert list(cases) == [
        "cropped/11286c45-7869/00000335", "cropped/P01_01/0000140", "cropped/P01_01/0000150", "cropped/P02_03/0000007",
        "cropped/P95_01/0000001", "cropped/W95_01/0000002", "masks/P01_01/0000140", "masks/P01_01/0000150"]  # fmt: skip


def test_grey_edges_belong_to_the_mask(cases: dict[str, Case]) -> None:
    """The pixel of grey value 1 counts: masks read as `> 0`."""
    assert np.array_equal(cases["cropped/P01_01/0000140"].modes[0], np.stack([box(10, 10, 30, 30), box(50, 20, 70, 40)]))


def test_one_hand_missing_is_an_empty_region(cases: dict[str, Case]) -> None:
    """No aff_left.png: the left region is empty, and the taxonomy right fits."""
    case = cases["cropped/P01_01/0000150"]
    assert not case.modes[0, 0].any() and case.modes[0, 1].any() and case.taxonomy.tolist() == [Taxonomy.RIGHT] and not case.notes


def test_a_taxonomy_that_disagrees_is_kept_and_noted(cases: dict[str, Case]) -> None:
    """P14_05/0002981 of ActAffordance is such a case."""
    case = cases["cropped/11286c45-7869/00000335"]
    assert case.taxonomy.tolist() == [Taxonomy.BOTH_DIFFERENT]
    assert case.notes == ("taxonomy disagrees: it says both_different, the masks say right",)


def test_groups_tell_sources_and_scenes(cases: dict[str, Case]) -> None:
    """EPIC and Ego4D by the video's name; a case with modes.json is neither; what the file adds is kept."""
    found = {name: case.groups for name, case in cases.items()}
    assert found["cropped/P01_01/0000140"] == ("all", "kitchen", "epic")
    assert found["cropped/11286c45-7869/00000335"] == ("all", "shift", "ego4d")
    assert found["cropped/P95_01/0000001"] == ("all", "kitchen", "unseen_kind")
    assert found["cropped/W95_01/0000002"] == ("all", "shift")


def test_modes_are_read(cases: dict[str, Case]) -> None:
    """null is a hand that a mode does not take; a folder without modes.json has one mode."""
    case = cases["cropped/P95_01/0000001"]
    assert case.modes.any(axis=(2, 3)).tolist() == [[False, True], [True, False], [True, True]]
    assert case.taxonomy.tolist() == [Taxonomy.RIGHT, Taxonomy.LEFT, Taxonomy.BOTH_SAME]
    assert len(cases["cropped/P01_01/0000140"].modes) == 1


def test_whole_images_are_scored_on_the_grid_of_their_masks(cases: dict[str, Case]) -> None:
    """A 32 x 32 picture with 60 x 80 masks, as 256 with 855 in ActAffordance."""
    assert cases["masks/P01_01/0000140"].modes.shape[2:] == SIZE


def test_a_mask_of_another_size_is_fitted_and_noted(tmp_path: Path) -> None:
    """Nearest neighbour on the grid of the crop."""
    folder = write_case(tmp_path, "cropped/P01_01/0000001", "take mug", "left", {"aff_left": box(5, 5, 15, 15, (30, 40))})
    case = read_all(folder.parents[2])["cropped/P01_01/0000001"]
    assert np.array_equal(case.modes[0, 0], box(10, 10, 30, 30)) and case.notes == ("aff_left.png resized from 40x30 to 80x60",)


def corrupt(folder: Path, how: str) -> None:
    """Break one thing of a case."""
    annotation = json.loads((folder / "annotation.json").read_text())
    if how == "no annotation":
        (folder / "annotation.json").unlink()
    elif how == "no region":
        write_mask(folder / "aff_left.png", np.zeros(SIZE, bool))
    elif how == "no picture":
        (folder / "aff_left.png").write_bytes(b"PNG?")
    elif how == "unknown mode":
        (folder / "modes.json").write_text('{"modes": [{"left": "mode7_left.png", "right": null, "taxonomy": [1, 0, 0, 0]}]}')
    elif how == "no mode":
        (folder / "modes.json").write_text('{"modes": []}')
    else:
        change = {"narration": {"narration": 3}, "taxonomy": {"taxonomy": [1, 1, 0, 0]}, "groups": {"groups": "kitchen"}}[how]
        (folder / "annotation.json").write_text(json.dumps(annotation | change))


@pytest.mark.parametrize(
    ("how", "message"),
    [("no annotation", "annotation.json, got no such file"), ("no region", "a region in every mode"), ("no picture", "a grey PNG"),
     ("unknown mode", "mode7_left.png"), ("no mode", "one per mode"), ("narration", "'narration': expected str"),
     ("taxonomy", "four numbers, one of them 1"), ("groups", "a list of plain words")],
)  # fmt: skip
def test_bad_cases_are_refused_in_one_sentence(tmp_path: Path, how: str, message: str) -> None:
    """The error names the file, the field and the expected value."""
    folder = write_case(tmp_path, "cropped/P01_01/0000001", "take mug", "left", {"aff_left": box(1, 1, 9, 9)})
    corrupt(folder, how)
    with pytest.raises(SourceError, match="cropped/P01_01/0000001") as refused:
        read(act_affordance.cases(as_tree(tmp_path))[0])
    assert message in str(refused.value) and "\n" not in str(refused.value)


def test_a_folder_without_cases_is_refused(tmp_path: Path) -> None:
    """A missing folder, or a link to the outside, is refused too."""
    with pytest.raises(SourceError, match=r"cropped/<video>/<frame>/inpainting.png"):
        act_affordance.cases(as_tree(tmp_path))
    with pytest.raises(SourceError, match="expected a folder, got nothing"):
        act_affordance.read_tree(tmp_path / "none", str)
    (tmp_path / "bench").mkdir()
    (tmp_path / "bench" / "link.png").symlink_to("/etc/hostname")
    with pytest.raises(SourceError, match="inside the folder"):
        act_affordance.read_tree(tmp_path / "bench", str)


def entity(name: str, *annotations: list[list[list[float]]]) -> dict:
    return {"name": name, "annotationBlocks": [
        {"blockName": "Text", "annotations": []},
        {"blockName": "Segmentation", "annotations": [{"segments": segments} for segments in annotations]},
        {"blockName": "Segmentation", "annotations": [{"segments": [[[0, 0], [512, 0], [512, 512]]]}]}]}  # fmt: skip


def document(name: str, *entities: dict) -> dict:
    return {"documents": [{"name": name}], "annotation": {"annotationGroups": [{"annotationEntities": list(entities)}]}}


SQUARE = [[100.0, 100.0], [200.0, 100.0], [200.0, 200.0], [100.0, 200.0]]
HOLE = [[140.0, 140.0], [160.0, 140.0], [160.0, 160.0], [140.0, 160.0]]
OTHER = [[300.0, 300.0], [400.0, 300.0], [400.0, 310.0], [300.0, 310.0]]


def test_toras_outlines_become_masks(tmp_path: Path) -> None:
    """Outlines of the TORAS tool are drawn as masks.

    Names of EPIC and of Ego4D are read; the first Segmentation block counts; overlapping outlines cancel; areas scale by
    (855/512) squared.
    """
    export = [document("37_P01_01_benchmark_frame_00000140.png", entity(" right_hand", [SQUARE, HOLE], [OTHER, [[1, 1]]]),
                       entity("left_hand")),
              document("251_benchmark_frame_11286c45-7869-4b84_00000335.png", entity("left_hand", [SQUARE])),
              {"documents": [{"name": "x"}]}]  # fmt: skip
    found = toras.read(json.dumps(export).encode(), "toras_anns.json")
    assert set(found.outlines) == {("P01_01", 140), ("11286c45-7869-4b84", 335)}
    mask = toras.draw(found.outlines["P01_01", 140]["right"])
    assert mask.shape == (855, 855)
    assert mask.sum() == pytest.approx((100 * 100 - 20 * 20 + 100 * 10) * (855 / 512) ** 2, rel=0.01)
    assert not mask[round(150 * 855 / 512), round(150 * 855 / 512)] and mask[round(305 * 855 / 512), round(350 * 855 / 512)]


def test_toras_replaces_the_masks_of_a_benchmark(tmp_path: Path) -> None:
    """Whole images directly, crops by target_box; a picture that was not annotated is refused."""
    (tmp_path / "toras_anns.json").write_text(json.dumps([document("9_P01_01_frame_0000140.png", entity("left_hand", [SQUARE]))]))
    tiny = {"aff_left": box(0, 0, 9, 9, (855, 855))}
    write_case(tmp_path, "masks/P01_01/0000140", "take mug", "left", tiny, size=(16, 16))
    write_case(tmp_path, "cropped/P01_01/0000140", "take mug", "left", {}, size=(300, 200), target_box=[150, 100, 350, 400])
    files = as_tree(tmp_path)
    outlines = toras.of_tree(files)
    cropped, whole = (read(case, outlines) for case in act_affordance.cases(files))
    assert whole.modes.shape[2:] == (855, 855) and np.array_equal(whole.modes[0, 0, 100:400, 150:350], cropped.modes[0, 0])
    write_case(tmp_path, "masks/P01_01/0000141", "take mug", "left", tiny, size=(16, 16))
    with pytest.raises(SourceError, match="an entry of that video and frame"):
        read(act_affordance.cases(as_tree(tmp_path))[-1], outlines)


def test_a_toras_name_without_a_hand_is_refused() -> None:
    """The entry's number and the name are in the message."""
    export = [document("9_P01_01_frame_0000140.png", entity("thumb", [SQUARE]))]
    with pytest.raises(SourceError, match="entry 0, field 'name': expected left_hand or right_hand, got 'thumb'"):
        toras.read(json.dumps(export).encode(), "toras_anns.json")


def test_the_helper_writes_grey_edges(tmp_path: Path) -> None:
    """The tests above would not see `> 127` otherwise."""
    write_mask(tmp_path / "m.png", box(2, 2, 5, 5))
    assert set(np.unique(cv2.imread(str(tmp_path / "m.png"), cv2.IMREAD_GRAYSCALE))) == {0, 1, 255}
