"""Blocks of pages that scripts write: nothing around them changes, how long it took stays, what is not finished is marked."""

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


def test_a_block_is_replaced_and_nothing_else(tmp_path: Path) -> None:
    """Twice is once; a page without marks is refused."""
    where = page(tmp_path, "old\n")
    for _ in range(2):
        pages.into(*where, "new\n")
    assert where[0].read_text() == page(tmp_path, "new\n")[0].read_text()
    with pytest.raises(SystemExit, match="expected the marks of the part other"):
        pages.into(where[0], "other", "x.py", "new\n")


@pytest.mark.parametrize(("block", "line", "told"), [
    (f"{LINE}old\n", "", LINE), (f"{LINE}old\n", LINE.replace("3", "4"), LINE.replace("3", "4")), ("old\n", "", ""),
    (f"old\n\n{LINE}", "", "")])  # fmt: skip
def test_a_run_that_was_cached_keeps_how_long_it_took(tmp_path: Path, block: str, line: str, told: str) -> None:
    """At the head of the block; a run that was not says it anew."""
    assert pages.took(*page(tmp_path, block), line) == told


@pytest.mark.parametrize(("seeds", "told"), [(3, "3"), (2, "2 of 3, not finished")])
def test_the_short_table_of_grasps_marks_what_is_not_finished(seeds: int, told: str) -> None:
    """As the report does; only policies that are shown, in PyBullet."""
    rows = [ResultRow(policy, "unseen_size", engine, FIGURES, seeds, 3)
            for policy in ("student", "lambda_half") for engine in ("bullet", "mujoco")]  # fmt: skip
    assert bench_grasp.short(rows).splitlines()[2:] == [f"| student | unseen size | 50.0 | 4.0 | 5.0 | 0.25 | {told} |"]


def test_a_section_is_what_stands_under_its_heading() -> None:
    """Between others or last; one that is not there is said, for a block would lose what it has."""
    report = "A.\n\n## One\n\n1\n\n## Two\n\n2\n"
    assert [bench_grasp.section(report, name) for name in ("One", "Two")] == ["1\n", "2\n"]
    with pytest.raises(SystemExit, match="Three: the report has no such section"):
        bench_grasp.section(report, "Three")


def test_every_section_has_its_block() -> None:
    """On the page that it names."""
    for name, (page, _) in bench_grasp.SECTIONS.items():
        assert f"<!-- {name}: written by benchmarks/bench_grasp.py -->" in (pages.ROOT / "docs" / page).read_text(), name
