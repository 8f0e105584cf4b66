"""Many files: their pictures through the model in batches; what cannot be read is refused and stops nothing."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

from afford.common.errors import SourceError
from afford.common.image_files import Picture
from afford.common.video.inputs import Source, pictures
from afford.common.video.probe import probe
from afford.twohands.model.predictor import Predictor
from afford.twohands.predict.ask import Answer, Question, ask


@dataclass(frozen=True)
class Refused:
    """A file that gave no picture, or no further one."""

    source: str
    message: str


def answers(predictor: Predictor, sources: Sequence[Source], question: Question, every: int, batch: int
            ) -> Iterator[Answer | Refused]:  # fmt: skip
    """In the order of the sources; refusals come as soon as they are met."""
    waiting: list[Picture] = []
    for item in _read(sources, every):
        if isinstance(item, Refused):
            yield item
            continue
        waiting.append(item)
        if len(waiting) == batch:
            yield from _asked(predictor, waiting, question)
            waiting = []
    if waiting:
        yield from _asked(predictor, waiting, question)


def count(source: Source, every: int) -> int:
    """How many pictures a source is expected to give: 1 for an image, and for a video that cannot be read."""
    try:
        return len(range(0, len(probe(source.path).pts), every)) if source.is_video else 1
    except (ValueError, OSError):
        return 1


def _asked(predictor: Predictor, pictures: list[Picture], question: Question) -> list[Answer | Refused]:
    """One answer for each. Where a batch fails, each of its pictures is asked alone, and those that fail again are refused."""
    try:
        return [*ask(predictor, pictures, question)]
    except Exception as error:
        if len(pictures) > 1:
            return [item for picture in pictures for item in _asked(predictor, [picture], question)]
        return [_refused(pictures[0], error)]


def _refused(one: Picture, error: Exception) -> Refused:
    height, width = one.rgb.shape[:2]
    name = one.source if one.frame is None else f"{one.source}, frame {one.frame}"
    return Refused(one.source, f"{name}: expected a picture that the model can be asked about, got one of {width} x {height} "
                               f"pixels that ends in {type(error).__name__}: {error}; leave it out")  # fmt: skip


def _read(sources: Sequence[Source], every: int) -> Iterator[Picture | Refused]:
    for source in sources:
        try:
            yield from pictures(source, every)
        except SourceError as error:
            yield Refused(str(source.path), str(error))
