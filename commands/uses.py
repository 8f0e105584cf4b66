"""Option `--uses`: a CSV file of the uses of objects, as a parameter of part_describe."""

from __future__ import annotations

import csv
from pathlib import Path

from commands.errors import UsageError

COLUMNS = ("object", "task", "hold", "avoid")
MOST_BYTES = 1_000_000


def setting_of(path: Path) -> str:
    """Return the file as STAGE.PARAM=VALUE. UsageError, one sentence, for a file of another form or a bad row."""
    from afford.surface.describe.uses import parse_use

    try:
        if path.stat().st_size > MOST_BYTES:
            raise ValueError(f"expected at most {MOST_BYTES} bytes")
        rows = list(csv.DictReader(path.read_text(encoding="utf-8-sig").splitlines(), skipinitialspace=True))
    except (OSError, ValueError, csv.Error) as error:
        raise UsageError(f"--uses {path}: expected a CSV file; {error}") from error
    if not rows or any(set(COLUMNS) - row.keys() or None in row or None in row.values() for row in rows):
        raise UsageError(f"--uses {path}: expected rows with the columns {','.join(COLUMNS)}")
    lines = [" | ".join(row[name].strip() for name in COLUMNS) for row in rows]
    for line in lines:
        if "," in line or line.count("|") != len(COLUMNS) - 1:
            raise UsageError(f"--uses {path}: {line!r}: expected cells without commas and bars; separate parts by ';'")
        try:
            parse_use(line)
        except ValueError as error:
            raise UsageError(f"--uses {path}: {error}") from error
    return f"part_describe.uses={','.join(lines)}"
