"""Write contact sheets of data sets from real video, one PNG per source, outside the project.

    PYTHONPATH=. python benchmarks/real_sheets.py OUT SOURCE [SOURCE ...]

Each SOURCE is an EPIC-format root or your own folder. The images show real people's frames under the source's licence
(EPIC-KITCHENS, VISOR: CC BY-NC 4.0), so OUT must not be inside the project.
"""

from __future__ import annotations

import shutil
import sys
from pathlib import Path

from commands.run import Request, run
from commands.session import STORE
from commands.targets import use
from pipeline import TARGETS, build

ROOT = Path(__file__).resolve().parent.parent


def main(arguments: list[str]) -> int:
    """Make the data sets and copy their sheets; the number of sources that failed."""
    if len(arguments) < 2:
        sys.stderr.write(__doc__ or "")
        return 2
    out, *sources = (Path(argument).resolve() for argument in arguments)
    if out.is_relative_to(ROOT):
        sys.stderr.write(f"{out}: expected a folder outside the project, because the frames are not ours to share\n")
        return 2
    out.mkdir(parents=True, exist_ok=True)
    use(TARGETS, build)
    failed = 0
    for source in sources:
        failed += run(Request("dataset", source, replace=True)) != 0
        for name in ("contact_sheet.png", "statistics.json"):
            made = STORE / "datasets" / source.name / name
            if made.exists():
                shutil.copyfile(made, out / f"{source.name}_{name}")
    return failed


if __name__ == "__main__":
    raise SystemExit(main(sys.argv[1:]))
