"""Pages of the documentation: links resolve, every page and every stage is listed, and the glossary names code that exists."""

from __future__ import annotations

import re
from pathlib import Path

import pytest

from tests.helpers.stage_files import MODULES

ROOT = Path(__file__).resolve().parents[2]
DOCS = ROOT / "docs"
PAGES = [ROOT / "README.md", ROOT / "CONTRIBUTING.md", ROOT / "CHANGELOG.md", *sorted(DOCS.rglob("*.md"))]
LINK = re.compile(r"\]\(([^)\s]+)\)")


@pytest.mark.parametrize("page", PAGES, ids=lambda page: str(page.relative_to(ROOT)))
def test_relative_links_resolve(page: Path) -> None:
    """Files exist, and so do headings."""
    for link in LINK.findall(page.read_text(encoding="utf-8")):
        if "://" in link:
            continue
        name, _, heading = link.partition("#")
        found = page.parent / name if name else page
        assert found.exists(), link
        if heading and found.suffix == ".md":
            assert heading in anchors(found), link


def test_every_page_is_reached_from_the_index() -> None:
    """Decisions are reached from an index of their own."""
    linked = {(DOCS / name).resolve() for index in (DOCS / "README.md", DOCS / "decisions" / "README.md")
              for link in LINK.findall(index.read_text(encoding="utf-8"))
              for name in [index.parent.relative_to(DOCS) / link.partition("#")[0]]}  # fmt: skip
    missing = [page for page in DOCS.rglob("*.md") if page.resolve() not in linked | {(DOCS / "README.md").resolve()}]
    assert not missing


def test_every_stage_is_listed() -> None:
    """docs/stages.md lists the file of each stage; recorders are described together."""
    listed = set(re.findall(r"\.\./(stages/\S+?)\.py", (DOCS / "stages.md").read_text(encoding="utf-8")))
    paths = {module.replace(".", "/") for module in MODULES.values()}
    assert {path for path in paths if not path.startswith("stages/recording/")} <= listed <= paths


def test_glossary_names_exist_in_the_code() -> None:
    """Every name in code type of the first two tables occurs in a source file or is a path."""
    text = "\n".join(path.read_text(encoding="utf-8") for room in ("afford", "stages", "schemas", "runner", "maps")
                     for path in sorted((ROOT / room).rglob("*.py")))  # fmt: skip
    words = set(re.findall(r"\w+", text)) | {"negative-affordance"}
    tables = (DOCS / "glossary.md").read_text(encoding="utf-8").partition("## Words of this project")[0]
    names = [name for row in re.findall(r"^\|.*\|$", tables, re.M) for name in re.findall(r"`([^`]+)`", row.rsplit("|", 2)[1])]
    unknown = [name for name in names
               if not ((ROOT / name).exists() if "/" in name else set(re.split(r"[=.]", name)) <= words | {"0"})]  # fmt: skip
    assert len(names) > 60 and not unknown


def anchors(page: Path) -> set[str]:
    """Names of the headings of a page, as GitHub forms them."""
    headings = re.findall(r"^#+ (.+)$", page.read_text(encoding="utf-8"), re.M)
    return {re.sub(r"[^\w\- ]", "", heading.lower()).replace(" ", "-") for heading in headings}
