"""The verb `fetch-list`: list the files of EPIC-KITCHENS and VISOR that a folder still lacks. Nothing is downloaded."""

from __future__ import annotations

import json as encoder
import sys
from collections import Counter
from dataclasses import asdict, dataclass
from pathlib import Path

from afford.extraction.sources.downloads import KINDS, LICENCE, SPLITS, file_states, published_files
from commands.errors import UsageError, unknown

HEAD = """# {missing} of {all} files are not in {root} yet ({partial} of them in part). Licence of all: {licence}.
# Sizes: not published. The list depends on the folder: run it again after a download for a shorter one.
# aria2c --continue --auto-file-renaming=false --dir={root} --input-file=THIS_FILE
"""


@dataclass(frozen=True)
class Subset:
    """Wanted part of the data sets; empty tuples mean all videos that VISOR annotates."""

    videos: tuple[str, ...] = ()
    participants: tuple[str, ...] = ()
    split: str = ""
    kinds: tuple[str, ...] = ("tables", "sparse", "frames")


def fetch_list(root: Path, subset: Subset, json: bool) -> int:
    """Print the missing files as a list for aria2c or as one JSON object.

    UsageError for a name that does not exist.
    """
    if root.exists() and not root.is_dir():
        raise UsageError(f"{root}: this is a file; give a folder, which may be new")
    wanted = list(published_files(_videos(subset), _kinds(subset)))
    found = list(file_states(root, wanted))
    counts = Counter(state for _, state in found)
    if json:
        rows = [{**asdict(file), "state": state, "bytes": None, "licence": LICENCE} for file, state in found]
        sys.stdout.write(encoder.dumps({"root": str(root), "counts": dict(counts), "files": rows}) + "\n")
        return 0
    missing = [file for file, state in found if state != "there"]
    sys.stdout.write(HEAD.format(missing=len(missing), all=len(found), root=root, partial=counts["partial"], licence=LICENCE))
    sys.stdout.writelines(f"{file.url}\n  out={file.name}\n" for file in missing)
    return 0


def _videos(subset: Subset) -> list[str]:
    """Videos of a subset, sorted by id."""
    everything = {video for videos in SPLITS.values() for video in videos}
    people = {video[:3] for video in everything}
    for video in subset.videos:
        if video not in everything:
            raise unknown("video (VISOR annotates 158)", video, everything)
    for person in subset.participants:
        if person not in people:
            raise unknown("participant", person, people)
    if subset.split and subset.split not in SPLITS:
        raise unknown("split", subset.split, SPLITS)
    chosen = {video for video in everything if video in subset.videos or video[:3] in subset.participants}
    if not (subset.videos or subset.participants):
        chosen = everything
    return sorted(chosen & set(SPLITS[subset.split]) if subset.split else chosen)


def _kinds(subset: Subset) -> tuple[str, ...]:
    for kind in subset.kinds:
        if kind not in KINDS:
            raise unknown("kind of files", kind, KINDS)
    return subset.kinds
