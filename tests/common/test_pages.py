"""Blocks of pages that scripts write: the text around them stays, run times are kept, unfinished rows are marked."""

from __future__ import annotations

from pathlib import Path

import pytest

from afford.grasping.evaluate.result_cells import ResultRow
from benchmarks import bench_grasp, pages

FIGURES = {"succ": 0.5, "as_violation_pct": 4.0, "hls": 5.0, "negative_contact_end": 0.25}


LINE = "`make grasp` took 3.0 minutes on this machine.\n\n"


def page(folder: Path, block: str) -> tuple[Path, str, str]:
    """A page with one block between two sentences."""
    path = folder / "page.md"
    path.write_text(f"Before.\n<!-- table: written by benchmarks/x.py -->\n{block}<!-- end of table -->\nAfter.\n")
    return path, "table", "x.py"


def test_block_is_replaced_and_the_text_around_it_stays(tmp_path: Path) -> None:
    """A second write changes nothing; a page without marks is refused."""
    where = page(tmp_path, "old\n")
    for _ in range(2):
        pages.into(*where, "new\n")
    assert where[0].read_text() == page(tmp_path, "new\n")[0].read_text()
    with pytest.raises(SystemExit, match="expected the marks of the part other"):
        pages.into(where[0], "other", "x.py", "new\n")


@pytest.mark.parametrize(("block", "line", "kept"), [
    (f"{LINE}old\n", "", LINE), (f"{LINE}old\n", LINE.replace("3", "4"), LINE.replace("3", "4")), ("old\n", "", ""),
    (f"old\n\n{LINE}", "", "")])  # fmt: skip
def test_cached_run_keeps_the_run_time_of_the_page(tmp_path: Path, block: str, line: str, kept: str) -> None:
    """The run time is at the head of the block; a run that was not cached replaces it."""
    assert pages.took(*page(tmp_path, block), line) == kept


@pytest.mark.parametrize(("seeds", "shown"), [(3, "3"), (2, "2 of 3, not finished")])
def test_short_table_of_grasps_marks_unfinished_rows(seeds: int, shown: str) -> None:
    """The marks are those of the report; the table has the policies of the README, in PyBullet."""
    rows = [ResultRow(policy, "unseen_size", engine, FIGURES, seeds, 3)
            for policy in ("student", "lambda_half") for engine in ("bullet", "mujoco")]  # fmt: skip
    assert bench_grasp.short(rows).splitlines()[2:] == [f"| student | unseen size | 50.0 | 4.0 | 5.0 | 0.25 | {shown} |"]


def test_section_is_the_text_under_its_heading() -> None:
    """A section may be between others or last; a missing section is an error, since its block would be emptied."""
    report = "A.\n\n## One\n\n1\n\n## Two\n\n2\n"
    assert [bench_grasp.section(report, name) for name in ("One", "Two")] == ["1\n", "2\n"]
    with pytest.raises(SystemExit, match="Three: the report has no such section"):
        bench_grasp.section(report, "Three")


def test_sections_have_their_blocks() -> None:
    """The block is on the page that the section names."""
    for name, (page, _) in bench_grasp.SECTIONS.items():
        assert f"<!-- {name}: written by benchmarks/bench_grasp.py -->" in (pages.ROOT / "docs" / page).read_text(), name
