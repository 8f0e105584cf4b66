"""A folder of predictions -> what it answers to a case: our Parquet file, or the released layout of any method."""

from __future__ import annotations

from collections import defaultdict
from typing import Protocol

from afford.dataset import act_affordance
from afford.twohands.benchmark import answers, stored
from afford.twohands.benchmark.answers import Answer
from schemas.benchmark import Case
from schemas.files import FileRef, FileTree

ALREADY_CUT = 0.0
"""the threshold of masks in a folder that names none"""


class Method(Protocol):
    """Something that was asked before."""

    levels: tuple[float, ...]

    def answer(self, case: Case) -> Answer:
        """What it says of the case."""


def open_method(files: FileTree, levels: tuple[float, ...], level: float, protocol: str, proposals: int) -> Method:
    """The method behind a folder. `levels` cut probabilities, of which up to `proposals` ways are made; `level` is taken of a
    folder with several thresholds; a folder that does not say its protocol is of `protocol`.
    """
    table = files.find(stored.NAME)
    return Probabilities(table, levels, proposals) if table else Masks(files, level, protocol)


class Probabilities:
    """Predictions that were stored with their probabilities."""

    def __init__(self, table: FileRef, levels: tuple[float, ...], proposals: int) -> None:
        self.levels, self.proposals = levels, proposals
        self._stored = stored.Stored(table.path)

    def answer(self, case: Case) -> Answer:
        size = case.modes.shape[2:]
        said = self._stored.get(case.case_id)
        if said is None:
            return answers.nothing(size, self.levels)
        return answers.of_prediction(said, size, self.levels, self.proposals)


class Masks:
    """Masks on disk, perhaps at several thresholds. ValueError when thresholds are mixed with none, or `level` is not there."""

    def __init__(self, files: FileTree, level: float, protocol: str) -> None:
        self._files: dict[str, dict[float, dict[str, FileRef]]] = defaultdict(lambda: defaultdict(dict))
        seen = set()
        for threshold, case_id, side, ref in act_affordance.predictions(files, protocol):
            seen.add(threshold)
            self._files[case_id][ALREADY_CUT if threshold is None else threshold][side] = ref
        if None in seen and len(seen) > 1:
            raise ValueError(f"{files.name}: some masks lie in a folder of a threshold and some in none; use one way for all")
        self.levels = (ALREADY_CUT,) if seen == {None} else tuple(sorted(at for at in seen if at is not None))
        self._chosen = self.levels[0] if len(self.levels) == 1 else level
        if self._chosen not in self.levels:
            raise ValueError(f"{files.name}: expected a folder of threshold {level}, found {', '.join(map(str, self.levels))}; "
                             f"choose one: --set score_cases.level={self.levels[0]}")

    def answer(self, case: Case) -> Answer:
        size = case.modes.shape[2:]
        at = self._files.get(case.case_id)
        return answers.nothing(size, self.levels) if at is None else answers.of_files(at, size, self.levels, self._chosen)
