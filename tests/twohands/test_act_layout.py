"""The synthetic benchmark on disk: ActAffordance's folders, read back as they were meant."""

from __future__ import annotations

import json
from pathlib import Path

import cv2
import numpy as np
import pytest

from afford.common import files
from afford.dataset import act_affordance
from afford.twohands.benchmark import cases
from schemas.scene import Mode, Picture, Still, Stills
from schemas.video import Narration
from tests.helpers.command import call

WIDTH, HEIGHT, MARGIN = 96, 54, 50
THING = slice(20, 40), slice(30, 60)


def narration(number: int, text: str) -> Narration:
    """A task."""
    return Narration(f"P95_01_{number}", 1, 1, text, "take", 0, "take", "mug", 13, "cup", ("mug",))


def mode(taxonomy: int, weight: float, shift: int = 0) -> Mode:
    """Left hand at the left end of the thing, right hand at the right end, as the taxonomy says."""
    masks = np.zeros((4, HEIGHT, WIDTH), bool)
    active = (taxonomy != 1, taxonomy != 0)
    for side, column in enumerate((32, 52)):
        if active[side]:
            masks[side, 24 + shift : 32 + shift, column : column + 6] = True
            masks[2 + side][THING] = True
    names = tuple("mug" if on else "" for on in active)
    return Mode(masks, names, tuple("body" if on else "" for on in active), taxonomy, weight)  # type: ignore[arg-type]


def still(number: int, *modes: Mode, text: str = "take mug") -> Still:
    """One task of the only picture."""
    return Still(number, 0, narration(number, text), ("mug",), False, modes)


def room(*stills: Still, setting: str = "kitchen") -> Stills:
    """A room with one picture, half as large as its masks."""
    rgb = np.random.default_rng(0).integers(0, 255, (HEIGHT // 2, WIDTH // 2, 3), np.uint8)
    jpeg = cv2.imencode(".jpg", rgb)[1].reshape(-1)
    return Stills("P95_01", "P95", "test", setting, WIDTH // 2, HEIGHT // 2, (Picture(jpeg),), stills)


def written(folder: Path, *rooms: Stills) -> Path:
    """The benchmark of some rooms."""
    act_affordance.write_benchmark(folder, rooms, "test", MARGIN, lambda done, total: None)
    return folder


def test_a_task_has_the_published_files_and_all_its_modes(tmp_path: Path) -> None:
    """The likeliest mode under the published names, the others beside them, a missing hand as no file and null."""
    root = written(tmp_path, room(still(1, mode(1, 0.6), mode(0, 0.3), mode(2, 0.1))))
    for kind in ("masks", "cropped"):
        folder = root / kind / "P95_01" / "0000001"
        assert {path.name for path in folder.iterdir()} == {
            "inpainting.png", "annotation.json", "aff_right.png", "obj_right.png", "modes.json", "mode1_left.png",
            "mode2_left.png", "mode2_right.png"}
        said = json.loads((folder / "modes.json").read_text())["modes"]
        assert [(m["left"], m["right"]) for m in said] == [(None, "aff_right.png"), ("mode1_left.png", None),
                                                          ("mode2_left.png", "mode2_right.png")]
        assert [m["taxonomy"].index(1) for m in said] == [1, 0, 2] and sum(m["weight"] for m in said) == pytest.approx(1)


def test_the_annotation_has_the_published_keys(tmp_path: Path) -> None:
    """Seven of them, and what rows of the report the task counts in."""
    root = written(tmp_path, room(still(1, mode(1, 1.0))))
    said = json.loads((root / "masks/P95_01/0000001/annotation.json").read_text())
    assert said == {"taxonomy": [0, 1, 0, 0], "obj_left": None, "obj_right": "mug", "narration": "take mug", "noun": "mug",
                    "verb": "take", "vector": None, "scene": "kitchen", "groups": ["known"]}


def test_masks_are_padded_above_and_crops_are_cut_with_a_margin(tmp_path: Path) -> None:
    """Full masks are squares with the picture below, crops are the objects' box and 50 px of 855 around it."""
    one = mode(2, 1.0)
    root = written(tmp_path, room(still(1, one)))
    full = cv2.imread(str(root / "masks/P95_01/0000001/aff_left.png"), cv2.IMREAD_UNCHANGED)
    assert full.shape == (WIDTH, WIDTH) and set(np.unique(full)) == {0, 255}
    assert np.array_equal(full[WIDTH - HEIGHT :] > 0, one.masks[0]) and not full[: WIDTH - HEIGHT].any()
    picture = cv2.imread(str(root / "masks/P95_01/0000001/inpainting.png"))
    assert picture.shape == (WIDTH // 2, WIDTH // 2, 3) and not picture[: (WIDTH - HEIGHT) // 2].any()
    margin = round(MARGIN * WIDTH / 855)
    rows, columns = (slice(part.start - margin, part.stop + margin) for part in THING)
    crop = cv2.imread(str(root / "cropped/P95_01/0000001/aff_left.png"), cv2.IMREAD_UNCHANGED)
    assert np.array_equal(crop > 0, one.masks[0][rows, columns])
    assert cv2.imread(str(root / "cropped/P95_01/0000001/inpainting.png")).shape[:2] == crop.shape


def test_the_benchmark_reads_it_back(tmp_path: Path) -> None:
    """Cases with all modes, in their groups, without notes."""
    stills = (still(1, mode(1, 0.7), mode(0, 0.3)), still(2, mode(2, 1.0, shift=6), text="lift mug"))
    root = written(tmp_path, room(*stills))
    read = [cases.read(case) for case in act_affordance.cases(files.tree("test", root))]
    assert [case.case_id for case in read] == [f"{kind}/P95_01/000000{n}" for kind in ("cropped", "masks") for n in (1, 2)]
    assert [len(case.modes) for case in read] == [2, 1, 2, 1] and not any(case.notes for case in read)
    assert [case.taxonomy.tolist() for case in read[:2]] == [[1, 0], [2]]
    assert {"kitchen", "known", "text_decides", "hands_from_image"} <= set(read[0].groups)


def test_groups_say_whether_the_text_decides_and_tells_the_hands(tmp_path: Path) -> None:
    """Two tasks of a picture that want the same place do not need the text; the same words with the same hand tell the hand."""
    same = written(tmp_path / "same", room(still(1, mode(1, 1.0)), still(2, mode(1, 1.0))))
    apart = written(tmp_path / "apart", room(still(1, mode(1, 1.0)), still(2, mode(0, 1.0)), setting="desk"))
    groups = [[task["groups"] for task in json.loads((root / "stills.json").read_text())["stills"]] for root in (same, apart)]
    assert groups == [[["known"]] * 2, [["desk", "text_decides", "hands_from_image"]] * 2]


def test_an_empty_benchmark_is_refused(tmp_path: Path) -> None:
    """One sentence says what to do."""
    with pytest.raises(ValueError, match="there is no still to write; plan more rooms"):
        written(tmp_path, room())


def test_stills_read_no_source(tmp_path: Path) -> None:
    """A source that would be ignored is refused."""
    refused = call("run", "train-set", "--source", tmp_path, "--store", tmp_path / "store")
    assert refused.code == 2 and "renders its own data and reads no source" in refused.words
